r"""Exact simulation of an oscillator under a sampled force.

Between two samples the state :math:`x = (q, \dot q)` obeys a linear equation whose solution for
a force that is constant (zero-order hold) or linear (first-order hold) in between is one matrix
exponential. It is the same for every damping, and replaces Newmark and its kin.
"""

import math

import numpy as np
import scipy
import scipy.fft
import scipy.linalg
from jaxtyping import Float

from .oscillator import Oscillator
from .response import frequency_response

Series = Float[np.ndarray, " time"]

FORGOTTEN = 20.0
"""Decay rates times time after which a start is forgotten, to a part in 10^8."""


def transition(
    oscillator: Oscillator, step_s: float
) -> tuple[Float[np.ndarray, "2 2"], Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    r"""Matrices of :math:`x_{k+1} = A x_k + B_0 f_k + B_1 f_{k+1}` for a force linear between.

    For a force that is constant between samples :math:`x_{k+1} = A x_k + (B_0 + B_1) f_k`.
    """
    if not 0 < step_s < math.inf:
        raise ValueError(
            f"{step_s=} is not a valid time step. Give a positive number of seconds."
        )
    m, c, k = (
        oscillator.mass_kg,
        oscillator.damping_n_s_per_m,
        oscillator.stiffness_n_per_m,
    )
    # State, force and its slope in one linear system: its exponential holds all three.
    whole = np.zeros((4, 4))
    whole[0, 1] = 1.0
    whole[1, :3] = -k / m, -c / m, 1.0 / m
    whole[2, 3] = 1.0 / step_s
    moved = scipy.linalg.expm(whole * step_s)
    return moved[:2, :2], moved[:2, 2] - moved[:2, 3], moved[:2, 3]


def simulate(
    oscillator: Oscillator,
    force: Series,
    rate_hz: float,
    *,
    initial: tuple[float, float] = (0.0, 0.0),
    hold: str = "zero",
) -> tuple[Series, Series, Series]:
    """Displacement [m], velocity [m/s] and acceleration [m/s^2] at the samples of the force.

    Parameters
    ----------
    force
        [N], one value per sample.
    initial
        Displacement and velocity at the first sample.
    hold
        ``"zero"``: the force keeps its value until the next sample; ``"first"``: it goes
        straight to the next value.

    Examples
    --------
    >>> spring = Oscillator(1.0, 0.2, 4.0)
    >>> q, v, a = simulate(spring, np.ones(2000), 10.0)
    >>> round(float(q[-1]), 6)
    0.25
    """
    if hold not in ("zero", "first"):
        raise ValueError(f"{hold=} is not a valid way to hold a force. Allowed: zero, first.")
    if len(force) == 0:
        return force * 0.0, force * 0.0, force * 0.0
    a, b0, b1 = transition(oscillator, 1.0 / rate_hz)
    before, now = (b0 + b1, 0.0 * b1) if hold == "zero" else (b0, b1)
    poles = np.array([1.0, -np.trace(a), np.linalg.det(a)])
    motion = []
    for own, other in ((0, 1), (1, 0)):
        # One component of (zI - A)^-1 (before + z now), by Cramer's rule.
        zeros = np.array(
            [
                now[own],
                before[own] + a[own, other] * now[other] - a[other, other] * now[own],
                a[own, other] * before[other] - a[other, other] * before[own],
            ]
        )
        first = a @ np.asarray(initial) + before * force[0]
        # Filter memory with which samples 0 and 1 come out as they must.
        start = initial[own] - zeros[0] * force[0]
        memory = np.array([start, first[own] + poles[1] * initial[own] - zeros[1] * force[0]])
        motion.append(scipy.signal.lfilter(zeros, poles, force, zi=memory)[0])
    q, v = motion
    m, c, k = (
        oscillator.mass_kg,
        oscillator.damping_n_s_per_m,
        oscillator.stiffness_n_per_m,
    )
    return q, v, (force - c * v - k * q) / m


def ambient_acceleration(
    oscillator: Oscillator,
    samples: int,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    force_psd: float = 1.0,
) -> Series:
    r"""Acceleration under white force that is cut off at half the sampling rate [m/s^2].

    Truly white force would make the acceleration infinite, since it holds the force itself;
    a sensor behind an anti-aliasing filter sees it up to half the sampling rate. So the record
    is a stationary Gaussian process of one-sided density

    .. math:: S_a(f) = |(2 \pi f)^2 H(2 \pi f)|^2 \, S_f, \qquad 0 < f < f_s / 2 ,

    made by the inverse Fourier transform of independent Gaussian amplitudes over a period so
    much longer than the record that its ends know nothing of each other.
    """
    if samples < 1:
        raise ValueError(f"{samples=} is not a valid number of samples. Give 1 or more.")
    if oscillator.damping_n_s_per_m == 0:
        raise ValueError(
            "An undamped oscillator under ambient force never becomes stationary. Give it "
            "damping, or integrate a force of your own with simulate()."
        )
    slowest = -oscillator.poles[0].real
    margin = math.ceil(FORGOTTEN / slowest * rate_hz)
    period = scipy.fft.next_fast_len(samples + margin, real=True)
    omega = 2 * np.pi * np.fft.rfftfreq(period, 1.0 / rate_hz)
    gain = omega**2 * np.abs(frequency_response(oscillator, omega))
    amplitude = gain * math.sqrt(force_psd * rate_hz * period) / 2.0
    parts = rng.standard_normal((2, len(omega)))
    spectrum = amplitude * (parts[0] + 1j * parts[1])
    if period % 2 == 0:
        spectrum[-1] = math.sqrt(2.0) * spectrum[-1].real
    return np.asarray(scipy.fft.irfft(spectrum, period)[:samples])
