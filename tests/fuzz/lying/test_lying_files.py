"""Each lying file is refused with a reason, for little more than an honest file costs."""

import functools
import tempfile
from pathlib import Path

import pytest

from tests.slowtime_cli.broken_inputs import INTERNALS

from . import models, records
from .cases import Case
from .measure import Cost, cost_of

MOST_S, MOST_MIB = 2.0, 100.0
"""Processor time and memory that a lying file may take beyond an honest one of its kind."""
AWAY = "did not answer"
"""What is said of an honest file that goes to a server, which is not there."""
LIBRARIES = {
    ".h5": "h5py", ".xlsx": "openpyxl", ".tdms": "nptdms", ".uff": "pyuff", ".mseed": "obspy",
    ".sac": "obspy", ".gcf": "obspy", ".sg2": "obspy", ".parquet": "pyarrow",
    ".arrow": "pyarrow", ".mcap": "mcap_ros2",
}  # fmt: skip
CASES = [*records.CASES, *models.CASES]


@functools.cache
def honest(case_of: Case) -> Cost:
    return _cost(case_of, case_of.honest)


def _cost(case: Case, make: object) -> Cost:
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder) / case.file)  # type: ignore[operator]  # one of the case's makers
        words = [word.replace("{file}", case.file) for word in case.command]
        return cost_of(words, Path(folder))


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_lying_file_is_refused_for_little_more_than_an_honest_one_costs(case):
    if (library := LIBRARIES.get(Path(case.file).suffix)) is not None:
        pytest.importorskip(library)
    kind = Case("honest", case.file, case.honest, case.honest, case.command)
    usual, lying = honest(kind), _cost(case, case.lying)
    assert usual.status == 0 or AWAY in usual.said, usual
    assert AWAY not in lying.said, lying
    assert lying.status == 2 or (case.harmless and lying.status == 0), lying
    assert lying.processor_s - usual.processor_s < MOST_S, (lying, usual)
    assert lying.peak_mib - usual.peak_mib < MOST_MIB, (lying, usual)
    assert lying.said.strip()
    assert not INTERNALS.search(lying.said), lying.said
