"""Text of particular loggers: starts, units, settings beside the rows, slow columns."""

import numpy as np
import pytest

from slowtime_services.files import read_record

ROWS = 600
START_NS = 1_713_711_600_000_000_000  # 2024-04-21T15:00:00Z
X, Y = (np.round(np.random.default_rng(seed).normal(size=ROWS), 4) for seed in (1, 2))
T = [f"{i / 100:.2f}" for i in range(ROWS)]
TABLE = "".join(f"{T[i]},{X[i]},{Y[i]}\n" for i in range(ROWS))
TABS, SEMICOLONS = TABLE.replace(",", "\t"), TABLE.replace(",", ";")
WORTH = {"g": 9.80665, "cm/s^2": 1e-2}


@pytest.fixture
def read(tmp_path):
    def reading(content, **given):
        path = tmp_path / "file.txt"
        path.write_text(content)
        return read_record(path, skip_missing=True, **given)

    return reading


@pytest.mark.parametrize(
    ("content", "worth"),
    [
        pytest.param(
            "File name: a.dxd\nStart time: 21.04.2024 15:00:00.000\nNumber of channels: 2\n"
            "Sample rate: 100\n\nTime (s)\tacc x (m/s2)\tacc y (m/s2)\n" + TABS,
            1.0, id="Dewesoft",
        ),
        pytest.param(
            "DASYLab - V 13.00.01\nRecording date     : 21.04.2024,  15:00:00\n"
            "Block length       : 1024\nDelta              : 0.01 sec\n"
            "Measurement time [s];acc x [g];acc y [g]\n" + SEMICOLONS, WORTH["g"], id="DASYLab",
        ),
        pytest.param(
            "HBM_CATMAN_DATAFILE_40\nT0 = 21.04.2024 15:00:00\n"
            "Time [s]\tAcc x [m/s²]\tAcc y [m/s²]\n" + TABS, 1.0, id="catman",
        ),
        pytest.param(
            ";Title, X2-2\n;Version, 1, Build date, Jan 1 2020,  SN:CCD\n"
            ";Start_time, 2024-04-21, 15:00:00.000\n;SampleRate, 100,Hz\n;Headers, time,Ax,Ay\n"
            + TABLE, 1.0, id="GCDC",
        ),
        pytest.param(
            "Start date: 2024-04-21\nStart time: 15:00:00\nt [s],a [g],b [g]\n" + TABLE,
            WORTH["g"], id="date and time apart",
        ),
    ],
)  # fmt: skip
def test_the_start_of_a_heading_goes_with_a_clock_that_counts_from_it(read, content, worth):
    record = read(content)
    assert record.start_ns == START_NS
    np.testing.assert_allclose(record.samples, worth * np.column_stack([X, Y]), rtol=1e-9)
    assert any("start by the heading" in said for said in record.assumptions)


@pytest.mark.parametrize(
    "lines",
    [
        "Start time: 2024-04-21 15:00:00\nRecording start: 2024-04-22 15:00:00\n",
        "Export date: 2024-04-21 15:00:00\nCreated: 2024-04-21 15:00:00\n",
        "Start time: 04/05/2024 15:00:00\n",
        "EVENT_DATE_YYYYMMDD: 20240421\nEVENT_TIME_HHMMSS: 150000\n",
    ],
)
def test_times_of_something_else_or_of_two_meanings_are_no_start(read, lines):
    assert read(f"{lines}t [s],a [g],b [g]\n{TABLE}").start_ns is None


def test_a_clock_since_power_on_does_not_count_from_the_start_of_the_heading(read):
    rows = "".join(f"{90_000 + 10 * i},{X[i]}\n" for i in range(ROWS))
    record = read(f"Start time: 2024-04-21 15:00:00\nmillis,ax\n{rows}")
    assert (record.rate_hz, record.start_ns) == (100.0, None)


