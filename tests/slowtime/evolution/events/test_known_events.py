"""Repairs and inspections, against sampling and against the filter itself."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.state_space import Belief, step
from slowtime.evolution.events.known_events import (
    RATE_SD,
    Detection,
    DetectionCurve,
    KnownEvent,
    Measurement,
    Repair,
    Replacement,
    apply_event,
)
from slowtime.evolution.forecasting import continuation, forecast

PROCESS = SlowProcess(
    smoothness=1.5,
    length=np.array([5.0, 20.0]),
    sd=np.array([0.01, 0.03]),
    level_sd=0.2,
    slope_sd=0.02,
    slope_drift=np.array([0.0, 1e-4]),
)
CURVE = DetectionCurve(a50=0.15, slope=3.0)
EVENTS: tuple[KnownEvent, ...] = (
    Repair(time=30.0),
    Repair(time=30.0, share=0.6, share_sd=0.1),
    Replacement(time=30.0, level=None),
    Replacement(time=30.0, level=-0.05, level_sd=0.01),
    Measurement(time=30.0, value=-0.1, sd=0.01),
    Detection(time=30.0, detected=False, curve=CURVE),
)


def damaged(seed: int = 0, count: int = 31) -> Belief:
    """Belief after a linear loss of 0.004 a reading."""
    rng = np.random.default_rng(seed)
    belief = PROCESS.start(0.0)
    for time in np.arange(float(count)):
        value = -0.004 * time + 0.004 * rng.standard_normal()
        belief, _ = step(PROCESS, belief, float(time), float(value), 0.004)
    return belief


def value_of(belief: Belief) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of what a reading sees."""
    seen = PROCESS.observation
    return belief.mean @ seen, belief.covariance @ seen @ seen


@pytest.mark.parametrize(("share", "share_sd"), [(1.0, 0.0), (0.6, 0.1), (0.5, 0.29)])
def test_a_repair_has_the_moments_of_sampled_repairs(share, share_sd):
    before = damaged()
    after = apply_event(PROCESS, before, Repair(time=30.0, share=share, share_sd=share_sd))
    rng, count = np.random.default_rng(1), 200_000
    for member in range(2):
        states = rng.multivariate_normal(
            before.mean[member], before.covariance[member], count, method="svd"
        )
        old = states @ PROCESS.observation
        restored = share + share_sd * rng.standard_normal(count)
        new = (1.0 - restored) * old + 0.02 * rng.standard_normal(count)
        slope = states[:, 1] + RATE_SD * np.abs(states[:, 1]) * rng.standard_normal(count)
        mean, variance = value_of(after)
        assert mean[member] == pytest.approx(new.mean(), abs=5 * new.std() / count**0.5)
        assert variance[member] == pytest.approx(new.var(), rel=0.02)
        assert after.mean[member, 1] == pytest.approx(slope.mean(), abs=1e-4)
        assert after.covariance[member, 1, 1] == pytest.approx(slope.var(), rel=0.02)


def test_a_measured_value_enters_as_a_reading_does():
    before = damaged()
    told = apply_event(PROCESS, before, Measurement(time=32.0, value=-0.1, sd=0.01))
    read, _ = step(PROCESS, before, 32.0, -0.1, 0.01)
    np.testing.assert_allclose(told.mean, read.mean, rtol=1e-9)
    np.testing.assert_allclose(told.covariance, read.covariance, rtol=1e-7, atol=1e-15)


@pytest.mark.parametrize("detected", [True, False])
@pytest.mark.parametrize(
    "curve", [CURVE, DetectionCurve(points=((0.0, 0.02), (0.1, 0.3), (0.2, 0.95)))]
)
def test_a_detection_weighs_damage_by_its_likelihood(detected, curve):
    before = damaged()
    after = apply_event(PROCESS, before, Detection(time=30.0, detected=detected, curve=curve))
    rng = np.random.default_rng(2)
    for member in range(2):
        mean, variance = (each[member] for each in value_of(before))
        drawn = mean + np.sqrt(variance) * rng.standard_normal(400_000)
        weight = curve.probability(-drawn)
        weight = weight if detected else 1.0 - weight
        expected = np.average(drawn, weights=weight)
        spread = np.average((drawn - expected) ** 2, weights=weight)
        found = [each[member] for each in value_of(after)]
        assert found[0] == pytest.approx(expected, abs=5 * np.sqrt(spread / 4e5) + 1e-6)
        assert found[1] == pytest.approx(spread, rel=0.02)


def test_finding_damage_where_none_can_be_changes_nothing():
    intact = Belief(0.0, np.zeros((2, 4)), 1e-12 * np.broadcast_to(np.eye(4), (2, 4, 4)))
    shifted = dataclasses.replace(intact, mean=intact.mean + np.array([0.5, 0, 0, 0]))
    after = apply_event(PROCESS, shifted, Detection(time=0.0, detected=True, curve=CURVE))
    np.testing.assert_allclose(after.mean, shifted.mean)


