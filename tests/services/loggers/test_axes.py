"""Columns beside the clock: other axes that grow evenly, and clocks of further sensors."""

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record

ROWS = 800
RATE_HZ = 125.0
TIME = np.arange(ROWS) / RATE_HZ
X, Y = np.random.default_rng(21).normal(size=(2, ROWS)).round(4)


@pytest.fixture
def read(tmp_path):
    def reading(heading, *columns, **given):
        path = tmp_path / "file.csv"
        texts = [
            [f"{v:.6g}" if isinstance(v, float) else str(v) for v in column]
            for column in columns
        ]
        rows = [",".join(fields) for fields in zip(*texts, strict=True)]
        path.write_text(heading + "\n" + "\n".join(rows) + "\n")
        return read_record(path, skip_missing=True, **given)

    return reading


@pytest.mark.parametrize("before", ["", "Sampling rate: 125 Hz\n"])
@pytest.mark.parametrize(
    "names",
    ["Frequency (Hz),PSD", "f_Hz,H", "f,amplitude", "Frequenz [Hz],a [g]", "Period (s),Sa (g)"],
)
def test_a_spectrum_is_refused_as_one(read, before, names):
    with pytest.raises(RecordError, match=r"this is a spectrum.*Export the time histories"):
        read(before + names, 0.05 * np.arange(ROWS), np.abs(X))


@pytest.mark.parametrize(
    "name",
    ["Angle [deg]", "distance_m", "RPM", "Depth (m)", "Strain [%]", "Chainage", "x [mm]",
     "x_mm", "Position", "Winkel"],
)  # fmt: skip
def test_another_axis_is_no_clock(read, name):
    axis = 3 + 0.25 * np.arange(ROWS)
    with pytest.raises(RecordError, match=r"does not say how often it was sampled"):
        read(f"{name},acc", axis, X)
    record = read(f"Sampling rate: 125 Hz\n{name},acc", axis, X)
    assert (record.rate_hz, record.channels) == (RATE_HZ, ("acc",))


@pytest.mark.parametrize("name", ["", "x", "x [ms]", "X_Value"])
def test_an_axis_whose_name_says_nothing_else_is_the_clock(read, name):
    scale = 1000 if "ms" in name else 1
    assert read(f"{name},acc", TIME * scale, X).rate_hz == pytest.approx(RATE_HZ)


PAIRS = ("Time [s],Roof [g],Time [s],Base [g]", "t1,Roof,t2,Base", "Time_A,Roof,Time_B,Base",
         "Roof_time,Roof,Base_time,Base", "Zeit 1 [s],Roof,Zeit 2 [s],Base")  # fmt: skip


@pytest.mark.parametrize("names", PAIRS)
@pytest.mark.parametrize(
    ("other", "says", "rate"),
    [
        (lambda t: 2 * t, "125 Hz and 62.5 Hz", 62.5),
        (lambda t: 1.004 * t, "125 Hz and 124.502 Hz", 124.502),
        (lambda t: t + 1.5, "begin 1.5 s apart", 125.0),
        (lambda t: t + 0.004, "begin 0.004 s apart", 125.0),
    ],
    ids=["half the rate", "a little slower", "later", "half a step later"],
)
def test_clocks_of_sensors_that_differ_are_refused_and_each_can_be_read(
    read, names, other, says, rate
):
    with pytest.raises(RecordError, match=rf"different sensors.*{says}.*--channels 'Base'"):
        read(names, TIME, X, other(TIME), Y)
    base = read(names, TIME, X, other(TIME), Y, channels=("Base",))
    assert base.rate_hz == pytest.approx(rate, rel=1e-5)
    assert read(names, TIME, X, other(TIME), Y, channels=("Roof",)).rate_hz == RATE_HZ


@pytest.mark.parametrize("names", PAIRS)
def test_clocks_of_sensors_that_agree_are_one(read, names):
    record = read(names, TIME, X, TIME, Y)
    assert (record.rate_hz, record.channels) == (RATE_HZ, ("Roof", "Base"))


@pytest.mark.parametrize(
    ("names", "second"),
    [
        ("Time,Roof,elapsed_ms,Base", 1000 * TIME),
        ("Time,Roof,timestamp_ms,Base", [1_713_711_600_000 + 8 * i for i in range(ROWS)]),
        ("Time,Roof,device_ms,Temperature", 1000 * TIME + 900),
        ("Time,device_ms,Roof,Base", None),
    ],
    ids=["another unit", "with a date", "beside a slow column", "not before a sensor"],
)
def test_a_second_clock_of_the_same_rows_is_no_other_sensor(read, names, second):
    if second is None:
        columns = (TIME, 1000 * TIME + 900, X, Y)
    else:
        columns = (TIME, X, second, Y)
    record = read(names, *columns)
    assert record.rate_hz == pytest.approx(RATE_HZ)


def test_a_shorter_table_beside_another_is_refused_by_its_clock(read):
    half = ROWS // 2
    other = [f"{i / 50:.3f}" if i < half else "" for i in range(ROWS)]
    base = [str(Y[i]) if i < half else "" for i in range(ROWS)]
    with pytest.raises(RecordError, match=r"125 Hz and 50 Hz"):
        read(PAIRS[0], TIME, X, other, base)
    assert read(PAIRS[0], TIME, X, other, base, channels=("Base",)).rate_hz == 50.0


def test_two_columns_of_stamps_of_different_instants_are_refused_and_zones_are_not(read):
    def stamps(offset_ms):
        start = np.datetime64("2024-04-21T15:00:00.000")
        return [str(start + np.timedelta64(8 * i + offset_ms, "ms")) for i in range(ROWS)]

    with pytest.raises(RecordError, match=r"begin 1 s apart"):
        read("Time A,a,Time B,b", stamps(0), X, stamps(1000), Y)
    assert read("Time A,a,Time B,b", stamps(0), X, stamps(7_200_000), Y).rate_hz == RATE_HZ


def test_a_force_that_grows_is_no_frequency(read):
    record = read("Sampling rate: 125 Hz\nF [kN],u [mm]", np.sort(np.abs(X)), Y)
    assert (record.rate_hz, record.channels) == (RATE_HZ, ("F", "u"))
