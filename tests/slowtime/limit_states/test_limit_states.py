"""Limit states beside closed forms and brute force."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from slowtime.design import AddedStructure, HarmonicLoad, NoiseLoad, Response
from slowtime.dynamics.description import Description, Node, Spring, assemble
from slowtime.dynamics.random_vibration import kanai_tajimi
from slowtime.limit_states import (
    Resonance,
    ResponseLimit,
    Threshold,
    assess,
    gumbel_of_maxima,
    history,
)
from slowtime.reliability import marginal
from tests.slowtime.dynamics.random_vibration import response_covariance

TIME = np.linspace(0.0, 10.0, 201)


@dataclasses.dataclass(frozen=True)
class Told:
    """Probability of an event that is the change itself, for each of some capacities."""

    rate: float | None
    capacities: tuple[float, ...] = (1.0,)

    @property
    def quantities(self):
        return ("p",)

    @property
    def events(self):
        return self.rate

    def given(self, changes):
        each = np.stack([c * changes["p"] for c in self.capacities])
        return each, np.full(len(self.capacities), 1.0 / len(self.capacities))


def constant(values):
    return {"p": np.repeat(np.asarray(values)[:, None], len(TIME), axis=1)}


def test_events_of_one_rate_and_probability_are_a_poisson_process():
    found = assess(Told(rate=0.7), TIME, constant([0.2]))
    np.testing.assert_allclose(found.survival, np.exp(-0.7 * 0.2 * TIME), rtol=1e-12)
    np.testing.assert_allclose(found.hazard, 0.14, rtol=1e-6)
    assert found.beta[0] == pytest.approx(-stats.norm.ppf(0.2))
    assert found.when(0.5) == pytest.approx(math.log(2.0) / 0.14, rel=1e-4)
    assert found.when(0.99) == math.inf


def test_a_rate_of_a_gamma_law_survives_as_its_transform():
    shape, scale = 2.0, 0.05
    rates = stats.gamma(shape, scale=scale).ppf((np.arange(20_000) + 0.5) / 20_000)
    found = assess(Told(rate=1.0), TIME, constant(rates))
    np.testing.assert_allclose(found.survival, (1 + scale * TIME) ** -shape, rtol=1e-4)
    # Those who live longer are those with the smaller rate.
    assert found.hazard[-1] < found.hazard[1]


def test_a_capacity_that_stays_is_averaged_last():
    found = assess(Told(rate=1.0, capacities=(0.0, 2.0)), TIME, constant([0.3]))
    np.testing.assert_allclose(found.survival, 0.5 * (1.0 + np.exp(-0.6 * TIME)), rtol=1e-12)
    assert (found.survival >= np.exp(-0.3 * TIME) - 1e-12).all()


def test_what_has_failed_stays_failed():
    path = np.where(TIME < 4.0, 0.0, np.where(TIME < 6.0, -0.3, 0.0))
    found = assess(Threshold("p", -0.2, "below"), TIME, {"p": path[None]})
    assert found.survival[TIME < 4.0].min() == 1.0
    assert found.survival[TIME >= 4.0].max() == 0.0
    assert found.probability[-1] == 0.0
    assert found.when(0.5) == pytest.approx(4.0, abs=0.05)


def test_bands_widen_with_what_is_not_known():
    rng = np.random.default_rng(1)
    narrow, wide = (
        assess(Told(rate=1.0), TIME, constant(0.2 + s * rng.uniform(-1, 1, 500)))
        for s in (0.01, 0.1)
    )
    assert (narrow.hi - narrow.lo)[0] < (wide.hi - wide.lo)[0]
    assert narrow.survival[-1] == pytest.approx(np.exp(-2.0), rel=0.01)


def test_a_resonance_is_as_probable_as_by_counting():
    excitation = marginal("normal", mean=3.0, sd=0.2)
    state = Resonance(3.5, excitation, 0.05)
    rng = np.random.default_rng(2)
    change = np.array([[-0.3, -0.1, 0.2]])
    found, _ = state.given({"stiffness_change": change})
    hz = 3.5 * np.sqrt(1.0 + change[0])
    drawn = rng.normal(3.0, 0.2, 400_000)
    counted = [np.mean(np.abs(drawn / f - 1.0) < 0.05) for f in hz]
    np.testing.assert_allclose(found[0, 0], counted, atol=0.003)


FIRST, SECOND = (
    Spring(id="s1", between=("base", "a"), stiffness_n_per_m=1.2e6, damping_n_s_per_m=2e3),
    Spring(id="s2", between=("a", "b"), stiffness_n_per_m=9e5, damping_n_s_per_m=1e3),
)
FRAME = Description(
    name="frame",
    nodes=(Node(id="a", mass_kg=900.0), Node(id="b", mass_kg=800.0)),
    elements=(FIRST, SECOND),
)
SHAPING = kanai_tajimi(2.5, 0.6)
DRIFT = Response(
    quantity="displacement", between=("base", "a"), statistic="peak", duration_s=20.0
)


def limit(**more):
    settings: dict[str, Any] = {
        "structure": AddedStructure(FRAME, (), ["s1.stiffness"]),
        "names": ("s1",),
        "load": NoiseLoad(psd=0.3, shaping=SHAPING),
        "response": DRIFT,
        "capacity": 0.05,
        "rate": 0.2,
    }
    return ResponseLimit(**(settings | more))


def test_an_event_of_noise_exceeds_as_its_crossings_say():
    soft = dataclasses.replace(FIRST, stiffness_n_per_m=0.8e6)
    structure = assemble(dataclasses.replace(FRAME, elements=(soft, SECOND)))
    mass = structure.mass.sum(axis=0)
    reference = response_covariance(structure, 0.3 * np.outer(mass, mass), shaping=SHAPING)
    sd, rate = math.sqrt(reference.displacement[0, 0]), math.sqrt(reference.velocity[0, 0])
    expected = rate / (math.pi * sd) * 20.0 * math.exp(-0.5 * (0.05 / sd) ** 2)
    found, _ = limit().given({"s1": np.array([[-1.0 / 3.0]])})
    assert found[0, 0, 0] == pytest.approx(1.0 - math.exp(-expected), rel=1e-6)


def test_random_loads_and_capacities_are_integrated_as_by_drawing():
    intensity = marginal("gumbel", mean=1.0, sd=0.3)
    capacity = marginal("lognormal", mean=0.05, sd=0.01)
    state = limit(intensity=intensity, capacity=capacity)
    given, weights = state.given({"s1": np.array([[-0.2]])})
    found = float(weights @ given[:, 0, 0])
    rng = np.random.default_rng(3)
    loads = intensity.law.rvs(size=200_000, random_state=rng)
    strengths = capacity.law.rvs(size=200_000, random_state=rng)
    sd, crossings = state._sizes(np.array([[0.8]]))
    ratio = strengths / (np.abs(loads) * sd[0])
    assert crossings is not None
    drawn = 1.0 - np.exp(-crossings[0] * np.exp(-0.5 * ratio**2))
    assert found == pytest.approx(drawn.mean(), abs=4 * drawn.std() / len(drawn) ** 0.5 + 1e-4)


def test_a_lost_stiffness_has_failed_and_less_stiffness_fails_more():
    given, _ = limit().given({"s1": np.array([[-1.0, -0.4, -0.2, 0.0]])})
    assert given[0, 0, 0] == 1.0
    assert (np.diff(given[0, 0]) < 0.0).all()


def test_a_steady_load_fails_where_its_amplitude_passes_the_capacity():
    steady = Response(quantity="displacement", between=("base", "a"), statistic="peak")
    load = HarmonicLoad(amplitude=1.0, frequency_hz=3.0)
    low, high = (
        limit(load=load, response=steady, capacity=c).given({"s1": np.zeros((1, 1))})[0]
        for c in (1e-6, 10.0)
    )
    assert (low, high) == (1.0, 0.0)


def test_the_past_is_as_probable_as_readings_say():
    state = Threshold("p", -0.2, "below")
    value, sd = np.array([-0.1, -0.2, -0.3]), np.full(3, 0.05)
    mean, lo, hi = history(state, {"p": value}, {"p": sd}, paths=20_000)
    np.testing.assert_allclose(mean, stats.norm.cdf(-0.2, value, sd), atol=0.01)
    # Each future either has passed or has not, and so does a 5 % of them.
    assert lo.tolist() == [0.0, 0.0, 1.0]
    assert hi.tolist() == [0.0, 1.0, 1.0]


def test_maxima_of_a_gumbel_law_give_it_back():
    truth = stats.gumbel_r(loc=5.0, scale=1.5)
    found = gumbel_of_maxima(truth.rvs(size=20_000, random_state=4))
    assert found.law.mean() == pytest.approx(truth.mean(), rel=0.01)
    assert found.law.std() == pytest.approx(truth.std(), rel=0.02)
    with pytest.raises(ValueError, match="Give 8 at least"):
        gumbel_of_maxima(np.array([1.0, 2.0]))


def test_a_quantity_that_no_twin_estimates_is_named():
    with pytest.raises(ValueError, match=r"mass_change: not estimated.*estimates: p"):
        assess(Threshold("mass_change", 0.2, "above"), TIME, constant([0.1]))
