r"""Frequency and damping of a resonance in a measured frequency response.

.. math:: G(\omega) = \frac{r}{\omega_0^2 - \omega^2 + 2 i \zeta \omega_0 \omega}
    + d_0 + d_1 (\omega - \omega_c)

near a peak, with complex :math:`r, d_0, d_1` eliminated linearly (variable projection).

References
----------
.. [1] G. Golub and V. Pereyra, "Separable nonlinear least squares: the variable projection
   method and its applications", Inverse Problems 19 (2003) R1-R26.
"""

import dataclasses

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float

WIDTH = 6.0
"""[half-power bandwidths] On either side of a peak that are fitted. Source: judgement; beyond,
other modes matter more than three parameters of background can hold."""
MIN_LINES = 8
"""[lines] In that band, at least. Source: four complex numbers are fitted."""
START_DAMPING = 0.05
"""[1] Damping ratio of the first band, where the peak is too narrow to be measured."""


@dataclasses.dataclass(frozen=True, slots=True)
class MeasuredResonance:
    """Natural frequency and damping ratio, with standard deviations."""

    frequency_hz: float
    frequency_sd_hz: float
    damping: float
    damping_sd: float


def fit_resonance(
    frequency_hz: Float[np.ndarray, " line"],
    response: Complex[np.ndarray, " line"],
    sd: Float[np.ndarray, " line"] | None = None,
    near_hz: float | None = None,
) -> MeasuredResonance | None:
    """Fit one mode to a frequency response around its highest peak, or one that is named.

    Parameters
    ----------
    frequency_hz, response
        Lines, and the response of displacement, velocity or acceleration at them.
    sd
        Standard deviation of the response; its scatter about the fit where not known.
    near_hz
        Frequency of the peak.

    Returns
    -------
    The mode; None where there are too few lines.
    """
    size = np.abs(response)
    kept = np.isfinite(size)
    frequency_hz, response, size = frequency_hz[kept], response[kept], size[kept]
    if len(size) < MIN_LINES:
        return None
    peak = int(np.argmax(size))
    if near_hz is not None:
        peak = int(np.argmin(np.abs(frequency_hz - near_hz)))
    centre = float(frequency_hz[peak])
    wide = frequency_hz[size > size[peak] / np.sqrt(2)]
    near = wide[np.abs(wide - centre) < 0.3 * centre]
    half = max(float(np.ptp(near)), 2 * float(np.median(np.diff(frequency_hz))))
    band = np.flatnonzero(np.abs(frequency_hz - centre) <= WIDTH * half)
    if len(band) < MIN_LINES:
        band = np.argsort(np.abs(frequency_hz - centre))[:MIN_LINES]
    omega, seen = 2 * np.pi * frequency_hz[band], response[band]
    known = None if sd is None or not np.isfinite(sd[kept][band]).all() else sd[kept][band]
    weight = np.ones(len(seen)) if known is None else 1 / np.maximum(
        known, 1e-3 * np.median(known) + np.finfo(float).tiny
    )  # fmt: skip

    def residual(parameters: Float[np.ndarray, "2"]) -> Float[np.ndarray, " row"]:
        natural, damping = 2 * np.pi * parameters[0], parameters[1]
        mode = natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega)
        middle = (omega - 2 * np.pi * centre) / (2 * np.pi * centre)
        columns = np.stack([mode, np.ones_like(mode), middle + 0j], axis=1) * weight[:, None]
        target = seen * weight
        left = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
        return np.concatenate([left.real, left.imag])

    start = np.array([centre, min(max(half / (2 * centre), 1e-4), START_DAMPING)])
    found = scipy.optimize.least_squares(residual, start, x_scale=[centre, start[1]])
    spare = 2 * len(seen) - 8
    # Standard deviations of complex numbers are shared by two parts.
    scale = float(found.cost * 2 / max(spare, 1))
    if known is not None:
        scale = max(scale, 0.5)
    slopes = np.asarray(found.jac)
    covariance = scale * np.linalg.pinv(slopes.T @ slopes)
    errors = np.sqrt(np.diag(covariance))
    return MeasuredResonance(
        float(found.x[0]), float(errors[0]), float(abs(found.x[1])), float(errors[1])
    )
