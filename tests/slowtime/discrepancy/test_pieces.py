"""Short pieces of a record have one minimum, where the whole has many."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.floor.colour import white_noise
from slowtime.discrepancy.naming import Named, stands
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.refit import pieces, refit, shot
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import PLACE, one_mass

RATE, SD = 40.0, 0.02
KINDS = catalogue()
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
    cut, origin = pieces(Plant.of(ONE), (trials[0], trials[0]))
    half = len(cut) // 2
    assert origin == (0,) * half + (1,) * half
    joined = np.concatenate([piece.outputs for piece in cut[:half]])
    np.testing.assert_array_equal(joined, trials[0].outputs)
    assert [p.start_s for p in cut[:2]] == [50.0, 50.0 + len(cut[0].outputs) / RATE]


def test_a_chaotic_swing_is_fitted_to_its_pieces(trials):
    noise = white_noise([[SD**2 * 2 / RATE]])
    start = swung(780.0)
    found, states = shot(start, trials, noise, start.values)
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
    assert stands(Named(effect, description, fit, 0.0), trials, KINDS) is fine
