"""The table of formats is what the registry makes; units that are named are understood."""

import re
import runpy
from pathlib import Path

from slowtime_services.files.units import sensitivity_of, unit_of

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/files.md").read_text()


def test_the_table_of_formats_is_made_from_the_registry():
    made = runpy.run_path(str(ROOT / "docs/figures/formats.py"))
    assert made["renewed"](TEXT) == TEXT, "run python docs/figures/formats.py"
    assert made["table"]() in TEXT


def test_units_and_sensitivities_that_are_named_are_understood():
    (units,) = re.findall(r"^Accelerations in (.*?) are converted", TEXT, re.M | re.S)
    named = re.findall(r"`([^`]+)`", units)
    assert len(named) >= 8
    assert all(unit_of(unit) is not None for unit in named)
    given = re.findall(r"--reading sensitivity='?(?:\w+=)?([^\s`']+)", TEXT)
    assert len(given) >= 2
    for text in given:
        sensitivity_of(text)
