"""Ten years of a house in a minute: noticed, named, adopted and undone by the twin alone."""

import json
import os
import subprocess
import sys

import pytest

from tests.system.conftest import free_port

pytestmark = [pytest.mark.system, pytest.mark.slow]

SEED = 2
"""A spring between the ground and a floor, which no element of the model joins."""


def test_a_house_is_watched_through_ten_years_of_weather_faults_and_a_hidden_effect(tmp_path):
    home = tmp_path / "house"
    done = subprocess.run(
        [
            sys.executable, "-m", "slowtime_cli", "demo", "--with", "story", "--duration", "60",
            "--setting", f"seed={SEED}", "--port", str(free_port()), "--data", str(home),
        ],
        capture_output=True, text=True, check=False, cwd=tmp_path, timeout=1_500,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads((home / "story.json").read_text())
    assert told["entered"]["effect"] == "missing_spring"
    assert told["false_alarms_before"] == {"disagreements": 0, "diagnoses": 0}
    assert told["noticed"]["records_after"] < 30
    assert told["named"]["outcome"] in ("named", "undecided with the truth")
    gap = told["gap"]
    assert gap["with_adoption"] < 1.3 * gap["usual"] < 0.3 * gap["without_adoption"]
    kinds = [one["kind"] for one in told["decisions"]]
    assert kinds.count("adopted") == kinds.count("undone") == 2  # a person's mistake, too
    faults = told["faults"]
    assert faults["records_in_history"] == faults["records_measured"] == told["records"]
    assert faults["lost"] == 0
    assert told["hash"]["equal"] is True
    assert "<title>Ten years of a house</title>" in (home / "story.html").read_text()
