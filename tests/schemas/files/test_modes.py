"""The file of modes: what is said of it holds, and what is not one is refused."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from slowtime_schemas.files.modes import ModesFile
from slowtime_schemas.files.registry import DOCUMENTS

MODE = {
    "frequency_hz": {"value": 4.0, "sd": 0.01},
    "damping_ratio": {"value": 0.02, "sd": 0.002},
    "correlation": 0.0,
    "shape": {"re": [0.6, 0.8], "im": [0.0, 0.0], "sd": [0.01, 0.01]},
    "kind": "structural",
    "quality": 0.9,
    "snr_db": None,
    "method": "modes",
    "span_s": [0.0, 60.0],
    "flags": [],
}
HEAD = {
    "slowtime_modes": 1,
    "record": "tower.csv",
    "rate_hz": 50.0,
    "channels": ["a", "b"],
    "duration_s": 60.0,
}
EPOCH = {"start_s": 0.0, "end_s": 10.0, "modes": [MODE]}


def test_what_was_written_first_is_read_for_ever():
    golden = Path(__file__).parents[3] / "schemas/golden/modes_file/v1.json"
    found = ModesFile.model_validate_json(golden.read_bytes())
    assert found.channels == ("floor1", "floor2")
    assert [mode.kind for mode in found.modes or ()] == ["structural", "harmonic", "structural"]


def test_it_is_a_registered_document():
    assert DOCUMENTS["modes_file"] is ModesFile


@pytest.mark.parametrize(
    "body",
    [{"modes": []}, {"modes": [MODE]}, {"window_s": 10.0, "epochs": [EPOCH]}],
)
def test_whole_records_and_windows_are_both_allowed(body):
    assert ModesFile.model_validate(HEAD | body)


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"window_s": 10.0},
        {"epochs": [EPOCH]},
        {"modes": [MODE], "window_s": 10.0, "epochs": [EPOCH]},
    ],
)
def test_half_of_either_or_both_are_refused(body):
    with pytest.raises(ValidationError, match="Give one of the two"):
        ModesFile.model_validate(HEAD | body)


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "machine"},
        {"quality": 1.2},
        {"colour": "red"},
        {"shape": {"re": [1.0, 1.0], "im": [0.0, 0.0], "sd": [0.1, 0.1]}},
    ],
)
def test_a_mode_that_is_none_is_refused(wrong):
    with pytest.raises(ValidationError):
        ModesFile.model_validate(HEAD | {"modes": [MODE | wrong]})
