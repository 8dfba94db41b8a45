"""The conda recipe says the same as pyproject.toml, and holds only keys of its format."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from release.build import PACKAGES

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = yaml.safe_load((ROOT / "release/conda/recipe.yaml").read_text())
KEYS = {
    "schema_version", "context", "package", "source", "build", "requirements", "tests", "about",
    "extra",
}  # fmt: skip
"""Keys of a recipe of one package, in the first version of the format."""
CONDA_NAMES = {"uvicorn[standard]": "uvicorn-standard"}
"""Requirement as PyPI names it → name of the conda package."""


def rendered(text):
    return re.sub(r"\$\{\{ (\w+) \}\}", lambda found: RECIPE["context"][found[1]], text)


def required(extra):
    """Requirements of an extra, without those that name other extras of slowtime."""
    found = set()
    for line in PROJECT["optional-dependencies"][extra]:
        if line.startswith("slowtime["):
            for other in line.removeprefix("slowtime[").rstrip("]").split(","):
                found |= required(other)
        else:
            found.add(line)
    return found


def as_conda(line):
    found = re.fullmatch(r"([\w.-]+(?:\[\w+\])?)(.*)", line)
    assert found is not None, line
    name, bounds = found.groups()
    return f"{CONDA_NAMES.get(name, name).lower()} {bounds}"


def test_its_keys_are_those_of_the_format():
    assert set(RECIPE) <= KEYS
    assert RECIPE["schema_version"] == 1
    assert set(RECIPE["requirements"]) <= {"build", "host", "run", "run_constraints"}
    assert all(
        len(test) == 1 or set(test) <= {"script", "requirements"} for test in RECIPE["tests"]
    )


def test_name_version_python_and_license_are_those_of_the_project():
    assert RECIPE["package"]["name"] == PROJECT["name"]
    assert rendered(RECIPE["package"]["version"]) == PROJECT["version"]
    assert f">={RECIPE['context']['python_min']}" == PROJECT["requires-python"]
    assert RECIPE["about"]["license"] == PROJECT["license"]
    assert RECIPE["about"]["summary"] == PROJECT["description"]
    assert (ROOT / RECIPE["about"]["license_file"]).is_file()
    assert (ROOT / "release/conda" / RECIPE["source"]["path"] / "pyproject.toml").is_file()


def test_it_requires_what_the_extra_all_installs():
    stated = {rendered(line) for line in RECIPE["requirements"]["run"]}
    needed = {as_conda(line) for line in {*PROJECT["dependencies"], *required("all")}}
    assert stated == needed | {f"python {PROJECT['requires-python']}"}
    assert "hatchling" in RECIPE["requirements"]["host"]


def test_commands_and_packages_are_those_of_the_wheel():
    stated = dict(line.split(" = ") for line in RECIPE["build"]["python"]["entry_points"])
    assert stated == PROJECT["scripts"]
    assert tuple(RECIPE["tests"][0]["python"]["imports"]) == PACKAGES


@pytest.mark.parametrize("line", ["numpy>=2.0", "uvicorn[standard]>=0.40", "PyYAML>=6.0"])
def test_requirements_are_written_as_conda_writes_them(line):
    assert as_conda(line) in RECIPE["requirements"]["run"]
