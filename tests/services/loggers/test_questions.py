"""Files that can be read in two ways are asked about; those of one meaning are not."""

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record

ROWS = 1500
RATE = 100.0
TIME = np.arange(ROWS) / RATE
RNG = np.random.default_rng(3)
X, Y, Z = (
    np.round(np.sin(2 * np.pi * f * TIME + f) + 0.3 * RNG.standard_normal(ROWS), 4)
    for f in (5, 9, 13)
)


def rows(form):
    return "".join(form(i) + "\n" for i in range(ROWS))


def two(i):
    return f"{X[i]},{Y[i]}"


def german(i):
    return two(i).replace(",", ";").replace(".", ",")


def of_width(width, values, form="{:12.4f}"):
    return "".join(
        "".join(form.format(v) for v in values[i : i + width]) + "\n"
        for i in range(0, len(values), width)
    )


@pytest.fixture
def read(tmp_path):
    def reading(content, name="file.csv", **given):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_record(path, skip_missing=True, **given)

    return reading


@pytest.mark.parametrize(
    ("content", "says", "given", "rate"),
    [
        pytest.param(
            "Time,ax,ay\n" + rows(lambda i: f"{10 * i},{two(i)}"),
            r"no unit: in seconds .* 0\.1 Hz.*in milliseconds .* 100 Hz.*--reading time_unit",
            {"time_unit": "ms"},
            100.0,
            id="counts without a unit",
        ),
        pytest.param(
            "Time,ax,ay\n" + rows(lambda i: f"{i},{two(i)}"),
            r"no unit.*1 Hz.*--reading time_unit",
            {"time_unit": "ms"},
            1000.0,
            id="whole counts",
        ),
        pytest.param(
            "# Sampling rate: 200 Hz\n# Duration: 15 s\nax,ay\n" + rows(two),
            r"'Duration: 15 s'.*1500 rows.*7\.5 s at 200 Hz.*--rate-hz",
            {"rate_hz": 100.0},
            100.0,
            id="rate against duration",
        ),
        pytest.param(
            "# Sampling rate: 100 Hz\n# Number of samples: 3000\nax\n"
            + rows(lambda i: f"{X[i]}"),
            r"'Number of samples: 3000'.*1500 samples.*--rate-hz 100",
            {"rate_hz": 100.0},
            100.0,
            id="number of samples",
        ),
        pytest.param(
            "# Sampling rate: 200 Hz\nt_s,ax,ay\n" + rows(lambda i: f"{TIME[i]:.2f},{two(i)}"),
            r"clock .* says 100 Hz, its heading states 'Sampling rate: 200 Hz'.*--rate-hz 100",
            {"rate_hz": 100.0},
            100.0,
            id="clock against heading",
        ),
        pytest.param(
            "# Sampling rate: 1000 Hz\n# Sample rate: 100 Hz\nax,ay\n" + rows(two),
            r"states different rates: .*1000 Hz.*100 Hz.*--rate-hz",
            {"rate_hz": 100.0},
            100.0,
            id="two rates",
        ),
        pytest.param(
            "Abtastrate: 1.000 Hz\nax;ay\n" + rows(german),
            r"read in two ways .*1000 Hz or 1 Hz",
            {"rate_hz": 1000.0},
            1000.0,
            id="thousand or one",
        ),
        pytest.param(
            "millis,ax\n" + rows(lambda i: f"{80 * (i // 8)},{X[i]}"),
            r"repeat: about 8 rows share each.*--rate-hz",
            {"rate_hz": 100.0},
            100.0,
            id="buffers",
        ),
        pytest.param(
            "millis,ax\n" + rows(lambda i: f"{80 * (i // 8) + i % 8},{X[i]}"),
            r"bursts: 8 samples 0\.001 s apart, then a pause of 0\.073 s; 100\.\d* Hz on",
            {"rate_hz": 100.0},
            100.0,
            id="bursts",
        ),
        pytest.param(
            "SAMPLING RATE: 100\n" + of_width(8, np.cumsum(X)),
            r"8 columns .* no names.*one series .*1500 samples.*--reading wrapped=yes",
            {"wrapped": True},
            100.0,
            id="wrapped, perhaps",
        ),
        pytest.param(
            "Timestamp,ax\n" + rows(lambda i: f"2024-04-21 15:00:0{int(i == 700)},{X[i]}"),
            r"Time does not run forwards .* --rate-hz",
            {"rate_hz": 100.0},
            100.0,
            id="stamps that stand still",
        ),
        pytest.param(
            "# Sampling rate: 100 Hz\n# Duration: 20 s\nax,ay\n" + rows(two),
            r"'Duration: 20 s'.*15 s at 100 Hz",
            {"rate_hz": 100.0},
            100.0,
            id="cut short",
        ),
        pytest.param(
            "t_s,t_ms,ax\n" + rows(lambda i: f"{TIME[i]:.2f},{5 * i},{X[i]}"),
            r"Two columns .*different times: 't_s' 100 Hz, .* 200 Hz.*--reading time_column",
            {"time_column": "t_ms"},
            200.0,
            id="two clocks",
        ),
    ],
)
def test_what_is_doubtful_is_asked_and_a_flag_settles_it(read, content, says, given, rate):
    with pytest.raises(RecordError, match=says):
        read(content)
    assert read(content, **given).rate_hz == pytest.approx(rate, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "channels", "units"),
    [
        pytest.param(
            '"TOA5","CR1000X","CR","1234","Std.03","CPU:p.CR1X","5678","Fast"\n'
            '"TIMESTAMP","RECORD","ax","ay"\n"TS","RN","m/s^2","m/s^2"\n"","","Smp","Smp"\n'
            + rows(lambda i: f'"2024-04-21 15:00:{TIME[i]:05.2f}",{i},{two(i)}'),
            ("ax", "ay"),
            ("m/s^2", "m/s^2"),
            id="four lines of heading",
        ),
        pytest.param(
            "Operator;Smith\nSensor;ADXL355\nRange;2 g\nAbtastrate;100\n"
            + rows(lambda i: f"{X[i]};{Y[i]}"),
            ("channel_0", "channel_1"),
            ("", ""),
            id="settings are no heading",
        ),
        pytest.param(
            "rst:0x1 (POWERON_RESET),boot:0x13\nMPU6050 ready\nmillis,ax,ay\n"
            + rows(lambda i: f"{10 * i + 523},{two(i)}"),
            ("ax", "ay"),
            ("", ""),
            id="what a microcontroller says first",
        ),
        pytest.param(
            rows(lambda i: f"t_ms:{10 * i} ax:{X[i]} ay:{Y[i]}"),
            ("ax", "ay"),
            ("", ""),
            id="serial plotter",
        ),
        pytest.param(
            "Time (s)    Acc X (m/s^2)    Acc Y (m/s^2)\n"
            + rows(lambda i: f"{TIME[i]:10.3f}  {X[i]:12.5f}  {Y[i]:12.5f}"),
            ("Acc X", "Acc Y"),
            ("m/s^2", "m/s^2"),
            id="names with blanks",
        ),
        pytest.param(
            '"Zeit","ax","ay"\n'
            + rows(lambda i: f'"{TIME[i]:.2f}","{X[i]}","{Y[i]}"'.replace(".", ",")),
            ("ax", "ay"),
            ("", ""),
            id="quoted decimal commas",
        ),
        pytest.param(
            "time,seconds_elapsed,ax,ay\n"
            + rows(
                lambda i: f"{1_713_711_600_000_000_000 + 10_000_000 * i},{TIME[i]:.7f},{two(i)}"
            ),
            ("ax", "ay"),
            ("", ""),
            id="two clocks that agree",
        ),
        pytest.param(
            "t (s),ax,ay\n"
            + rows(lambda i: f"{TIME[i]:.2f},{two(i)}")
            + "\nEnd of file\nTotal samples: 1500\n",
            ("ax", "ay"),
            ("", ""),
            id="words below the rows",
        ),
        pytest.param(
            "Time,ax,ay\n" + rows(lambda i: f"{TIME[i]:.2f} sec,{two(i)}"),
            ("ax", "ay"),
            ("", ""),
            id="units behind values",
        ),
        pytest.param(
            "date,time,lat,ax,ay\n"
            + rows(
                lambda i: (
                    f"20240421,{150050 + TIME[i] + 40 * (TIME[i] >= 10):.2f},47.1,{two(i)}"
                )
            ),
            ("ax", "ay"),
            ("", ""),
            id="hours, minutes and seconds in a number",
        ),
    ],
)
def test_what_has_one_meaning_is_read(read, content, channels, units):
    record = read(content)
    assert (record.rate_hz, record.channels, record.units) == (RATE, channels, units)
    assert record.gaps == ()
    np.testing.assert_allclose(record.samples, np.column_stack([X, Y]), atol=1e-9)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (
            "time,sensor,acc\n"
            + rows(lambda i: f"{TIME[i]:.2f},A,{X[i]}\n{TIME[i]:.2f},B,{Y[i]}"),
            r"several sensors one after another at each time \(column 'sensor' repeats A, B\)",
        ),
        (
            rows(lambda i: f"{abs(X[i]):.3f},{abs(Y[i]):.3f}".replace(".", ",")),
            r"before their decimals, too .* semicolons or tabs",
        ),
        (
            "# FS: 2 g\n# Rate: 5 mm/min\n# dt: 21.04.2024\nax,ay\n" + rows(two),
            r"does not say how often it was sampled",
        ),
        ("# Sampling interval: 10\nax,ay\n" + rows(two), r"two ways .*: 0\.1 Hz or 100 Hz"),
        (
            "# Sampling interval: 60 s\nax,ay\n" + rows(two),
            r"not a plausible sampling rate for vibration",
        ),
    ],
)
def test_what_no_figure_tells_is_asked(read, content, says):
    with pytest.raises(RecordError, match=says):
        read(content)


