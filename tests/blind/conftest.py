"""A small battery, made once: one case of each group, and a few more."""

import dataclasses
from pathlib import Path

import pytest

from tests.blind.cases import Case, build, draw_cases
from tests.blind.design import Design
from tests.blind.files import write_case

SEED = 20
collect_ignore = ["pysindy_peer.py"]  # its package is in an environment of its own


def short_cases(seed: int = SEED) -> list[tuple[str, Design, int]]:
    """Four cases of short records."""
    return [
        (name, dataclasses.replace(design, seconds=(5.0, 8.0)), own)
        for name, design, own in draw_cases(4, seed)
    ]


@pytest.fixture(scope="session")
def battery(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Case]]:
    """Folder of the battery, and its cases by name."""
    out = tmp_path_factory.mktemp("battery")
    cases = [build(*one) for one in short_cases()]
    for case in cases:
        write_case(case, out)
    return out, {case.name: case for case in cases}
