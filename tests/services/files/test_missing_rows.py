"""Rows without values: those around a shorter table, and those within a record."""

import numpy as np
import pytest

from slowtime_services.files.record import RecordError
from slowtime_services.files.record_reader import read_record


def two_tables(path, short=120, long=200):
    """Two tables beside each other in one sheet, each with a clock of its own."""
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal(short), rng.standard_normal(long)
    lines = ["t1,first,,t2,second"]
    for k in range(long):
        left = f"{0.05 * k:.3f},{a[k]:.6f}" if k < short else ","
        lines.append(f"{left},,{0.04 * k:.3f},{b[k]:.6f}")
    path.write_text("\n".join(lines) + "\n")
    return path, a, b


def test_empty_rows_after_a_shorter_table_are_no_missing_values(tmp_path):
    path, first, second = two_tables(tmp_path / "two.csv")
    shorter = read_record(path, channels=("first",), time_column="t1", skip_missing=True)
    assert shorter.rate_hz == pytest.approx(20.0)
    np.testing.assert_allclose(shorter.samples[:, 0], first, atol=1e-6)
    assert not shorter.gaps
    longer = read_record(path, channels=("second",), time_column="t2", skip_missing=True)
    assert longer.rate_hz == pytest.approx(25.0)
    np.testing.assert_allclose(longer.samples[:, 0], second, atol=1e-6)


def test_a_channel_that_ends_early_beside_others_is_still_refused(tmp_path):
    path, _, _ = two_tables(tmp_path / "two.csv")
    with pytest.raises(RecordError, match=r"in 40 % of its rows a value is missing"):
        read_record(path, channels=("first", "second"), time_column="t2", skip_missing=True)


@pytest.mark.parametrize("clock", [True, False])
def test_a_record_whose_first_rows_are_empty_starts_at_the_first_that_is_not(tmp_path, clock):
    rows = np.random.default_rng(7).standard_normal(200)
    lines = [
        "Start time: 2024-04-21 15:00:00",
        "Sampling rate: 10 Hz",
        "t,x,y" if clock else "x,y",
    ]
    for k, value in enumerate(rows):
        cells = ["NaN", "NaN"] if k < 20 else [f"{value:.6f}", f"{value / 2:.6f}"]
        lines.append(",".join([f"{0.1 * k:.1f}"] * clock + cells))
    path = tmp_path / "late.csv"
    path.write_text("\n".join(lines) + "\n")
    record = read_record(path, skip_missing=True)
    assert (record.rate_hz, len(record.samples)) == (10.0, 180)
    assert record.start_ns == 1_713_711_600_000_000_000 + 2 * 10**9
