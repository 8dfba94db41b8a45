"""Load histories by name: harmonic, step and white noise."""

import math

import numpy as np
from jaxtyping import Float

Series = Float[np.ndarray, " time"]


def instants(duration_s: float, rate_hz: float) -> Series:
    """Compute the times of the samples, the first at 0.

    Examples
    --------
    >>> instants(1.0, 4.0)
    array([0.  , 0.25, 0.5 , 0.75])
    """
    if not (0 < rate_hz < math.inf and 0 < duration_s < math.inf):
        raise ValueError(
            f"{duration_s=} at {rate_hz=} are no samples. Give seconds and samples per second, "
            "both above 0."
        )
    return np.arange(max(round(duration_s * rate_hz), 1)) / rate_hz


def harmonic(
    times: Series, amplitude: float, frequency_hz: float, phase_deg: float = 0.0
) -> Series:
    r"""Compute :math:`A \cos(2 \pi f t + \varphi)`.

    Examples
    --------
    >>> harmonic(np.array([0.0, 0.5]), 2.0, 1.0)
    array([ 2., -2.])
    """
    phase = 2.0 * np.pi * frequency_hz * times + np.deg2rad(phase_deg)
    return np.asarray(amplitude * np.cos(phase))


def step(times: Series, amplitude: float, at_s: float = 0.0) -> Series:
    """Load that is 0 before `at_s` and `amplitude` from then on.

    Examples
    --------
    >>> step(np.array([0.0, 1.0, 2.0]), 5.0, at_s=1.0)
    array([0., 5., 5.])
    """
    return np.where(times >= at_s, amplitude, 0.0)


def white(times: Series, psd: float, rate_hz: float, rng: np.random.Generator) -> Series:
    r"""White noise up to half the sampling rate.

    Its variance is :math:`S f_s / 2`.

    Its density `psd` is one-sided [unit^2/Hz].

    Examples
    --------
    >>> found = white(np.arange(10_000) / 50.0, 0.04, 50.0, np.random.default_rng(1))
    >>> bool(abs(found.var() - 1.0) < 0.05)
    True
    """
    if not psd >= 0:
        raise ValueError(
            f"{psd=} is not a valid density. Give 0 or more, in the load's unit^2/Hz."
        )
    return math.sqrt(0.5 * psd * rate_hz) * rng.standard_normal(len(times))
