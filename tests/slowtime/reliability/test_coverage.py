"""Intervals hold the truth as often as they say; statistics over hundreds of runs."""

import numpy as np
import pytest

from tests.slowtime.reliability.coverage import SAMPLERS, report, run
from tests.slowtime.reliability.problems import RP, every, references


def test_every_problem_of_the_challenge_has_a_reference_to_three_digits():
    known = references()
    assert set(RP) <= set(known)
    assert len(RP) == 23
    # As published; RP53, RP60 and RP91 there to three digits, the others checked by several.
    published = {"RP22": 0.0042073, "RP75": 0.0098193, "RP107": 2.867e-7, "RP111": 7.65e-7}
    for name, value in published.items():
        assert known[name] == pytest.approx(value, rel=2e-3), name


@pytest.mark.slow
@pytest.mark.parametrize("method", SAMPLERS)
def test_pooled_intervals_hold_the_truth_in_93_to_97_of_100_runs(method):
    known = {
        name: one
        for name, one in every().items()
        if method != "monte-carlo" or one.exact >= 3e-4
    }
    cells = [run(method, name, one, 100) for name, one in known.items()]
    silent = [cell.held[~cell.warned] for cell in cells]
    assert 0.93 <= np.mean(np.concatenate(silent)) <= 0.97, report(cells)
    assert all(cell.silent_share >= 0.85 for cell in cells), report(cells)
    assert sum(cell.unsafe for cell in cells) <= 3 + 3 * sum(c.by_chance for c in cells)
