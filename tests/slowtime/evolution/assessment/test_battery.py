"""A hundred damaged and a hundred sound frames of another library, as the plan promised."""

import numpy as np
import pytest

from slowtime.evolution.assessment import (
    AssessmentSettings,
    assess,
    expected_modes,
    plan_limits,
)
from slowtime.evolution.assessment.assessment import Comparison
from slowtime.evolution.assessment.detection_limits import members_alike
from tests.slowtime.evolution.assessment.pyfe3d_frames import Truth

CASES = 100
FRAME = Truth(storeys=4)
"""32 members; 8 modes at 32 channels, frequencies to 0.1 % and shapes to 1 %."""

pytestmark = pytest.mark.long


def drawn(seed):
    """One to three members, and losses of 5 to 30 % of their stiffness."""
    random = np.random.default_rng(20_000 + seed)
    names = random.choice(FRAME.names, 1 + seed % 3, replace=False).tolist()
    return dict(zip(names, random.uniform(0.05, 0.3, len(names)).tolist(), strict=True))


def test_damaged_members_are_in_the_named_sets():
    structure, channels = FRAME.model
    expected = expected_modes(structure, channels, FRAME.modes)
    promised = {one.name: one.loss for one in plan_limits(structure, expected)}
    nominal = Comparison(structure, expected, expected, AssessmentSettings())
    large = named = size = alike = 0
    for seed in range(CASES):
        losses = drawn(seed)
        found = assess(structure, *FRAME.states(losses, 30_000 + seed))
        told = {one.name for group in found.sets for one in group.suspects}
        size += sum(len(group.suspects) for group in found.sets)
        for name, loss in losses.items():
            which = FRAME.names.index(name)
            large += loss >= promised[name]
            named += loss >= promised[name] and name in told
            if name in told:
                alike += 1 + len(members_alike(nominal.model, nominal.test, which, loss))
    print(f"{named} of {large} named; {size} suspects, {alike} not told apart")
    assert large > CASES
    assert named >= 0.9 * large
    assert size <= 1.5 * alike


def test_sound_frames_raise_no_more_alarms_than_stated():
    structure, _ = FRAME.model
    verdicts = [assess(structure, *FRAME.states({}, 10_000 + k)).verdict for k in range(CASES)]
    print(f"{CASES - verdicts.count('unchanged')} false alarms")
    assert CASES - verdicts.count("unchanged") <= 0.05 * CASES


def test_two_columns_of_32_members_are_found():
    structure, _ = FRAME.model
    likeliest = 0
    for seed in range(5):
        losses = {"column 1.0": 0.3, "column 2.2": 0.2}
        found = assess(structure, *FRAME.states(losses, 40_000 + seed))
        sets = [[one.name for one in group.suspects] for group in found.sets]
        assert sets[0] == ["column 1.0"]
        assert any("column 2.2" in names for names in sets[1:])
        likeliest += sets[1][0] == "column 2.2"
    assert likeliest >= 4
