"""Hidden oscillators that the records do not tell from a mass are named as one."""

import dataclasses

import numpy as np
import pytest
import scipy.signal

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.estimation.model_evidence import evidence
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.quoting import numbers_of, quoted
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refinement.limit_laws import name_limits
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.three_mass_chain import EVERY

KINDS = catalogue()
NODE = Place("node", "m2")
RATE, TOP_HZ = 200.0, 8.0
"""Sampling rate, and highest frequency of the force [Hz]: above the three modes."""
RIDER = {"mass_kg": 0.3, "frequency_hz": 60.0, "damping_n_s_per_m": 40.0}
FAST = Effect("extra_dof", NODE, RIDER)


def accelerations(mass_kg, rider, push, start=None):
    """Integrate the chain with `scipy.signal.lsim`, heavier at m2, or with a mass on it.

    Give the accelerations, and the state at the end.
    """
    masses, stiffness, damping = np.array([2.0, 1.5, 1.0]), np.zeros((3, 3)), np.zeros((3, 3))
    masses[1] += mass_kg
    for i, (k, c) in enumerate([(900.0, 1.6), (700.0, 1.2), (500.0, 1.0)]):
        row = np.eye(3)[i] - (np.eye(3)[i - 1] if i else 0.0)
        stiffness += k * np.outer(row, row)
        damping += c * np.outer(row, row)
    if rider is not None:
        m, hertz, c = rider
        tie = np.outer([0, 1, 0, -1], [0, 1, 0, -1])
        stiffness = np.pad(stiffness, (0, 1)) + m * (2 * np.pi * hertz) ** 2 * tie
        damping, masses = np.pad(damping, (0, 1)) + c * tie, np.append(masses, m)
    size = len(masses)
    speeds = -np.hstack([stiffness, damping]) / masses[:, None]
    load = np.zeros((2 * size, 1))
    load[size + 2] = 1 / masses[2]
    whole = np.vstack([np.eye(size, 2 * size, size), speeds])
    system = (whole, load, speeds[:3], load[size : size + 3])
    _, found, states = scipy.signal.lsim(system, push, np.arange(len(push)) / RATE, start)
    return found, states[-1]


def gained_at(row, mass_kg, push):
    """Integrate the chain, heavier at m2 from a row on."""
    before, state = accelerations(0.0, None, push[: row + 1])
    after, _ = accelerations(mass_kg, None, push[row:], state)
    return np.concatenate((before[:-1], after))


def recorded(mass_kg=0.0, rider=None, noise_share=0.01, gained=0):
    rng = np.random.default_rng(3)
    filtered = scipy.signal.butter(6, TOP_HZ, fs=RATE, output="sos")
    push = 8.0 * scipy.signal.sosfiltfilt(filtered, rng.standard_normal(4000))
    clean, _ = accelerations(mass_kg, rider, push)
    if gained:
        clean = gained_at(gained, mass_kg, push)
    noise = noise_share * clean.std(axis=0) * rng.standard_normal(clean.shape)
    held = dataclasses.replace(EVERY.inputs[0], hold="first")
    described = dataclasses.replace(EVERY, inputs=(held,))
    return described, (Trial(inputs=push[:, None], outputs=clean + noise, rate_hz=RATE),)


def hypothesis(described, trials, effect, rivals=()):
    """Give the hypothesis of a search that took an effect."""
    bare = refit(Plant.of(described, kinds=KINDS), trials)
    more = dataclasses.replace(described, effects=(effect.entry(),))
    fit = refit(Plant.of(more, kinds=KINDS), trials)
    named = quoted(effect, numbers_of(fit, 0), KINDS[effect.kind], 0.7, rivals)
    return Hypothesis((bare, fit), trials, (named,))


def test_an_oscillator_that_is_faster_than_the_records_is_named_as_a_mass():
    rivals = (Rival("added_mass", NODE, 0.25), Rival("stiffness_loss", NODE, 0.05))
    described, trials = recorded(mass_kg=0.3)
    before = hypothesis(described, trials, FAST, rivals)
    after = name_limits(before, KINDS)
    (named,) = after.effects
    assert (named.effect.kind, named.effect.place) == ("added_mass", NODE)
    assert named.family == "linear mass"
    (number,) = named.numbers.values()
    assert number.value == pytest.approx(0.3, abs=3 * number.sd)
    assert number.sd < 0.01
    assert named.probability == pytest.approx(0.95)
    assert named.rivals == rivals[1:]
    assert [one.effect.kind for one in after.nested] == ["extra_dof"]
    assert after.fits[0] is before.first
    assert [one.kind for one in after.last.plant.effects] == ["added_mass"]


def test_an_oscillator_that_rings_within_the_records_stays_one():
    described, trials = recorded(rider=(0.3, 5.0, 0.6))
    slow = Effect("extra_dof", NODE, {**RIDER, "frequency_hz": 5.2, "damping_n_s_per_m": 0.8})
    before = hypothesis(described, trials, slow)
    assert name_limits(before, KINDS) is before


def test_an_oscillator_stays_one_where_its_mass_alone_leaves_more_than_noise():
    """At 2.5 times the highest frequency of the force, it moves up to a fifth more."""
    described, trials = recorded(rider=(0.3, 2.5 * TOP_HZ, 3.0))
    near = Effect("extra_dof", NODE, {**RIDER, "frequency_hz": 18.0, "damping_n_s_per_m": 4.0})
    before = hypothesis(described, trials, near)
    assert name_limits(before, KINDS) is before


def test_what_it_does_beyond_its_mass_has_to_be_a_thousandth_of_what_was_missing():
    """By exact sensors the evidence tells it from a mass, as it would of any small flaw."""
    described, trials = recorded(rider=(0.3, 60.0, 9.0), noise_share=3e-4)
    before = hypothesis(described, trials, FAST)
    after = name_limits(before, KINDS)
    assert evidence(before.last, KINDS) > evidence(after.last, KINDS) + 6.0
    (named,) = after.effects
    assert named.effect.kind == "added_mass"
    assert named.effect.parameters["dm_kg"] == pytest.approx(0.3, rel=0.02)


JUMP = Effect("mass_jump", NODE, {"dm_kg": 0.25, "t_jump_s": 0.1})


def test_a_mass_that_jumps_as_the_record_begins_was_there_all_along():
    described, trials = recorded(mass_kg=0.3)
    after = name_limits(hypothesis(described, trials, JUMP), KINDS)
    (named,) = after.effects
    assert (named.effect.kind, named.effect.place) == ("added_mass", NODE)
    (number,) = named.numbers.values()
    assert number.value == pytest.approx(0.3, abs=3 * number.sd)


def test_a_mass_that_jumps_within_the_record_jumps():
    described, trials = recorded(mass_kg=0.3, gained=800)
    later = Effect("mass_jump", NODE, {"dm_kg": 0.25, "t_jump_s": 4.0})
    before = hypothesis(described, trials, later)
    assert name_limits(before, KINDS) is before


def test_of_other_kinds_nothing_is_tried_instead():
    described, trials = recorded(mass_kg=0.3)
    before = hypothesis(described, trials, Effect("added_mass", NODE, {"dm_kg": 0.2}))
    assert name_limits(before, KINDS) is before
