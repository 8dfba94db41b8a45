"""The build context of the container image has all that the Dockerfile copies and installs."""

import shlex
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def copied() -> list[str]:
    """Sources of the lines COPY of the Dockerfile, as paths in the repository."""
    lines = (ROOT / "services/docker/Dockerfile").read_text().splitlines()
    copies = [shlex.split(line) for line in lines if line.startswith("COPY ")]
    return [source for _, *sources, _ in copies for source in sources]


def admitted() -> list[str]:
    """Exceptions of `.dockerignore`, which leaves out everything else."""
    first, *others = (ROOT / ".dockerignore").read_text().split()
    assert first == "**"
    return [pattern[1:] for pattern in others if pattern.startswith("!")]


@pytest.mark.parametrize("source", copied())
def test_what_the_image_copies_is_in_the_build_context(source):
    path = Path(source)
    assert (ROOT / path).exists()
    assert {str(path), *map(str, path.parents)} & set(admitted())


def test_every_package_of_the_wheel_is_copied():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for package in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        path = Path(package)
        assert {str(path), *map(str, path.parents)} & set(copied())
