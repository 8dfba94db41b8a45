"""Response spectra against closed forms and an ODE solver."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.signals.shaking.response_spectra import response_spectra

RATE = 100.0


@pytest.mark.parametrize("f0", [0.7, 3.0, 12.0])
def test_steady_sine_is_amplified_as_the_book_says(f0: float):
    duration = 400.0 / f0
    time = np.arange(0, duration, 1 / RATE)
    # The sine grows and ends slowly, so that no oscillator sees its beginning or end.
    grown = np.sin(2 * np.pi * f0 * time) * np.sin(np.pi * time / duration) ** 2
    frequency = f0 * np.array([0.3, 0.8, 1.0, 1.3, 3.0])
    ratio = f0 / frequency
    expected = 1 / np.sqrt((1 - ratio**2) ** 2 + (2 * 0.05 * ratio) ** 2)
    found = response_spectra(grown[:, None], RATE, frequency).pseudo_acceleration[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0.01)


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("f", [0.5, 2.0, 8.0, 20.0])
def test_pulse_as_an_ode_solver_integrates_it(damping: float, f: float):
    def pulse(t):
        return np.exp(-(((t - 2.0) / 0.1) ** 2)) * np.cos(2 * np.pi * 4 * (t - 2.0))

    omega = 2 * np.pi * f

    def motion(t, y):
        return [y[1], -pulse(t) - 2 * damping * omega * y[1] - omega**2 * y[0]]

    time = np.linspace(0, 5 + 1 / f, 20_001)
    solved = solve_ivp(
        motion, (0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-12, max_step=0.01
    ).y
    in_space = -(2 * damping * omega * solved[1] + omega**2 * solved[0])
    samples = pulse(np.arange(0, 5, 1 / RATE))[:, None]
    found = response_spectra(samples, RATE, np.array([f]), damping)
    assert found.displacement[0, 0] == pytest.approx(np.abs(solved[0]).max(), rel=0.01)
    assert found.acceleration[0, 0] == pytest.approx(np.abs(in_space).max(), rel=0.01)
    assert found.pseudo_velocity == pytest.approx(omega * found.displacement)


def test_stiff_oscillator_moves_with_its_base_and_each_channel_by_itself():
    rng = np.random.default_rng(1)
    slow = np.cumsum(rng.standard_normal((2000, 2)), axis=0)
    slow = np.apply_along_axis(np.convolve, 0, slow - slow.mean(0), np.hanning(100), "same")
    together = response_spectra(slow, RATE, np.array([1.0, 40.0]))
    np.testing.assert_allclose(together.acceleration[1], np.abs(slow).max(axis=0), rtol=0.02)
    alone = response_spectra(slow[:, [1]], RATE, np.array([1.0]))
    np.testing.assert_allclose(alone.displacement[0, 0], together.displacement[0, 1])
