"""Formulas of chapter 5 exactly as printed in the book, for comparison.

None of these is what the twin uses. `stiffness`, `mass` and `joint` are: they give the same
answers for exact data, and for noisy data an unbiased estimate with a standard deviation, an
interval and a judgement. Each docstring here says what is wrong with the form it holds.

The distance is signed, nominal minus current: the norm of eq. 5.17 loses the sign that eq. 5.20
needs. Frequencies and errors are relative to the nominal undamped frequency, so that
`error_sd` is sigma_theta / omega_0; the book's 0.025 has no unit and must be read so.

References
----------
.. [1] R. Ganguli, S. Adhikari, S. Chakraborty, M. Ganguli, "Digital Twin: A Dynamic System and
   Computing Perspective", CRC Press (2023), chapter 5.
"""

import numpy as np
from jaxtyping import Float

from slowtime.evolution.change import Series


def distance(ratio: Series, damping_ratio_0: float) -> Series:
    r"""Signed distance from the nominal damped frequency (eq. 5.19, 5.38).

    .. math:: \tilde d = \sqrt{1 - \zeta_0^2} - \omega_{ds} / \omega_0

    Positive when the frequency has fallen. The sentence after eq. 5.21 has it the other way.

    Parameters
    ----------
    ratio
        Damped frequency over the nominal undamped one [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Distance [1].
    """
    signed: Series = _nominal(damping_ratio_0) - ratio
    return signed


def stiffness(distance: Series, damping_ratio_0: float) -> Series:
    r"""Change of stiffness from an exact distance (eq. 5.20).

    .. math:: \Delta_k = -\tilde d (2 \sqrt{1 - \zeta_0^2} - \tilde d)

    Exact. The book allows any distance below 2; above :math:`\sqrt{1 - \zeta_0^2}` the current
    frequency would be negative and the root returned is spurious.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative change of stiffness [1].
    """
    return -distance * (2.0 * _nominal(damping_ratio_0) - distance)


def stiffness_light_damping(distance: Series) -> Series:
    r"""Change of stiffness, no damping (eq. 5.21); off by :math:`-\tilde d \zeta_0^2`.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].

    Returns
    -------
    Relative change of stiffness [1].
    """
    return -distance * (2.0 - distance)


def stiffness_error_known(distance: Series, error: Series, damping_ratio_0: float) -> Series:
    r"""Change of stiffness when the error of each reading is known (eq. 5.25, corrected).

    .. math:: \Delta_k = -(\tilde d + \theta / \omega_0)
              (2 \sqrt{1 - \zeta_0^2} - \tilde d - \theta / \omega_0)

    The print has :math:`+ \theta / \omega_0` in the last place, which is wrong by
    :math:`2 \theta (\tilde d + \theta)`. Not an estimator: nobody knows the error, and with
    the true one this returns the truth. What the book plots as the twin with erroneous data
    is `stiffness` fed with the erroneous distance.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].
    error
        Error of each reading over the nominal frequency [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative change of stiffness [1].
    """
    return stiffness(distance + error, damping_ratio_0)


def stiffness_error_size_known(
    distance: Series, error_sd: float, damping_ratio_0: float
) -> Series:
    r"""Change of stiffness when the size of the error is known (eq. 5.30, "book" fidelity).

    Eq. 5.20 with :math:`\mathrm{sign}(\tilde d) \sqrt{\tilde d^2 - \sigma^2}` in the place of
    the distance. Not an improvement: it takes the expectation of a square that was read once.
    Fed with one noisy reading, its root is imaginary whenever the distance is below one sigma
    (68 % of readings of an intact structure; held at zero here) and pulls the others towards
    zero. The signed distance itself is already unbiased.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].
    error_sd
        Standard deviation of the error over the nominal frequency [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative change of stiffness [1].
    """
    return stiffness(_shrunk(distance, error_sd), damping_ratio_0)


def mass(distance: Series, damping_ratio_0: float) -> Series:
    r"""Change of mass from an exact distance (eq. 5.39).

    Exact while the current frequency :math:`r = \sqrt{1 - \zeta_0^2} - \tilde d` is positive
    and at most :math:`1 / (2 \zeta_0)`, contrary to "valid for any values of"
    :math:`\zeta_0`; NaN outside. Singular at :math:`r = 0`, so "below 2" is not its domain.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative change of mass [1].
    """
    r0, z2, d = _nominal(damping_ratio_0), damping_ratio_0**2, distance
    under = 1.0 - 4.0 * d**2 * z2 + 8.0 * d * r0 * z2 - 4.0 * z2 + 4.0 * z2**2
    inside = (under >= 0.0) & (d < r0)
    root = np.sqrt(np.where(inside, under, np.nan))
    top = -2.0 * d**2 + 4.0 * d * r0 - 1.0 + 2.0 * z2 + root
    changed: Series = top / np.where(inside, 2.0 * (r0 - d) ** 2, np.nan)
    return changed


def mass_light_damping(distance: Series) -> Series:
    r"""Change of mass, damping neglected (eq. 5.40).

    .. math:: \Delta_m \approx \tilde d (2 - \tilde d) / (1 - \tilde d)^2

    The book calls this one exact where it draws fig. 5.5; its error is
    :math:`\zeta_0^2 [1 - (1 + \Delta_m)^{3/2}]`, or -0.001 at a quarter more mass and 5 % of
    damping. Singular at a distance of 1.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].

    Returns
    -------
    Relative change of mass [1].
    """
    with np.errstate(divide="ignore"):
        changed: Series = distance * (2.0 - distance) / (1.0 - distance) ** 2
    return changed


