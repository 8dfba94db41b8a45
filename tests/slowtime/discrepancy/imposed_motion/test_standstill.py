"""Standstills of an imposed motion tell nothing, and are no fault of a sensor."""

import numpy as np
import pytest

from slowtime.discrepancy.data.screening import screen
from slowtime.discrepancy.imposed_motion.records import force_record, rig_of
from slowtime.discrepancy.imposed_motion.standstill import informative, without_standstills
from slowtime.discrepancy.records import Trial
from tests.slowtime.discrepancy.imposed_motion.rigs import RATE, RIG


def rested(seconds=2.0, dwell=0.0):
    """Sine that begins from rest at its lower end, and may dwell at the upper one."""
    t = np.arange(int(12 * RATE)) / RATE
    wave = -np.cos(2 * np.pi * 0.4713 * t) * np.exp(-0.01 * t)
    top = int(np.argmax(wave[: int(1.5 * RATE)]))
    held = np.full(int(dwell * RATE), wave[top])
    moved = np.concatenate([wave[:top], held, wave[top:]])
    return np.concatenate([np.full(int(seconds * RATE), wave[0]), moved])


def recorded(e, force):
    return Trial(inputs=force[:, None], outputs=e[:, None], rate_hz=RATE)


def left_over(trial):
    rig = rig_of(RIG)
    assert rig is not None
    found = screen(trial, ["x"]).findings
    return found, without_standstills(found, [force_record(rig, trial)])


@pytest.mark.parametrize("dwell", [0.0, 1.5])
def test_rest_before_the_start_or_at_an_end_is_no_stuck_sensor(dwell):
    e = rested(dwell=dwell)
    force = 3.0 * np.sign(np.gradient(e)) + 0.01 * np.random.default_rng(1).normal(size=len(e))
    force[: int(2 * RATE)] = -1.0 + 0.01 * np.random.default_rng(2).normal(size=int(2 * RATE))
    if dwell:
        still = np.flatnonzero(np.abs(np.gradient(e)) == 0)
        later = still[still > 2.5 * RATE]
        force[later[0] - 2 : later[-1] + 3] = 2.0
    found, left = left_over(recorded(e, force))
    assert any(one.fault == "stuck" for one in found)
    assert not left


def test_a_sensor_that_is_stuck_while_the_force_goes_on_stays_a_finding():
    e = rested(seconds=0.0)
    force = 5.0 * e + 0.01 * np.random.default_rng(1).normal(size=len(e))
    e[500:620] = e[500]
    found, left = left_over(recorded(e, force))
    assert found
    assert left == found


def test_standstill_first_path_and_turns_of_the_rate_are_not_informative():
    rig = rig_of(RIG)
    assert rig is not None
    e = rested()
    kept = informative(force_record(rig, recorded(e, e)).motion)
    assert not kept[: int(2 * RATE)].any()
    after = int(2.5 * RATE)
    assert np.mean(kept[after:]) > 0.9
    turns = np.flatnonzero(np.diff(np.sign(np.diff(e[after:])))) + after + 1
    assert not kept[turns].any()