def test_an_accelerogram_has_the_unit_that_its_heading_states(read):
    wrapped = "".join(
        "".join(f"{v:15.7E}" for v in X[i : i + 5]) + "\n" for i in range(0, ROWS, 5)
    )
    peer = "PEER NGA STRONG MOTION DATABASE RECORD\nA, 1/1/2000, B, 090\n"
    peer += f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  {ROWS}, DT=   .0100 SEC,\n"
    itaca = (
        "EVENT_DATE_YYYYMMDD: 20240420\nDATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS: "
        "20240421_150000.000\nSAMPLING_INTERVAL_S: 0.01\nNDATA: 600\nUNITS: cm/s^2\n"
        "DATA_TYPE: ACCELERATION\n"
    )
    for content, unit, start in (
        (peer + wrapped, "g", None),
        (itaca + "".join(f"{v}\n" for v in X), "cm/s^2", START_NS),
    ):
        record = read(content)
        assert (record.units, record.rate_hz, record.start_ns) == (("m/s^2",), 100.0, start)
        np.testing.assert_allclose(record.samples[:, 0], WORTH[unit] * X, atol=1e-5)


TEKTRONIX = (
    "Record Length,600", "Sample Interval,1.0e-02", "Trigger Point,300", ",", ",", ",",
    "Source,CH1", "Vertical Units,V", "Vertical Scale,5.0e-1", "Horizontal Units,s",
    "Pt Fmt,Y", "Yzero,0.0e0", "Model Number,TDS1002", "Firmware Version,FV:v2.06",
)  # fmt: skip


@pytest.mark.parametrize(
    ("content", "channels"),
    [
        pytest.param(
            "".join(
                f"{TEKTRONIX[i] if i < len(TEKTRONIX) else ','},,{T[i]},{X[i]},\n"
                for i in range(ROWS)
            ),
            ("CH1",), id="Tektronix, settings beside",
        ),
        pytest.param(
            "Model,TPS2024\nVertical Units,V\nHorizontal Units,s\nSample Interval,0.01\n"
            "Record Length,600\nTIME,CH1\n" + "".join(f"{T[i]},{X[i]}\n" for i in range(ROWS)),
            ("CH1",), id="Tektronix, settings above",
        ),
        pytest.param(
            "X,CH1,Start,Increment,\nSequence,Volt,-3.000000e+00,1.000000e-02,\n"
            + "".join(f"{i},{X[i]},,\n" for i in range(ROWS)),
            ("CH1",), id="Rigol",
        ),
        pytest.param(
            "x-axis,1,2\nsecond,Volt,Volt\n" + TABLE, ("1", "2"), id="Keysight",
        ),
        pytest.param(
            '"TOA5","CR1","CR","1234","Std.03","CPU:p.CR1X","5678","Fast"\n'
            '"TIMESTAMP","Ch"\n"TS","V"\n"","Smp"\n'
            + "".join(f'"2024-04-21 15:00:{i / 100:05.2f}",{X[i]}\n' for i in range(ROWS)),
            ("Ch",), id="TOA5 of one channel",
        ),
        pytest.param(
            "Kanal;Zeit;acc_x\nEinheit;s;V\n"
            + "".join(f"{i};{T[i]};{X[i]}\n" for i in range(ROWS)),
            ("acc_x",), id="imc",
        ),
    ],
)  # fmt: skip
def test_oscilloscopes_and_loggers_keep_every_row_and_their_volts(read, content, channels):
    record = read(content)
    assert (record.channels, record.rate_hz) == (channels, 100.0)
    np.testing.assert_array_equal(record.samples[:, 0], X)
    scaled = read(content, sensitivities=["100mV/g"])
    np.testing.assert_allclose(scaled.samples[:, 0], 98.0665 * X)
    assert scaled.units == ("m/s^2",) * len(channels)


def test_slow_columns_are_set_aside_with_a_reason_unless_they_are_kept(read):
    warm = np.cumsum(np.full(ROWS, 1e-3)) + 20
    content = "time,ax,ay,Temp_C,Battery (V)\n" + "".join(
        f"{T[i]},{X[i]},{Y[i]},{warm[i]:.2f},{3.9 - 1e-5 * i:.3f}\n" for i in range(ROWS)
    )
    record = read(content)
    assert record.channels == ("ax", "ay")
    assert any("'Temp_C': slow by its name" in said for said in record.assumptions)
    assert set(record.aux) >= {"Temp_C", "Battery"}
    assert read(content, keep=["Temp_C"]).channels == ("ax", "ay", "Temp_C")
    assert read(content, channels=["Battery"]).channels == ("Battery",)
    alone = "time,Temp_C\n" + "".join(f"{T[i]},{X[i]}\n" for i in range(ROWS))
    assert read(alone).channels == ("Temp_C",)