def test_pairs_of_time_and_value_are_one_series_however_many_stand_on_a_line(read):
    pairs = [f"{TIME[i]:8.3f} {X[i]:9.4f}" for i in range(ROWS - 1)]
    lines = [" ".join(pairs[i : i + 4]) for i in range(0, len(pairs), 4)]
    record = read("a title\n" + "\n".join(lines))
    assert record.rate_hz == RATE
    np.testing.assert_allclose(record.samples[:, 0], X[:-1], atol=1e-9)


def test_a_counter_tells_which_rows_are_missing(read):
    kept = [i for i in range(ROWS) if i not in (300, 301, 900)]
    text = "# fs: 100 Hz\nn,ax,ay\n" + "".join(f"{i % 256},{two(i)}\n" for i in kept)
    record = read(text)
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(300, 2), (898, 1)]
    assert "the counter 'n' leaves out numbers" in record.notes[0]


def test_formats_with_fixed_meaning_are_read(read):
    knet = [
        ("Record Time", "2024/04/21 15:00:15"), ("Station Code", "XXX000"),
        ("Sampling Freq(Hz)", "100Hz"), ("Duration Time(s)", "15"), ("Dir.", "N-S"),
        ("Scale Factor", "2000(gal)/8000"), ("Memo.", ""),
    ]  # fmt: skip
    text = "".join(f"{key:18}{value}\n" for key, value in knet)
    record = read(text + of_width(8, np.round(X * 1000).astype(int), "{:9d}"), "a.EW")
    assert (record.channels, record.units, record.rate_hz) == (("N-S",), ("m/s^2",), RATE)
    assert record.start_ns == 1_713_711_600_000_000_000 - 9 * 3600 * 10**9
    np.testing.assert_allclose(record.samples[:, 0], np.round(X * 1000) / 400, atol=1e-9)

    head = (
        "TIMESERIES XX_ABC_00_HNZ_R, 1500 samples, 100 sps, 2024-04-21T15:00:00.000000, SLIST, "
    )
    record = read(head + "FLOAT, M/S**2\n" + of_width(6, X), "a.ascii")
    assert (record.rate_hz, record.samples.shape) == (RATE, (ROWS, 1))
    assert record.start_ns == 1_713_711_600_000_000_000

    dataset = (
        "    -1\n    58\nid\nNONE\n21-Apr-24 15:00:00\nNONE\nNONE\n"
        "    1         1    0         0 NONE               7   3 NONE               0   0\n"
        "         2      1500         1  0.00000E+00  1.00000E-02  0.00000E+00\n"
        "        17    0    0    0 Time                 s\n"
        "        12    0    0    0 Acceleration         m/s^2\n"
        + "         0    0    0    0 NONE                 NONE\n" * 2
        + of_width(6, X, "{:13.5e}")
        + "    -1\n"
    )
    record = read(dataset + dataset.replace(" 7   3", " 8   1"), "a.unv")
    assert (record.channels, record.units) == (("node 7 +Z", "node 8 +X"), ("m/s^2",) * 2)
    np.testing.assert_allclose(record.samples[:, 0], X, atol=1e-5)

    section = "  1500 points of {} data equally spaced at  .010 sec, in {}. (8f12.4)\n"
    volume = "header\n" + section.format("accel", "cm/sec2") + of_width(8, X)
    volume += section.format("veloc", "cm/sec") + of_width(8, Y) + "/& end of data\n"
    record = read(volume, "a.v2")
    assert (record.channels, record.units, record.rate_hz) == (
        ("acceleration",),
        ("m/s^2",),
        RATE,
    )
    np.testing.assert_allclose(record.samples[:, 0], 0.01 * X, atol=1e-6)
    assert "Left out, being computed" in record.notes[0]
    with pytest.raises(RecordError, match=r"states 1500 points and 1492 follow.*cut short"):
        read(section.format("accel", "cm/sec2") + of_width(8, X[:-8]), "b.v2")


