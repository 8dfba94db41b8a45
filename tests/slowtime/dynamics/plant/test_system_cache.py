"""What is made once for several runs is what each would make for itself."""

import numpy as np
import pytest
import scipy.linalg
import scipy.special

from slowtime.dynamics.effects import Effect, Place
from slowtime.dynamics.effects.compilation import ROUND
from slowtime.dynamics.plant import sensing
from slowtime.dynamics.plant.simulation_run import padded_copy
from slowtime.dynamics.plant.step_levels import levels_of
from slowtime.dynamics.plant.system import turned
from slowtime.dynamics.plant.system_cache import KEPT, system_of

RATE = 200.0


@pytest.fixture
def bent(rig):
    """Give a plant with a law in its second spring."""
    where = Place("element", rig().description.elements[1].id)
    return rig(Effect("cubic_hardening", where, {"k3_n_per_m3": 2e5}).entry())


def slopes(plant, values, pushed, rate_hz, free):
    return plant.sensitivities(values, pushed, rate_hz, free)[1]


def test_runs_in_any_order_give_what_each_gives_alone(bent, push):
    """More requests than are kept: other values, rates, slopes; none takes another's system."""
    pushed, free = push(150), tuple(n for n, e in bent.entries.items() if e.fitted)
    asked = [
        (bent.values * (1 + 0.01 * k), rate, names)
        for k in range(KEPT)
        for rate in (RATE, RATE / 2)
        for names in (free, free[:2])
    ]
    alone = []
    for values, rate, names in asked:
        system_of.cache_clear()
        alone.append(slopes(bent, values, pushed, rate, names))
    system_of.cache_clear()
    order = np.random.default_rng(3).integers(len(asked), size=3 * len(asked))
    for k in order:
        values, rate, names = asked[k]
        np.testing.assert_array_equal(slopes(bent, values, pushed, rate, names), alone[k])


def test_records_at_the_same_values_share_one_system(bent, push):
    system_of.cache_clear()
    for samples in (100, 150, 200):
        bent.simulate(bent.values, push(samples), RATE)
    assert system_of.cache_info().misses == 1
    assert system_of.cache_info().hits == 2


def test_plants_with_the_same_numbers_keep_apart(rig, push):
    system_of.cache_clear()
    one, other = rig(), rig()
    for plant in (one, other):
        plant.simulate(plant.values, push(50), RATE)
    assert system_of.cache_info().misses == 2


@pytest.mark.parametrize("powers", [1, 2, 6])
@pytest.mark.parametrize("deep", [True, False])
def test_every_level_is_the_exponential_of_its_own_step(powers, deep):
    """By another road: one large exponential per length, and the slope by a difference."""
    rng = np.random.default_rng(powers)
    a, b = rng.standard_normal((2, 4, 4)), rng.standard_normal((2, 4, 3))
    a[0] *= 10.0
    interval, nudge = 0.05, 1e-6
    steps = levels_of(a, b, interval, powers, deep=deep)
    assert steps.kept.shape[0] == steps.pushed.shape[0]
    assert (steps.kept.shape[0] > 1) == deep

    def exact(change, length):
        size, inputs = 4, 3
        whole = np.zeros((size + inputs * powers,) * 2)
        whole[:size, :size] = length * (a[0] + change * a[1])
        whole[:size, size : size + inputs] = length * (b[0] + change * b[1])
        for j in range(powers - 1):
            row = size + inputs * j
            whole[row : row + inputs, row + inputs : row + 2 * inputs] = np.eye(inputs)
        moved = scipy.linalg.expm(whole)[:size]
        kept, pushed = moved[:, :size], moved[:, size:].reshape(size, powers, inputs)
        # In parts of the step, each block pushes by the power over its factorial.
        return kept, pushed * scipy.special.factorial(np.arange(powers))[:, None]

    for level in range(steps.kept.shape[0]):
        length = interval / 2**level
        kept, pushed = exact(0.0, length)
        np.testing.assert_allclose(steps.kept[level, 2, 0], kept, atol=1e-13)
        np.testing.assert_allclose(steps.pushed[level, 2, 0], pushed, atol=1e-13)
        above, below = exact(nudge, length), exact(-nudge, length)
        slope = [(u - d) / (2 * nudge) for u, d in zip(above, below, strict=True)]
        np.testing.assert_allclose(steps.kept[level, 2, 1], slope[0], atol=1e-8)
        np.testing.assert_allclose(steps.pushed[level, 2, 1], slope[1], atol=1e-8)


@pytest.mark.parametrize("hold", ["zero", "first", "band_limited"])
def test_inputs_too_long_to_be_kept_are_the_same_between_samples(monkeypatch, hold):
    columns = np.random.default_rng(2).standard_normal((300, 2))
    sensing._cached_polynomials.cache_clear()
    kept = sensing.held(columns, (hold, "zero"))
    assert sensing._cached_polynomials.cache_info().currsize == 2
    monkeypatch.setattr(sensing, "LONG", 300)
    sensing._cached_polynomials.cache_clear()
    np.testing.assert_array_equal(sensing.held(columns, (hold, "zero")), kept)
    assert sensing._cached_polynomials.cache_info().currsize == 0


@pytest.mark.parametrize("rows", range(1, 2 * ROUND + 2))
def test_a_round_that_begins_at_any_row_stays_within_its_place(rows):
    matrix = np.arange(3.0 * rows).reshape(rows, 3) + 1.0
    found, room = turned(matrix), padded_copy(np.arange(rows) + 1.0)
    assert np.array_equal(found[:, :rows], matrix.T)
    assert not found[:, rows:].any()
    assert found.shape[1] >= rows - 1 + ROUND
    assert room.base is not None
    assert room.base.size >= rows - 1 + ROUND
    assert room.tolist() == (np.arange(rows) + 1.0).tolist()
