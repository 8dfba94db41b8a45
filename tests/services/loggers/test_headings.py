"""Headings as loggers write them: with keys, in sections, again between rows, or cut short."""

import numpy as np
import pytest

from slowtime_services.files import RecordError, read_record

ROWS = 600
X, Y = (
    np.round(np.sin(0.3 * np.arange(ROWS) * f) + np.random.default_rng(f).normal(size=ROWS), 4)
    for f in (1, 2)
)
LABVIEW = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
    "Decimal_Separator\t.\nMulti_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\n"
    "***End_of_Header***\t\n\t\nChannels\t1\t\nSamples\t600\t\nY_Unit_Label\tg\t\n"
    "X_Dimension\tTime\t\nX0\t0.0\t\nDelta_X\t0.01\t\n***End_of_Header***\t\t\n"
    "X_Value\tA0\tComment\n"
)


@pytest.fixture
def read(tmp_path):
    def reading(content, name="file.csv", **given):
        path = tmp_path / name
        path.write_text(content)
        return read_record(path, skip_missing=True, **given)

    return reading


def table(form, rows=range(ROWS)):
    return "".join(form(i) + "\n" for i in rows)


def test_a_key_before_the_names_is_no_name(read):
    heading = ";Title, X2-2\n;SampleRate, 200, Hz\n;Headers, time,Ax,Ay\n"
    record = read(heading + table(lambda i: f"{i / 200:.3f},{X[i]},{Y[i]}"))
    assert record.channels == ("Ax", "Ay")
    assert record.rate_hz == pytest.approx(200)
    np.testing.assert_array_equal(record.samples, np.column_stack([X, Y]))


def test_sections_of_a_heading_keep_names_and_units_on_their_columns(read):
    heading = "*CREATOR\nlogger\n*NAME\nTIME;ACC x;ACC y;\n*UNIT\n;g;g;\n*DATA\n"
    record = read(
        heading + table(lambda i: f"2024-04-21 15:00:{i * 0.02:06.3f};{X[i]};{Y[i]};")
    )
    assert (record.channels, record.units) == (("ACC x", "ACC y"), ("m/s^2",) * 2)
    assert record.rate_hz == pytest.approx(50)


@pytest.mark.parametrize("lost", [0, 7])
def test_a_heading_again_between_rows_is_noted_and_the_clock_shows_what_is_lost(read, lost):
    def form(i):
        return f"{10 * i},{X[i]},{Y[i]}"

    heading = "t_ms,ax,ay\n"
    later = table(form, range(300 + lost, ROWS))
    record = read(heading + table(form, range(300)) + heading + later)
    assert record.rate_hz == pytest.approx(100)
    assert len(record.samples) == ROWS - lost
    assert [gap.missing for gap in record.gaps] == ([lost] if lost else [])
    assert any("heading stands again in line 302" in note for note in record.notes)


def test_a_record_length_without_unit_is_no_duration(read):
    heading = "Horizontal Units,s,\nRecord Length,600,\nSample Interval,4e-4,\n\nTIME,CH1,CH2\n"
    record = read(heading + table(lambda i: f"{i * 4e-4:.6e},{X[i]},{Y[i]}"))
    assert record.rate_hz == pytest.approx(2500)
    assert record.channels == ("CH1", "CH2")


def test_a_labview_heading_cut_anywhere_is_read_rightly_or_refused(read):
    lines = LABVIEW.splitlines(keepends=True)
    body = table(lambda i: f"{i * 0.01:.2f}\t{X[i]}")
    for kept in range(1, len(lines)):
        for content in ("".join(lines[:kept]), "".join(lines[:kept]) + body):
            try:
                record = read(content, "cut.lvm")
            except RecordError:
                continue
            assert record.rate_hz == pytest.approx(100), kept
            assert len(record.samples) == ROWS, kept


def test_tables_that_pandas_writes(tmp_path):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    stamps = pandas.date_range("2024-04-21 15:00", periods=ROWS, freq="10ms", tz="UTC")
    frame = pandas.DataFrame({"ax": X, "ay": Y}, index=stamps)
    for given in ({}, {"sep": ";", "decimal": ","}, {"index_label": "time", "sep": "\t"}):
        path = tmp_path / "frame.csv"
        frame.to_csv(path, **given)
        record = read_record(path)
        assert record.channels == ("ax", "ay")
        assert record.rate_hz == pytest.approx(100)
        assert record.start_ns == stamps[0].value