def test_a_labview_measurement_is_read_by_its_own_heading(read):
    text = (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tNo\n"
        "Time_Pref\tAbsolute\n***End_of_Header***\t\n\t\nChannels\t2\t\nSamples\t1500\t1500\n"
        "Date\t2024/04/21\t2024/04/21\nTime\t15:00:00,0\t15:00:00,0\nY_Unit_Label\tg\tg\n"
        "Delta_X\t1,000000E-2\t1,000000E-2\n***End_of_Header***\t\t\t\n"
        "X_Value\tRoof\tFloor\tComment\n"
    )
    record = read(text + rows(lambda i: f"\t{X[i]}\t{Y[i]}".replace(".", ",")), "a.lvm")
    assert (record.channels, record.units) == (("Roof", "Floor"), ("m/s^2",) * 2)
    assert (record.rate_hz, record.start_ns) == (RATE, 1_713_711_600_000_000_000)
    with pytest.raises(RecordError, match=r"End_of_Header.*cut short"):
        read(text[:150], "b.lvm")


@pytest.mark.parametrize(
    ("begins", "says"),
    [
        (b"TDSm", "a TDMS file.*damaged"), (b"RIFF\x24\0\0\0WAVEfmt ", "a WAV.*damaged"),
        (b"000001D AAA  BHZ", "a miniSEED file.*damaged"),
        (b"\x89HDF\r\n\x1a\n", "an HDF5 file.*damaged"),
        (b"PAR1", "a Parquet file.*damaged"), (b"\x1f\x8b\x08", "gzip.*gunzip"),
        (b"    -1\n    58b     1", "no evenly spaced time response"),
        (b"|CF,2,1,1;", "imc FAMOS"),
        (b"PK\x03\x04" + b"\0" * 26 + b"[Content_Types].xml", "an Excel workbook.*xlsx"),
        (b"MATLAB 5.0 MAT-file, Platform", r"Name it \.mat"), (b"\x93NUMPY", r"Name it \.npy"),
        (b"\xc7\xcf\xff\xff" * 76 + b"\x06\0\0\0" + b"\0" * 100, r"a SAC file.*\.sac"),
        (b"\x80\x04\x95", "pickle.*never read"), (b"MDF     4.10", "ASAM MDF.*asammdf"),
    ],
)  # fmt: skip
def test_a_binary_file_is_named_with_a_way_to_read_it(read, begins, says):
    with pytest.raises(RecordError, match=f"(?i){says}"):
        read(begins + b"\0" * 400, "record.dat")