def test_a_replacement_forgets_the_rate_and_starts_at_its_level():
    after = apply_event(PROCESS, damaged(), Replacement(time=30.0, level=-0.05, level_sd=0.01))
    mean, variance = value_of(after)
    np.testing.assert_allclose(mean, -0.05)
    np.testing.assert_allclose(variance, 0.01**2, rtol=1e-9)
    np.testing.assert_allclose(after.mean[:, 1], 0.0)
    np.testing.assert_allclose(after.covariance[:, 1, 1], 0.02**2)


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: type(event).__name__)
def test_beliefs_stay_symmetric_positive_and_unshared(event):
    before = damaged()
    kept = before.mean.copy(), before.covariance.copy()
    after = apply_event(PROCESS, before, event)
    np.testing.assert_array_equal(before.mean, kept[0])
    np.testing.assert_array_equal(before.covariance, kept[1])
    np.testing.assert_array_equal(after.covariance, np.swapaxes(after.covariance, -1, -2))
    assert np.linalg.eigvalsh(after.covariance).min() > -1e-12


def repaired(seed: int, share: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Damage that grows linearly, of which a share is repaired after slow time 49."""
    rng = np.random.default_rng(seed)
    time = np.arange(80.0)
    change = -0.003 * np.where(time <= 49.0, time, time - 49.0 * share)
    return time, change + 0.004 * rng.standard_normal(80), np.full(80, 0.004)


PAST = repaired(3)
STEADY = repaired(4, share=0.0)
OUTLOOK = forecast.fit(*(each[:60] for each in STEADY), known=EVENTS)


@settings(max_examples=30)
@given(
    cuts=st.sets(st.integers(31, 79), max_size=4),
    events=st.lists(st.sampled_from(EVENTS), max_size=3),
)
def test_cutting_the_stream_anywhere_changes_nothing(cuts, events):
    moved = [
        dataclasses.replace(event, time=30.0 + 15.5 * place)
        for place, event in enumerate(events)
    ]
    whole = continuation.begin(OUTLOOK, *STEADY, known=moved)
    begun = continuation.begin(OUTLOOK, *(each[:31] for each in STEADY), known=moved)
    for first, last in zip([31, *sorted(cuts)], [*sorted(cuts), 80], strict=True):
        begun = begun.follow(*(each[first:last] for each in STEADY))
    np.testing.assert_array_equal(begun.smooth.mean, whole.smooth.mean)
    np.testing.assert_array_equal(begun.smooth.covariance, whole.smooth.covariance)
    assert begun.known == whole.known


def test_a_forecast_restarts_from_a_repair_before_any_reading_follows():
    past = tuple(each[:50] for each in PAST)
    repair = Repair(time=49.0)
    outlook = forecast.fit(*past, known=[repair])
    later = np.array([49.0, 55.0])
    without = continuation.begin(outlook, *past).predict(later)
    told = continuation.begin(outlook, *past, known=[repair]).predict(later)
    assert without.mean[0] == pytest.approx(-0.147, abs=0.01)
    assert told.mean[0] == pytest.approx(0.0, abs=1e-9)
    # The rate that was learnt before the repair goes on after it.
    assert told.mean[1] == pytest.approx(-0.018, abs=0.006)
    assert told.sd[1] > 0.02


def test_a_told_repair_is_no_jump_that_may_come_again():
    outlook = forecast.fit(*PAST, known=[Repair(time=49.0)], suspected=[49.0])
    assert outlook.jumps == ()
    assert outlook.further is None
    assert 49.0 in [at for at, _ in forecast.fit(*PAST, suspected=[49.0]).jumps]


def test_a_told_repair_of_which_nothing_is_seen_is_overruled_by_readings():
    time = np.arange(70.0)
    rng = np.random.default_rng(5)
    past = time, -0.003 * time + 0.004 * rng.standard_normal(70), np.full(70, 0.004)
    told = [Repair(time=49.0)]
    outlook = forecast.fit(*past, known=told)
    found = continuation.begin(outlook, *past, known=told).predict(np.array([75.0]))
    assert found.lo[0] < -0.225 < found.hi[0]


@settings(max_examples=15)
@given(order=st.permutations(range(6)))
def test_readings_and_events_may_come_in_any_order(order):
    events = [
        dataclasses.replace(event, time=32.0 + 3.0 * place)
        for place, event in enumerate(EVENTS)
    ]
    whole = continuation.begin(OUTLOOK, *STEADY, known=events)
    mixed = continuation.begin(OUTLOOK, *STEADY, known=[events[place] for place in order])
    np.testing.assert_array_equal(mixed.smooth.mean, whole.smooth.mean)


def test_more_events_than_readings_between_them_are_withstood():
    past = tuple(each[:12] for each in PAST)
    told = [Repair(time=float(at)) for at in range(-2, 14)]
    outlook = forecast.fit(*past, known=told)
    found = continuation.begin(outlook, *past, known=told).predict(np.array([14.0]))
    assert np.isfinite([found.mean[0], found.sd[0], found.lo[0], found.hi[0]]).all()


def test_a_curve_of_detection_wants_one_description():
    with pytest.raises(ValueError, match="Give a50 and slope, or points"):
        DetectionCurve(a50=0.1)
    with pytest.raises(ValueError, match="Give a50 and slope, or points"):
        DetectionCurve(a50=0.1, slope=1.0, points=((0.0, 0.0), (1.0, 1.0)))
