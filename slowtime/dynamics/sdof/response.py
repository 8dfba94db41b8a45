r"""Closed-form responses of an oscillator, for every damping.

All of it rests on the free motion :math:`q = q_0 C + v_0 S` with

.. math:: S(t) = e^{-\zeta \omega_n t} \frac{\sin \omega_d t}{\omega_d}, \qquad
          C(t) = e^{-\zeta \omega_n t} \cos \omega_d t + \zeta \omega_n S(t) ,

whose limits at and beyond critical damping are taken here once and for all. The book's print
loses the exponential in the second form of eq. 3.42 and in 3.43, and writes
:math:`\omega_n` for :math:`\omega_d` in 3.46; here they are as in its eq. 3.42, first form.
"""

import numpy as np
from jaxtyping import Complex, Float

from .oscillator import Oscillator

Series = Float[np.ndarray, " time"]


def impulse_response(oscillator: Oscillator, times: Series) -> Series:
    r"""Displacement after a unit impulse at time zero, :math:`h = S / m` (eq. 3.46) [m/(N s)].

    Zero before the impulse.
    """
    after = np.maximum(times, 0.0)
    return np.where(times > 0, _sine(oscillator, after), 0.0) / oscillator.mass_kg


def free_response(
    oscillator: Oscillator, times: Series, displacement: float, velocity: float
) -> tuple[Series, Series]:
    """Displacement [m] and velocity [m/s] after release at time zero (eq. 3.42, 3.45)."""
    if np.any(times < 0):
        raise ValueError(
            f"times hold {times.min()}: nothing is known of before the release. Give times of "
            "zero or more."
        )
    sine, cosine = _sine(oscillator, times), _cosine(oscillator, times)
    rate = oscillator.decay_rate
    stiff = oscillator.stiffness_n_per_m / oscillator.mass_kg
    return (
        displacement * (cosine + rate * sine) + velocity * sine,
        velocity * (cosine - rate * sine) - displacement * stiff * sine,
    )


def step_response(
    oscillator: Oscillator, times: Series, force: float = 1.0
) -> tuple[Series, Series]:
    """Response from rest to a constant force that is applied at time zero.

    Gives displacement [m] and velocity [m/s].
    """
    static = force / oscillator.stiffness_n_per_m
    displacement, velocity = free_response(oscillator, times, -static, 0.0)
    return displacement + static, velocity


def harmonic_response(
    oscillator: Oscillator,
    times: Series,
    frequency: float,
    displacement: float = 0.0,
    velocity: float = 0.0,
    *,
    force: float = 1.0,
) -> tuple[Series, Series]:
    r"""Total motion under :math:`F \cos \omega t`: steady state and transient.

    Section 3.2.2 calls this the steady-state response; it is the total one.

    Gives displacement [m] and velocity [m/s]. Raises `ValueError` if an undamped oscillator is
    driven at its own frequency: no steady state exists.
    """
    if oscillator.damping_n_s_per_m == 0 and frequency == oscillator.natural_frequency:
        raise ValueError(
            f"An undamped oscillator driven at its natural frequency {frequency} rad/s has no "
            "steady state. Give it damping, or integrate with stepping.simulate."
        )
    gain = complex(frequency_response(oscillator, np.array([frequency]))[0]) * force
    steady = gain * np.exp(1j * frequency * times)
    transient = free_response(
        oscillator, times, displacement - gain.real, velocity - (1j * frequency * gain).real
    )
    return steady.real + transient[0], (1j * frequency * steady).real + transient[1]


def frequency_response(
    oscillator: Oscillator, omega: Float[np.ndarray, " frequency"]
) -> Complex[np.ndarray, " frequency"]:
    r"""Displacement per force [m/N], :math:`1 / (k - \omega^2 m + i \omega c)` (eq. 3.47)."""
    m, c, k = (
        oscillator.mass_kg,
        oscillator.damping_n_s_per_m,
        oscillator.stiffness_n_per_m,
    )
    return np.asarray(1.0 / (k - omega**2 * m + 1j * omega * c))


def _sine(oscillator: Oscillator, t: Series) -> Series:
    r""":math:`e^{-\zeta \omega_n t} \sin(\omega_d t) / \omega_d`, continued to any damping."""
    slow, fast = oscillator.poles
    if slow.imag:
        return np.asarray(np.exp(slow.real * t) * np.sin(slow.imag * t) / slow.imag)
    apart = slow.real - fast.real
    if apart == 0:
        return np.asarray(t * np.exp(slow.real * t))
    # exp of the real roots, since cosh and sinh overflow; expm1, since close roots cancel.
    return np.asarray(-np.exp(slow.real * t) * np.expm1(-apart * t) / apart)


def _cosine(oscillator: Oscillator, t: Series) -> Series:
    r""":math:`e^{-\zeta \omega_n t} \cos \omega_d t`, continued to any damping."""
    slow, fast = oscillator.poles
    if slow.imag:
        return np.asarray(np.exp(slow.real * t) * np.cos(slow.imag * t))
    return np.asarray(0.5 * (np.exp(slow.real * t) + np.exp(fast.real * t)))
