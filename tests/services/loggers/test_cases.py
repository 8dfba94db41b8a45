"""Inputs that were once read wrongly, kept beside the measurements, are read rightly."""

import os
from pathlib import Path

import pytest

from slowtime_services.files import RecordError, read_record

FOLDER = Path(os.environ.get("SLOWTIME_DATA", "../shared/data")).parent / "cases"
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"no folder of cases beside the measurements: {FOLDER}"
)


@pytest.mark.parametrize(
    ("name", "rate_hz", "channels", "dated"),
    [
        ("readers/01/one.knet", 100.0, ("N-S",), True),
        ("readers/03/us.csv", 100.0, ("ax", "ay"), False),
        ("readers/03/ms.csv", 100.0, ("ax", "ay"), False),
        ("readers/03/ns.csv", 100.0, ("ax", "ay"), False),
        ("readers/03/paren.csv", 100.0, ("ax",), False),
        ("readers/05/khz.csv", 2500.0, ("ax", "ay"), False),
        ("readers/05/khz2.csv", 25600.0, ("ax", "ay"), False),
        ("readers/05/thousand.csv", 1000.0, ("ax", "ay"), False),
        ("readers/05/adc.csv", 100.0, ("ax", "ay"), False),
        ("readers/07/nox.lvm", 100.0, ("Response 1", "Response 2"), False),
        ("readers/11/iso.csv", 100.0, ("ax", "ay"), True),
        ("readers/11/toa5.csv", 100.0, ("ax", "ay"), True),
        ("readers/11/tspair.txt", 100.0, ("XX_XXX__BHZ_R",), True),
        ("real/accel.v2", 100.0, ("acceleration",), False),
        ("real/accel_cut.v2", 100.0, ("acceleration",), False),
    ],
)
def test_it_is_read_as_it_is(name, rate_hz, channels, dated):
    record = read_record(FOLDER / name)
    assert (record.rate_hz, record.channels) == (rate_hz, channels)
    assert (record.start_ns is not None) is dated


def test_counters_and_magnitudes_are_no_sensors():
    counted = read_record(FOLDER / "readers/08/count.csv", rate_hz=100.0)
    assert counted.channels == ("a_x", "a_y", "a_z")
    record = read_record(FOLDER / "readers/10/absolute.csv")
    assert record.channels == tuple(f"Linear Acceleration {axis}" for axis in "xyz")


def test_bursts_are_refused_with_their_figures():
    with pytest.raises(RecordError, match=r"bursts: 8 samples .* 100 Hz on average"):
        read_record(FOLDER / "readers/15/burst.csv")


def test_one_column_without_a_clock_is_read_at_the_rate_that_is_given():
    record = read_record(FOLDER / "real/lines.csv", rate_hz=800.0)
    assert (record.channels, record.rate_hz) == (("acc",), 800.0)
