"""Of files as many loggers write them, none is read wrongly, and few need a person."""

import warnings

import numpy as np
import pytest

from slowtime_services.files import Record, RecordError, read_record
from tests.services.loggers.made import Case
from tests.services.loggers.table import cases

MOST_ASKED = 0.1
"""Share of files about which a person is asked."""
WORTH = {"g": 9.80665, "mg": 9.80665e-3, "cm/s^2": 1e-2}
"""Of units that are turned into m/s^2."""
START_NS = 20_000_000
"""A start that differs by less is the same [ns]: a day in ten digits has 9 µs."""


def faults(case: Case, record: Record) -> list[str]:
    """What of a record is not so."""
    found = []
    if abs(record.rate_hz / case.rate_hz - 1) > case.loose:
        found.append(f"{record.rate_hz} Hz, not {case.rate_hz}")
    if record.channels != case.channels:
        return [*found, f"channels {record.channels}, not {case.channels}"]
    if record.samples.shape != case.samples.shape:
        return [*found, f"{record.samples.shape} samples, not {case.samples.shape}"]
    worth = np.array([WORTH.get(unit, 1.0) for unit in case.units])
    if np.abs(record.samples / worth - case.samples).max() > 2e-5:
        found.append("other samples")
    units = tuple("m/s^2" if u in WORTH else u.replace("²", "^2") for u in case.units)
    if record.units != units:
        found.append(f"units {record.units}, not {units}")
    if sum(gap.missing for gap in record.gaps) != case.gaps:
        found.append(f"gaps {record.gaps}, not {case.gaps}")
    told, right = record.start_ns, case.start_ns
    if told is None or right is None:
        same = told is right
    else:
        same = abs(told - right) <= START_NS
    if not same:
        found.append(f"start {told}, not {right}")
    return found


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Each case with its record, or the question that is asked."""
    folder = tmp_path_factory.mktemp("loggers")
    found: list[tuple[Case, Record | str]] = []
    for number, case in enumerate(cases()):
        path = folder / f"{number}{case.suffix}"
        path.write_bytes(case.content)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                found.append((case, read_record(path, skip_missing=True)))
            except RecordError as error:
                found.append((case, str(error)))
    return found


@pytest.mark.gate
def test_no_file_is_read_wrongly(answers):
    assert len(answers) >= 150
    wrong = {
        case.name: said
        for case, record in answers
        if isinstance(record, Record) and (said := faults(case, record))
    }
    assert wrong == {}


def test_few_files_need_a_person(answers):
    asked = {case.name: said for case, said in answers if isinstance(said, str)}
    assert len(asked) <= MOST_ASKED * len(answers), asked


def test_a_question_names_a_way_to_answer_it(answers):
    for case, said in answers:
        if isinstance(said, str):
            assert "--" in said, case.name
