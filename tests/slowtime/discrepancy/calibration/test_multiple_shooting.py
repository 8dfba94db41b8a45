"""Short pieces of a record have one minimum, where the whole has many."""

import dataclasses
import importlib

import numpy as np
import pytest

from slowtime.discrepancy.calibration import (
    FitAbandoned,
    FitControl,
    cut_segments,
    refit,
    shooting_fit,
)
from slowtime.discrepancy.estimation import candidate_fit as naming
from slowtime.discrepancy.estimation.candidate_fit import FitSchedule, fit_candidate
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.estimation.shooting_fit import in_pieces
from slowtime.discrepancy.estimation.significance import is_significant
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Sensor
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import PLACE, one_mass

shooting = importlib.import_module("slowtime.discrepancy.calibration.multiple_shooting")
RATE, SD = 40.0, 0.02
KINDS = catalogue()
SHOOTING = FitSchedule(shooting=True)
ONE = one_mass(damping_n_s_per_m=1.0)


def swung(k):
    """A pendulum, thrown over the top now and then, on a spring that hardly turns it back."""
    effect = Effect("pendulum_sine", PLACE, {"k": k})
    return Plant.of(dataclasses.replace(ONE, effects=(effect.entry(),)))


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(3)
    push = np.convolve(rng.standard_normal(800), np.hanning(9), "same")[:, None] * 60.0
    plant = swung(790.0)
    seen = plant.simulate(plant.values, push, RATE) + SD * rng.standard_normal((800, 1))
    return (Trial(inputs=push, outputs=seen, rate_hz=RATE, start_s=50.0),)


def test_pieces_make_up_their_records_and_know_when_they_were(trials):
    cut, origin = cut_segments(Plant.of(ONE), (trials[0], trials[0]))
    half = len(cut) // 2
    assert origin == (0,) * half + (1,) * half
    joined = np.concatenate([piece.outputs for piece in cut[:half]])
    np.testing.assert_array_equal(joined, trials[0].outputs)
    assert [p.start_s for p in cut[:2]] == [50.0, 50.0 + len(cut[0].outputs) / RATE]


def test_a_chaotic_swing_is_fitted_to_its_pieces(trials):
    noise = white_noise([[SD**2 * 2 / RATE]])
    start = swung(780.0)
    found, states = shooting_fit(start, trials, noise, start.values)
    assert found.chi2_per_datum < 1.2
    strength = found.values[-1]
    assert abs(strength - 790.0) < 4 * found.sd[-1] < 0.05 * 790.0
    assert len(states) == 1
    whole = refit(start, trials, noise=noise)
    assert whole.chi2_per_datum > 10 * found.chi2_per_datum


@pytest.mark.parametrize(("instant", "fine"), [(60.0, True), (90.0, False), (40.0, False)])
def test_what_happened_before_or_after_all_records_does_not_stand(trials, instant, fine):
    effect = Effect("stiffness_jump", PLACE, {"dk_n_per_m": 80.0, "t_jump_s": instant})
    description = dataclasses.replace(ONE, effects=(effect.entry(),))
    fit = refit(Plant.of(description), trials, horizons=(1.0,), free=[])
    assert is_significant(FittedCandidate(effect, description, fit, 0.0), trials, KINDS) is fine


ACCELERATION = dataclasses.replace(
    ONE, sensors=(Sensor(channel="a", quantity="acceleration", node="m1", unit="m/s^2"),)
)


def thrown_over(description, begins, noise):
    """Records of a pendulum that begins by turning over, and swings when that has died down."""
    effect = Effect("pendulum_sine", PLACE, {"k": 800.0})
    plant = Plant.of(dataclasses.replace(description, effects=(effect.entry(),)), kinds=KINDS)
    rng = np.random.default_rng(5)
    trials = []
    for begin in begins:
        push = 60.0 * rng.standard_normal((4000, 1))
        seen = plant.simulate(plant.values, push, 100.0, state0=np.array(begin))
        trials.append(
            Trial(
                inputs=push,
                outputs=seen + noise * rng.standard_normal(seen.shape),
                rate_hz=100.0,
            )
        )
    return plant, tuple(trials)


