import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from slowtime.dynamics.sdof.pendulum import (
    learn_period,
    period,
    small_angle_period,
    small_angle_swing,
    swing,
)


@pytest.mark.parametrize("amplitude", [0.05, 1.0, 2.5, 3.1])
def test_the_full_swing_is_the_integral_of_the_equation_of_motion(amplitude):
    times = np.linspace(0.0, 9.0, 40)
    truth = solve_ivp(
        lambda t, x: (x[1], -9.81 / 0.7 * math.sin(x[0])),
        (0.0, 9.0),
        (amplitude, 0.0),
        t_eval=times,
        rtol=1e-12,
        atol=1e-13,
        method="DOP853",
    ).y
    angle, rate = swing(times, amplitude, 0.7, 9.81)
    np.testing.assert_allclose(angle, truth[0], atol=2e-8)
    np.testing.assert_allclose(rate, truth[1], atol=2e-7)


@given(amplitude=st.floats(1e-3, 3.14), length=st.floats(0.01, 100.0))
def test_after_a_period_a_pendulum_is_where_it_was_and_half_way_opposite(amplitude, length):
    whole = period(amplitude, length)
    angle, _ = swing(np.array([0.0, whole / 2, whole]), amplitude, length)
    np.testing.assert_allclose(angle, [amplitude, -amplitude, amplitude], atol=1e-5)


def test_the_period_is_the_one_of_the_reference():
    assert period(1.0, 1.0, 9.81) == pytest.approx(2.139138, abs=5e-7)
    assert small_angle_period(1.0, 9.81) == pytest.approx(2.006067, abs=5e-7)


def test_for_small_angles_the_period_grows_by_a_sixteenth_of_their_square():
    for amplitude in (0.02, 0.1):
        grown = period(amplitude, 1.0) / small_angle_period(1.0) - 1
        assert grown == pytest.approx(amplitude**2 / 16 + 11 * amplitude**4 / 3072, rel=1e-5)


def test_a_small_swing_is_a_cosine_and_a_large_one_is_not():
    times = np.linspace(0.0, 4.0, 30)
    small, large = (
        np.abs(swing(times, one, 1.0)[0] - small_angle_swing(times, one, 1.0)).max() / one
        for one in (0.01, 1.5)
    )
    assert small < 1e-4
    assert large > 0.3


def readings(seed, count, error, amplitudes):
    rng = np.random.default_rng(seed)
    length, gravity = rng.uniform(0.2, 3.0, count), rng.choice([1.62, 3.72, 9.81], count)
    mass, amplitude = rng.uniform(0.1, 2.0, count), rng.uniform(0.0, amplitudes, count)
    truth = np.array([period(*one) for one in zip(amplitude, length, gravity, strict=True)])
    measured = truth * np.exp(error * rng.standard_normal(count))
    return measured, {"length": length, "gravity": gravity, "mass": mass}, amplitude


def test_exact_data_teach_the_law_of_the_book():
    """Eq. 1.5 out of eq. 1.6: nobody told it the square root."""
    measured, quantities, _ = readings(0, 12, 0.0, 1e-9)
    law = learn_period(measured, quantities)
    found = [law.exponents[name] for name in ("length", "gravity", "mass")]
    np.testing.assert_allclose(found, [0.5, -0.5, 0.0], atol=1e-12)
    assert law.constant == pytest.approx(2 * math.pi)


def test_large_swings_teach_the_amplitude_too():
    measured, quantities, amplitude = readings(1, 200, 0.0, 1.5)
    law = learn_period(measured, quantities, amplitude, amplitude_powers=3)
    assert law.amplitude_terms[0] == pytest.approx(1 / 16, rel=1e-2)
    found, inside = law.predict({k: v[:5] for k, v in quantities.items()}, amplitude[:5])
    np.testing.assert_allclose(found, measured[:5], rtol=1e-4)
    assert inside.all()


def test_over_many_draws_the_exponents_lie_within_their_errors():
    truth, distances, scatters = {"length": 0.5, "gravity": -0.5, "mass": 0.0}, [], []
    for seed in range(80):
        measured, quantities, amplitude = readings(seed, 30, 0.02, 1.0)
        law = learn_period(measured, quantities, amplitude)
        distances += [
            (law.exponents[name] - truth[name]) / law.exponents_sd[name] for name in truth
        ]
        scatters.append(law.scatter)
    assert np.mean(np.square(distances)) == pytest.approx(1.09, abs=0.3)
    assert np.mean(scatters) == pytest.approx(0.02, rel=0.05)


def test_a_law_says_where_it_was_never_tried():
    measured, quantities, _ = readings(2, 30, 0.01, 0.1)
    law = learn_period(measured, quantities)
    asked = {"length": np.array([1.0, 50.0]), "gravity": np.full(2, 5.0), "mass": np.ones(2)}
    assert law.predict(asked)[1].tolist() == [True, False]
    with pytest.raises(ValueError, match="the same quantities"):
        law.predict({"length": np.ones(2)})


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: period(57.3, 1.0), "radians, not degrees"),
        (
            lambda: learn_period(np.ones(9), {"length": np.ones(9)}),
            "leave out what never varied",
        ),
        (
            lambda: learn_period(np.ones(1), {"length": np.array([2.0])}),
            "read more often",
        ),
    ],
)
def test_what_cannot_be_learnt_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
