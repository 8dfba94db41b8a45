"""The file of a diagnosis: what was written first reads for ever, and JSON can carry it."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_schemas.files.registry import DOCUMENTS

GOLDEN = Path(__file__).parents[3] / "schemas/golden/diagnosis_file/v1.json"


def test_what_was_written_first_is_read_for_ever():
    found = DiagnosisFile.model_validate_json(GOLDEN.read_bytes())
    assert found.verdict == "undecided"
    assert {rival.effect for rival in found.undecided} >= {"sensor_gain", "sensor_drift"}
    assert found.gap.measure == "nrmse"
    assert found.experiment_request == {"level_factor": 2.0}
    assert found.plain() == DiagnosisFile.model_validate(found.plain()).plain()


def test_it_is_a_registered_document():
    assert DOCUMENTS["diagnosis_file"] is DiagnosisFile


@pytest.mark.parametrize(
    ("key", "value"),
    [("verdict", "maybe"), ("white_p_value", 1.5), ("seconds", float("nan")), ("more", 1)],
)
def test_what_no_diagnosis_says_is_refused(key, value):
    body = json.loads(GOLDEN.read_text()) | {key: value}
    with pytest.raises(ValidationError):
        DiagnosisFile.model_validate(body)
