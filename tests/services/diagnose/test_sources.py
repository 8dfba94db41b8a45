"""Records of a diagnosis are read as those of an identification are."""

import numpy as np
import pytest
from click.testing import CliRunner

from slowtime_cli.verbs.models.diagnose import diagnose
from slowtime_services.diagnose.sources import read_any


@pytest.mark.parametrize(("unit", "rate"), [("ms", 100.0), ("us", 100_000.0)])
def test_the_unit_of_a_clock_can_be_told(tmp_path, unit, rate):
    path = tmp_path / "run.csv"
    force = np.random.default_rng(1).normal(size=400).round(4)
    path.write_text("clock,f\n" + "".join(f"{10 * i},{f}\n" for i, f in enumerate(force)))
    source = read_any(path, time_column="clock", time_unit=unit)
    assert source.record.rate_hz == pytest.approx(rate)


def test_what_a_file_leaves_open_can_be_told_on_the_command_line():
    said = CliRunner().invoke(diagnose, ["--help-all"]).output
    for flag in ("time_unit=", "date_order=", "wrapped=[yes|no]"):
        assert flag in said
