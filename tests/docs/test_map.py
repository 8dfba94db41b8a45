import re
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


def test_every_path_on_the_map_exists():
    text = (ROOT / "docs/map.md").read_text()
    named = re.findall(r"`([\w./]+(?:/|\.py))`", text)
    # Files of the diagnosis are named from its own folder, as the map says.
    bases = (ROOT, ROOT / "slowtime/discrepancy")
    assert len(named) > 200
    assert [name for name in named if not any((base / name).exists() for base in bases)] == []


def test_every_link_of_the_map_exists():
    text = (ROOT / "docs/map.md").read_text()
    links = re.findall(r"\]\(([^)#]+)", text)
    assert links
    assert [link for link in links if not (ROOT / "docs" / link).exists()] == []
