"""Decays of oscillators that another integrator solved: all laws are named, and no others."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.combined_laws.combinations import (
    STIFFNESSES,
    applicable_laws,
    law_sets,
)
from slowtime.discrepancy.combined_laws.search import independent_share
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.imposed_motion.regression import applicable_kinds
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.report.notes import HURRIED, LITTLE
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Description, Node, Sensor, Spring, Tolerance
from slowtime.dynamics.effects import Place, catalogue
from slowtime.dynamics.plant import Plant

DATA = Path(os.environ.get("SLOWTIME_DATA", Path(__file__).parents[5] / "shared/data"))
RATE = 50.0
STIFFNESS = 40.0
VISCOUS = 0.06


def swing():
    """An oscillator of unit inertia, its constants a little off."""
    return Description(
        name="swing",
        nodes=(Node(id="bob", mass_kg=1.0),),
        elements=(
            Spring(
                id="pivot", between=("base", "bob"), stiffness_n_per_m=1.02 * STIFFNESS,
                damping_n_s_per_m=1.2 * VISCOUS,
            ),
        ),
        inputs=(),
        sensors=(
            Sensor(
                channel="angle", quantity="displacement", node="bob", unit="rad",
                frame="relative_to_base",
            ),
        ),
        unit_of_coordinate="rad",
        tolerance=Tolerance(stiffness=0.05, damping=0.5, mass=0.0),
    )  # fmt: skip


def released(
    from_rad, *, sine=False, cubic=0.0, drag=0.0, friction=0.0, offset=0.0, noise=1e-3, seed=0
):
    """Solve for a release until it stands still, and add noise, by default of 60 dB."""

    def rate(_, x):
        spring = STIFFNESS * (np.sin(x[0]) if sine else x[0]) + cubic * x[0] ** 3
        rubs = friction * np.tanh(x[1] / 1e-3)
        return [x[1], -spring - VISCOUS * x[1] - drag * abs(x[1]) * x[1] - rubs]

    t = np.arange(int(14 * RATE)) / RATE
    x = solve_ivp(
        rate, (0, t[-1]), [from_rad, 0.0], t_eval=t, rtol=1e-7, atol=1e-8, method="LSODA"
    ).y[0]
    noises = noise * from_rad * np.random.default_rng(seed).standard_normal(len(t))
    return Trial(inputs=np.zeros((len(t), 0)), outputs=(x + offset + noises)[:, None],
                 rate_hz=RATE)  # fmt: skip


def found(levels, **laws):
    trials = tuple(released(level, seed=i, **laws) for i, level in enumerate(levels))
    held_out = (released(0.7 * levels[0], seed=9, **laws),)
    return diagnose(Campaign(description=swing(), trials=trials, holdout=held_out))


@pytest.mark.long
def test_a_law_that_explains_next_to_nothing_is_no_alternative():
    """Smoothed friction in a simulation without noise differs from dry friction a little."""

    def decay(level):
        t = np.arange(3000) / 100.0

        def rate(_, x):
            return np.array([x[1], -100 * x[0] - 0.2 * x[1] - 0.3 * np.tanh(x[1] / 1e-3)])

        x = solve_ivp(rate, (0, t[-1]), [level, 0.0], t_eval=t, rtol=1e-8, atol=1e-10).y
        return Trial(
            inputs=np.zeros((len(t), 0)), outputs=rate(0, x)[1][:, None], rate_hz=100.0
        )

    given = swing()
    description = dataclasses.replace(
        given,
        elements=(
            dataclasses.replace(
                given.elements[0], stiffness_n_per_m=100.0, damping_n_s_per_m=0.2
            ),
        ),
        sensors=(
            Sensor(channel="a", quantity="acceleration", node="bob", unit="m/s^2"),
        ),
        unit_of_coordinate="m",
        tolerance=Tolerance(),
    )  # fmt: skip
    trials = tuple(decay(level) for level in (0.07, 0.1))
    answer = diagnose(Campaign(description=description, trials=trials, holdout=(decay(0.085),)))
    assert answer.verdict == "missing_effect"
    assert [named.effect.kind for named in answer.effects] == ["coulomb"]


@pytest.mark.parametrize(
    ("laws", "names"),
    [
        ({"sine": True, "friction": 0.15}, {"pendulum_sine", "coulomb"}),
        pytest.param(
            {"sine": True, "drag": 0.02},
            {"pendulum_sine", "quadratic_damping"},
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"cubic": 9.0, "friction": 0.15},
            {"cubic_hardening", "coulomb"},
            marks=pytest.mark.long,
        ),
        ({"drag": 0.03}, {"quadratic_damping"}),
    ],
    ids=["pendulum that rubs", "pendulum in a fluid", "hardening that rubs", "drag"],
)
def test_laws_that_act_together_are_named_together(laws, names):
    diagnosis = found((1.2, 0.6), **laws)
    assert {a.effect.kind for a in diagnosis.effects} == names, diagnosis.sentence
    numbers = {a.effect.kind: a.numbers for a in diagnosis.effects}
    truth = {
        "coulomb": ("friction_n", laws.get("friction")),
        "quadratic_damping": ("c2_n_s2_per_m2", laws.get("drag")),
        "pendulum_sine": ("k", STIFFNESS),
        "cubic_hardening": ("k3_n_per_m3", laws.get("cubic")),
    }
    for name in names:
        number = numbers[name][truth[name][0]]
        assert number.value == pytest.approx(truth[name][1], rel=0.03)
    assert diagnosis.gap.augmented < 2 * diagnosis.gap.noise_floor
    assert all(a.probability > 0.9 for a in diagnosis.effects)


@pytest.mark.long
@pytest.mark.parametrize(("friction", "drag"), [(0.02, 0.0), (0.03, 0.002)])
def test_what_brakes_a_wide_swing_is_named_though_the_sine_explains_nearly_all(friction, drag):
    """Braking is a hundred-thousandth of what is missing, and a hundred times the noise."""
    laws = {"sine": True, "friction": friction, "drag": drag}
    diagnosis = found((1.6, 1.1), noise=1e-4, **laws)
    numbers = {one.effect.kind: one.numbers for one in diagnosis.effects}
    wanted = {"pendulum_sine", "coulomb"} | ({"quadratic_damping"} if drag else set())
    assert set(numbers) == wanted, diagnosis.sentence
    assert numbers["coulomb"]["friction_n"].value == pytest.approx(friction, rel=0.03)
    assert diagnosis.gap.augmented < 2 * diagnosis.gap.noise_floor


@pytest.mark.long
@pytest.mark.data
@pytest.mark.parametrize("begins_s", [(0, 24, 12), (5, 43, 25)], ids=["early", "over all"])
def test_a_measured_pendulum_rubs_and_its_sine_is_not_ruled_out(begins_s):
    """Arm on a bearing, free from 93 degrees: two pieces to learn from, and one held out."""
    path = DATA / "single_pendulum/swing_1kHz.csv"
    if not path.exists():
        pytest.skip(f"no measurement {path.name} beside SLOWTIME_DATA={DATA}")
    angle = np.loadtxt(path, delimiter=",", skiprows=1)[::10, 1:]
    *learn, judge = (
        Trial(
            inputs=np.zeros((1200, 0)), outputs=angle[100 * b : 100 * b + 1200], rate_hz=100.0
        )
        for b in begins_s
    )
    given = swing()
    pivot = dataclasses.replace(
        given.elements[0], stiffness_n_per_m=64.0, damping_n_s_per_m=0.06
    )
    arm = dataclasses.replace(
        given, elements=(pivot,), tolerance=Tolerance(stiffness=0.05, damping=0.9, mass=0.0)
    )
    diagnosis = diagnose(Campaign(description=arm, trials=tuple(learn), holdout=(judge,)))
    named = {one.effect.kind: one.probability for one in diagnosis.effects}
    assert named.keys() >= {"coulomb", "quadratic_damping"}, diagnosis.sentence
    assert named.get("saturating_stiffness", 0.0) < 0.5
    assert "pendulum_sine" in named
    assert diagnosis.gap.augmented < 0.03


@pytest.mark.parametrize("residual", ["noise", "tone"])
def test_few_tones_are_less_evidence_than_as_many_samples_of_noise(residual):
    trial = released(0.5)
    t = np.arange(len(trial.outputs)) / RATE
    noise = np.random.default_rng(1).standard_normal((len(t), 1))
    left = noise if residual == "noise" else np.sin(6.3 * t)[:, None] + 1e-3 * noise
    fit = dataclasses.replace(
        refit(Plant.of(swing()), (trial,)), residual=(left,), silent_above_hz=RATE / 2
    )
    share = independent_share(fit, (trial,))
    assert share > 0.8 if residual == "noise" else share < 0.05


@pytest.mark.parametrize("offset", [0.0, 0.03])
def test_a_linear_decay_lacks_nothing_wherever_the_sensor_reads_zero(offset):
    diagnosis = found((1.2, 0.6), offset=offset)
    assert {a.effect.kind for a in diagnosis.effects} == ({"sensor_bias"} if offset else set())
    for answer in diagnosis.effects:
        assert answer.numbers["bias"].value == pytest.approx(offset, abs=1e-3)


def test_what_one_small_release_cannot_tell_is_undecided_with_a_release_that_would():
    """From 20 degrees the sine and the cubic softening are nearly one curve."""
    trial = released(0.35, sine=True, drag=0.02)
    diagnosis = diagnose(Campaign(description=swing(), trials=(trial,)))
    doubted = {rival.effect for rival in diagnosis.undecided}
    sure = {a.effect.kind for a in diagnosis.effects if a.probability > 0.9}
    assert not sure & {"cubic_softening", "saturating_stiffness"}
    assert "pendulum_sine" in doubted | sure
    if doubted:
        assert diagnosis.experiment is not None
        assert diagnosis.experiment.excitation == "release"
        assert diagnosis.experiment.level > 1


@pytest.mark.long
@pytest.mark.parametrize("hertz", [0.4, 0.93, 2.1])
@pytest.mark.parametrize("offset", [0.0, 0.1])
def test_a_disturbance_of_a_hundredth_of_the_motion_is_no_effect(hertz, offset):
    """Whatever its frequency: the structure lacks nothing, though noise leaves far less."""
    trial = released(0.8, offset=offset)
    shaken = trial.outputs[:, 0] + 0.003 * np.sin(2 * np.pi * hertz * trial.times_s + 1.0)
    trial = Trial(inputs=trial.inputs, outputs=shaken[:, None], rate_hz=RATE)
    answer = diagnose(Campaign(description=swing(), trials=(trial,)))
    assert all(one.effect.kind == "sensor_bias" for one in answer.effects)
    assert answer.verdict in ("nothing_missing", "parameters_only", "sensor_fault")
    if hertz > 0.5:  # below, it is taken for noise of the sensor
        assert LITTLE in answer.notes


@pytest.mark.long
@pytest.mark.parametrize(("fits", "told"), [(2, True), (1000, False)])
def test_a_budget_that_ends_among_the_combinations_is_told(fits, told):
    """Some combinations were fitted, and the best of them is no proof that others are not."""
    campaign = Campaign(
        description=swing(), trials=(released(0.9, sine=True, friction=0.4),),
        holdout=(released(0.6, sine=True, friction=0.4, seed=9),),
    )  # fmt: skip
    begun = []

    def progress(stage, _):
        if stage.startswith("refitting") and stage.endswith("at element pivot"):
            begun.append(stage)

    answer = diagnose(campaign, progress=progress, late=lambda: len(begun) >= fits)
    assert (HURRIED in answer.notes) is told


def test_sets_hold_one_law_of_stiffness_at_most_and_the_smaller_come_first():
    known = (*STIFFNESSES, "quadratic_damping", "coulomb", "bouc_wen")
    sets = list(law_sets(known))
    assert len(sets) == len(set(sets)) == (len(STIFFNESSES) + 1) * 4 - 1
    assert all(len(one & set(STIFFNESSES)) <= 1 for one in sets)
    assert [len(one) for one in sets] == sorted(len(one) for one in sets)
    assert set().union(*law_sets(("coulomb",))) == {"coulomb"}


@pytest.mark.parametrize(
    ("described", "known"), [(chain([1.0], [100.0]), False), (swing(), True)]
)
def test_a_pendulum_is_a_law_of_angles(described, known):
    place = Place("element", described.elements[0].id)
    assert ("pendulum_sine" in applicable_laws(catalogue(), place, described)) == known
    force_laws = {kind.name for kind in applicable_kinds(catalogue(), described)}
    assert ("pendulum_sine" in force_laws) == known
    assert {"cubic_hardening", "coulomb"} <= force_laws


@pytest.mark.long
def test_a_held_out_record_of_larger_motion_contradicts_that_nothing_is_missing():
    small = tuple(released(0.01, sine=True, seed=i) for i in range(2))
    large = (released(1.2, sine=True, seed=9),)
    answer = diagnose(Campaign(description=swing(), trials=small, holdout=large))
    assert answer.verdict == "nothing_missing"
    assert answer.gap.augmented > 0.2
    assert "the held-out record contradicts the model" in answer.sentence
    assert "Fit that record too" in answer.sentence
    alike = (released(0.008, sine=True, seed=8),)
    agreed = diagnose(Campaign(description=swing(), trials=small, holdout=alike))
    assert "contradicts" not in agreed.sentence