@pytest.mark.parametrize(
    ("description", "noise"),
    [(ONE, 0.02), (ACCELERATION, 2.0)],
    ids=["angle", "acceleration"],
)
@pytest.mark.long
def test_pieces_that_were_led_astray_are_begun_anew(description, noise):
    """Damping that is off leads a pendulum that turns over to another turn."""
    plant, trials = thrown_over(description, [[0.5, 70.0], [0.1, 1.0]], noise)
    off = plant.values.copy()
    off[plant.parameters.index(("damping", PLACE.id))] *= 1.2
    heard = white_noise([[noise**2 * 2 / 100.0]] * 2)
    found, states = shooting_fit(plant, trials, heard, off)
    assert found.chi2_per_datum < 1.1
    assert found.values[-1] == pytest.approx(800.0, rel=2e-3)
    assert states[0][1] == pytest.approx(70.0, abs=1.0)


def test_a_piece_begins_where_sensors_say_if_that_is_nearer(monkeypatch):
    """A state that was led astray by a turn leads back by no small step."""
    sensors = (
        *ONE.sensors,
        Sensor(channel="v", quantity="velocity", node="m1", unit="m/s"),
    )
    description = dataclasses.replace(ONE, sensors=sensors)
    plant, trials = thrown_over(description, [[0.5, 70.0]], 0.02)
    off = plant.values.copy()
    off[plant.parameters.index(("damping", PLACE.id))] *= 1.2
    cut, origin = cut_segments(plant, trials)
    noise = white_noise([[0.02**2 * 2 / 100.0] * 2] * len(cut))
    states, _ = shooting._sequential_initial_states(plant, cut, origin, noise, off, None)
    begun = np.array([piece.outputs[0] for piece in cut])
    assert np.abs(np.array(states) - begun)[1:, 0].max() < 1.0


def test_a_piece_that_cannot_begin_where_the_last_has_led_begins_at_rest(trials, monkeypatch):
    plant = swung(780.0)
    cut, origin = cut_segments(plant, trials)
    noise = white_noise([[SD**2 * 2 / RATE]] * len(cut))
    begun: list[bool] = []

    def fitted(*known, **how):
        begun.append(bool(how["states"][0].any()))
        if begun[-1]:
            raise FloatingPointError("It runs away.")
        return refit(*known, **how)

    monkeypatch.setattr(shooting, "refit", fitted)
    states, left = shooting._sequential_initial_states(
        plant, cut, origin, noise, plant.values, None
    )
    assert len(states) == len(left) == len(cut)
    assert any(begun)
    with pytest.raises(FitAbandoned):
        shooting._sequential_initial_states(
            plant, cut, origin, noise, plant.values, lambda: True
        )


def test_where_it_is_too_late_for_pieces_they_are_given_up(trials):
    noise = white_noise([[SD**2 * 2 / RATE]])
    start = swung(780.0)
    with pytest.raises(FitAbandoned):
        shooting_fit(start, trials, noise, start.values, FitControl(is_late=lambda: True))


def run_away(*_, **__):
    raise FloatingPointError("it did")


@pytest.mark.long
def test_a_law_from_which_whole_records_run_away_is_told_by_its_pieces(monkeypatch):
    """Near the edge of a well a free run goes over it, though the law be all but right."""
    effect = Effect("quadratic_stiffness", PLACE, {"k2_n_per_m2": -8000.0})
    well = Plant.of(dataclasses.replace(ACCELERATION, effects=(effect.entry(),)), kinds=KINDS)
    rng = np.random.default_rng(11)
    push = 6.0 * rng.standard_normal((6000, 1))
    clean = well.simulate(well.values, push, 100.0)
    noise = 0.1 * rng.standard_normal(clean.shape)
    trial = Trial(inputs=push, outputs=clean + noise, rate_hz=100.0)
    before = refit(Plant.of(ACCELERATION, kinds=KINDS), [trial])
    assert before.chi2_in_band > 100.0
    guess = Effect("quadratic_stiffness", PLACE, {"k2_n_per_m2": -8200.0})
    whole = fit_candidate(before, guess, [trial], KINDS, None, schedule=SHOOTING)
    assert whole is not None
    assert whole.fit.chi2_in_band < 1.2
    monkeypatch.setattr(naming, "refit", run_away)
    named = fit_candidate(before, guess, [trial], KINDS, None, schedule=SHOOTING)
    assert named is not None
    assert named.fit.cost == before.cost
    (told,) = in_pieces([named], KINDS)
    assert told.fit is named.shot
    assert told.fit.values[-1] == pytest.approx(-8000.0, rel=0.01)
    # A law that does not explain the pieces either is none.
    wrong = Effect("quadratic_damping", PLACE, {"c2_n_s2_per_m2": 1.0})
    assert fit_candidate(before, wrong, [trial], KINDS, None, schedule=SHOOTING) is None
    assert fit_candidate(before, guess, [trial], KINDS, None) is None