def mass_error_known(distance: Series, error: Series) -> Series:
    """Change of mass when the error of each reading is known (eq. 5.43).

    Not an estimator, as `stiffness_error_known` is not. The book asks for "distance + error
    below 2" in mixed units; it must be below 1.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].
    error
        Error of each reading over the nominal frequency [1].

    Returns
    -------
    Relative change of mass [1].
    """
    return mass_light_damping(distance + error)


def mass_error_size_known(distance: Series, error_sd: float) -> Series:
    """Change of mass when the size of the error is known (eq. 5.47, "book" fidelity).

    Fails as `stiffness_error_size_known` does, and is held at zero where that one is.

    Parameters
    ----------
    distance
        Signed distance, nominal minus current frequency over the nominal one [1].
    error_sd
        Standard deviation of the error over the nominal frequency [1].

    Returns
    -------
    Relative change of mass [1].
    """
    return mass_light_damping(_shrunk(distance, error_sd))


def stiffness_and_mass(
    distance_real: Series, distance_imaginary: Series, damping_ratio_0: float
) -> tuple[Series, Series]:
    r"""Stiffness and mass from the exact pole (section 5.4.1).

    With :math:`\lambda_s = \omega_0 (-a + i b)`, distances :math:`d_R = a - \zeta_0` and
    :math:`d_I = \sqrt{1 - \zeta_0^2} - b`,

    .. math:: \Delta_m = \frac{-d_R}{\zeta_0 + d_R}, \qquad
              \Delta_k = \frac{\zeta_0 d_R^2 - (1 - 2 \zeta_0^2) d_R + \zeta_0 d_I^2
              - 2 \zeta_0 \sqrt{1 - \zeta_0^2} d_I}{\zeta_0 + d_R} .

    Exact for :math:`\zeta_0 + d_R > 0`, NaN otherwise. An error of the real part comes out
    divided by :math:`\zeta_0`: at 1 % of damping, a hundred times larger.

    Parameters
    ----------
    distance_real, distance_imaginary
        Distances of the pole, over the nominal frequency [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative changes of stiffness and of mass [1].
    """
    z, r0 = damping_ratio_0, _nominal(damping_ratio_0)
    rate = np.where(z + distance_real > 0.0, z + distance_real, np.nan)
    top = z * distance_real**2 - (1.0 - 2.0 * z**2) * distance_real
    top = top + z * distance_imaginary**2 - 2.0 * z * r0 * distance_imaginary
    return top / rate, -distance_real / rate


def stiffness_and_mass_from_ratios(
    frequency_ratio: Series, damping_ratio: Series, damping_ratio_0: float
) -> tuple[Series, Series]:
    r"""Stiffness and mass from natural frequency and damping ratio (5.51, 5.52).

    .. math:: 1 + \Delta_k = \frac{\zeta_0}{\zeta_s} \frac{\omega_s}{\omega_0}, \qquad
              1 + \Delta_m = \frac{\zeta_0}{\zeta_s} \frac{\omega_0}{\omega_s}

    Exact. The book's other pair, natural and damped frequency, is of no use: their ratio
    gives the damping as a small difference of nearly equal numbers.

    Parameters
    ----------
    frequency_ratio
        Natural frequency over the nominal one [1].
    damping_ratio
        Damping ratio [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative changes of stiffness and of mass [1].
    """
    share = damping_ratio_0 / damping_ratio
    return share * frequency_ratio - 1.0, share / frequency_ratio - 1.0


def stiffness_and_mass_error_known(
    distance_real: Series,
    distance_imaginary: Series,
    error_real: Series,
    error_imaginary: Series,
    damping_ratio_0: float,
) -> tuple[Series, Series]:
    """Stiffness and mass when the errors of the pole are known (section 5.4.2).

    The errors are those of the real and the imaginary part of the measured pole. Not an
    estimator, as `stiffness_error_known` is not.

    Parameters
    ----------
    distance_real, distance_imaginary
        Distances of the pole, over the nominal frequency [1].
    error_real, error_imaginary
        Errors of the distances [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative changes of stiffness and of mass [1].
    """
    return stiffness_and_mass(
        distance_real + error_real, distance_imaginary + error_imaginary, damping_ratio_0
    )


def stiffness_and_mass_error_size_known(
    distance_real: Series,
    distance_imaginary: Series,
    error_sd_real: float,
    error_sd_imaginary: float,
    damping_ratio_0: float,
) -> tuple[Series, Series]:
    """Stiffness and mass when the error sizes are known (5.4.3, "book" fidelity).

    The pattern of eq. 5.30 in both distances, with both of its faults.

    Parameters
    ----------
    distance_real, distance_imaginary
        Distances of the pole, over the nominal frequency [1].
    error_sd_real, error_sd_imaginary
        Standard deviations of these errors [1].
    damping_ratio_0
        Nominal damping ratio [1].

    Returns
    -------
    Relative changes of stiffness and of mass [1].
    """
    return stiffness_and_mass(
        _shrunk(distance_real, error_sd_real),
        _shrunk(distance_imaginary, error_sd_imaginary),
        damping_ratio_0,
    )


def _nominal(damping_ratio_0: float) -> float:
    if not 0.0 <= damping_ratio_0 < 1.0:
        raise ValueError(
            f"{damping_ratio_0=} is outside [0, 1), where an oscillator does not ring. "
            "Give a ratio such as 0.02, not a percentage such as 2."
        )
    return float(np.sqrt(1.0 - damping_ratio_0**2))


def _shrunk(distance: Series, error_sd: float) -> Float[np.ndarray, " time"]:
    """Take the expected square of the error off the square of the distance, sign kept."""
    kept: Float[np.ndarray, " time"] = np.sign(distance) * np.sqrt(
        np.maximum(distance**2 - error_sd**2, 0.0)
    )
    return kept
