"""The example of docs/assessment.md runs as it stands, and says what the page says."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import slowtime as st

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "assessment.md").read_text()


@pytest.mark.long
def test_the_example_names_the_column_that_was_made_softer(tmp_path):
    (tmp_path / "two_storeys.yaml").write_text((DOCS / "examples/two_storeys.yaml").read_text())
    typed = "\n".join(re.findall(r"^ {4}(.*)$", PAGE, re.MULTILINE))
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", typed],
        cwd=tmp_path,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (told,) = re.findall(r"^> (.*)$", PAGE, re.MULTILINE)
    assert told in done.stderr
    limits = [line.split("\t") for line in done.stdout.splitlines() if "\tmember\t" in line]
    losses = [float(line[2]) for line in limits if len(line) == 4]
    assert len(losses) == 16
    assert 0.035 < min(losses) < max(losses) < 0.085
    states = [tmp_path / name for name in ("healthy.json", "today.json")]
    found = st.assess(tmp_path / "two_storeys.yaml", *states)
    assert found.sentence == json.loads((tmp_path / "assessed.json").read_text())["sentence"]
    assert found.sentence == told
    assert "Members in space" in (tmp_path / "assessed.html").read_text()