def test_set_aside_columns_are_named_and_can_be_forced_in(read):
    length = np.sqrt(X**2 + Y**2)
    text = "t_s,n,ax,ay,total,spare,state\n" + rows(
        lambda i: f"{TIME[i]:.2f},{i},{two(i)},{length[i]:.4f},2.5,{'OK' if i % 9 else 'BAD'}"
    )
    record = read(text)
    assert record.channels == ("ax", "ay")
    said = " ".join(record.assumptions)
    for reason in ("'n': a counter", "'total': the magnitude of ax, ay", "'state': text",
                   "'spare': never changes"):  # fmt: skip
        assert reason in said
    assert read(text, keep=("total", "n")).channels == ("n", "ax", "ay", "total")
    assert read(text, keep=("all",)).channels == ("n", "ax", "ay", "total", "spare")
    assert read(text, channels=("spare", "ay")).channels == ("spare", "ay")


def test_day_and_month_that_could_be_exchanged_leave_the_start_open(read):
    text = "time,ax\n" + rows(lambda i: f"04/05/2024 15:00:{TIME[i]:06.3f},{X[i]}")
    record = read(text)
    assert (record.rate_hz, record.start_ns) == (RATE, None)
    assert "--reading date_order=dmy" in record.notes[0]
    assert read(text, date_order="dmy").start_ns == 1_714_834_800_000_000_000
    assert read(text, date_order="mdy").start_ns == 1_712_329_200_000_000_000
