import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def tracked_folders() -> set[str]:
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout, so what belongs to the project cannot be told")
    return {
        str(parent) + "/"
        for name in listed.stdout.splitlines()
        for parent in Path(name).parents
        if str(parent) != "."
    }


def test_the_map_names_every_folder():
    text = (ROOT / "docs/map.md").read_text()
    # A message's folder and the mirror under tests/ are named by their rule.
    by_rule = ("schemas/json/", "schemas/golden/", "tests/")
    missing = [
        folder
        for folder in sorted(tracked_folders())
        if f"`{folder}`" not in text and not any(folder.startswith(rule) for rule in by_rule)
    ]
    assert missing == []


def test_every_folder_on_the_map_exists():
    named = [
        cell.split("`")[1]
        for cell in (ROOT / "docs/map.md").read_text().splitlines()
        if cell.startswith("| `")
    ]
    assert named
    assert [folder for folder in named if not (ROOT / folder).is_dir()] == []
