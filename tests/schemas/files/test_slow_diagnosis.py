"""What a diagnosis in slow time writes, for scripts that read it for years."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from slowtime_schemas.files.registry import DOCUMENTS
from slowtime_schemas.files.slow_diagnosis import SlowDiagnosisFile

GOLDEN = Path(__file__).parents[3] / "schemas/golden/slow_diagnosis_file/v1.json"


def test_the_kept_file_of_the_first_version_is_still_read():
    kept = json.loads(GOLDEN.read_text())
    found = SlowDiagnosisFile.model_validate_json(GOLDEN.read_bytes())
    assert found.model_dump(mode="json") == kept
    assert found.effects[0].effect == "temperature_linear"
    assert DOCUMENTS["slow_diagnosis_file"] is SlowDiagnosisFile


@pytest.mark.parametrize("change", [{"verdict": "maybe"}, {"white_p_value": 1.5}, {"more": 1}])
def test_what_no_diagnosis_would_say_is_refused(change):
    kept = json.loads(GOLDEN.read_text()) | change
    with pytest.raises(ValidationError):
        SlowDiagnosisFile.model_validate_json(json.dumps(kept))
