import re
import tomllib
from pathlib import Path

from slowtime_cli.verbs.tree import VERBS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CHANGELOG.md").read_text()


def test_the_version_of_the_package_is_the_first_section():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    sections = re.findall(r"^## \[(.+?)\] - (\d{4}-\d\d-\d\d|unreleased)$", TEXT, re.MULTILINE)
    assert len(sections) == len(re.findall(r"^## ", TEXT, re.MULTILINE))
    assert sections[0][0] == version


def test_every_command_and_no_other_is_named():
    named = set(re.findall(r"`slowtime ([a-z]+)", TEXT))
    assert named == set(VERBS)


def test_what_it_links_to_is_there():
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXT) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
