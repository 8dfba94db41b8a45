import numpy as np
import pytest
import scipy.signal as sps
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.response import frequency_response
from slowtime.dynamics.sdof.simulation import ambient_acceleration, simulate, transition

FORCE = np.random.default_rng(2).standard_normal(60)


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("zeta", [0.0, 0.05, 1.0, 2.5])
def test_stepping_is_the_integral_of_the_equation_of_motion(hold, zeta):
    osc, rate = Oscillator.from_modal(0.8, zeta, 2.0), 5.0

    def motion(t, x, k):
        f = (
            FORCE[k]
            if hold == "zero"
            else np.interp(t, (k / rate, (k + 1) / rate), FORCE[k : k + 2])
        )
        return x[1], (
            f - osc.damping_n_s_per_m * x[1] - osc.stiffness_n_per_m * x[0]
        ) / osc.mass_kg

    state, truth = np.array([0.1, -0.2]), [np.array([0.1, -0.2])]
    for k in range(len(FORCE) - 1):
        span = (k / rate, (k + 1) / rate)
        state = solve_ivp(
            motion, span, state, args=(k,), rtol=1e-11, atol=1e-13, method="DOP853"
        ).y[:, -1]
        truth.append(state)
    q, v, a = simulate(osc, FORCE, rate, initial=(0.1, -0.2), hold=hold)
    np.testing.assert_allclose(np.c_[q, v], truth, atol=1e-8)
    balance = osc.mass_kg * a + osc.damping_n_s_per_m * v + osc.stiffness_n_per_m * q
    np.testing.assert_allclose(balance, FORCE, atol=1e-9)


@given(cut=st.integers(1, 58))
def test_a_run_can_be_cut_anywhere_and_continued(cut):
    osc = Oscillator.from_modal(0.8, 0.05, 2.0)
    whole = np.array(simulate(osc, FORCE, 5.0))
    first = np.array(simulate(osc, FORCE[: cut + 1], 5.0))
    second = np.array(simulate(osc, FORCE[cut:], 5.0, initial=(first[0, -1], first[1, -1])))
    np.testing.assert_allclose(np.c_[first[:, :-1], second], whole, atol=1e-12)


def test_two_half_steps_are_one_step():
    osc = Oscillator.from_modal(3.0, 0.3)
    half, _, _ = transition(osc, 0.05)
    whole, _, _ = transition(osc, 0.1)
    np.testing.assert_allclose(half @ half, whole, atol=1e-13)


def test_the_ambient_record_has_the_density_the_theory_says():
    osc, rate = Oscillator.from_modal(5.0, 0.02, 3.0), 50.0
    rng = np.random.default_rng(4)
    records = np.array(
        [ambient_acceleration(osc, 1000, rate, rng, force_psd=0.5) for _ in range(400)]
    )
    f, density = sps.periodogram(records, rate, detrend=False)
    fine = np.linspace(0.0, rate / 2, 50_001)
    omega = 2 * np.pi * fine
    truth = omega**4 * np.abs(frequency_response(osc, omega)) ** 2 * 0.5
    for low, high in ((1.0, 4.0), (4.0, 6.0), (6.0, 12.0), (12.0, 24.9)):
        inside = (f >= low) & (f < high)
        within = (fine >= low) & (fine < high)
        power = density.mean(axis=0)[inside].sum() * (f[1] - f[0])
        expected = truth[within].sum() * (fine[1] - fine[0])
        # The first band holds what leaks from the resonance in a rectangular window.
        assert power == pytest.approx(expected, rel=0.5 if high == 4.0 else 0.05)


def test_the_ambient_record_is_stationary_from_its_first_sample():
    osc = Oscillator.from_modal(5.0, 0.01)
    rng = np.random.default_rng(6)
    records = np.array([ambient_acceleration(osc, 200, 50.0, rng) for _ in range(3000)])
    power = records.var(axis=0)
    assert power[:20].mean() / power[-20:].mean() == pytest.approx(1.0, abs=0.1)
    ends = np.corrcoef(records[:, 0], records[:, -1])[0, 1]
    omega, late = osc.natural_frequency, 199 / 50.0
    assert ends == pytest.approx(np.exp(-0.01 * omega * late) * np.cos(omega * late), abs=0.1)


def test_the_same_seed_makes_the_same_record():
    osc = Oscillator.from_modal(5.0, 0.01)
    one, two = (ambient_acceleration(osc, 99, 50.0, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_no_force_no_samples():
    assert all(len(part) == 0 for part in simulate(Oscillator(1.0, 1.0, 1.0), np.zeros(0), 5.0))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: simulate(Oscillator(1.0, 1.0, 1.0), FORCE, 5.0, hold="cubic"),
            "Allowed: zero, first",
        ),
        (lambda: transition(Oscillator(1.0, 1.0, 1.0), 0.0), "not a valid time step"),
        (
            lambda: ambient_acceleration(
                Oscillator(1.0, 0.0, 1.0), 9, 5.0, np.random.default_rng()
            ),
            "never becomes stationary",
        ),
        (
            lambda: ambient_acceleration(
                Oscillator(1.0, 1.0, 1.0), 0, 5.0, np.random.default_rng()
            ),
            "not a valid number of samples",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
