r"""Damage rates of Gaussian stress from its spectral density, without counting.

With moments :math:`m_n = \int f^n G(f)\, df` of the one-sided density G over frequency in Hz:
zero up-crossings :math:`\nu_0 = \sqrt{m_2 / m_0}`, peaks :math:`\nu_p = \sqrt{m_4 / m_2}`,
bandwidth parameters :math:`\alpha_1 = m_1 / \sqrt{m_0 m_2}`, :math:`\alpha_2 = m_2 /
\sqrt{m_0 m_4}`. Curves speak of **ranges**; of amplitudes the narrow-band rate
:math:`\nu_0 (\sqrt{2 m_0})^m \Gamma(1 + m/2) / C_a` has :math:`C_a = C / 2^m`.

References
----------
.. [1] P. H. Wirsching, M. C. Light, "Fatigue under wide band random stresses", J. Struct. Div.
   ASCE 106 (1980) 1593-1607.
.. [2] T. Dirlik, "Application of computers in fatigue analysis", thesis, University of Warwick
   (1985).
.. [3] D. Benasciutti, R. Tovo, "Spectral methods for lifetime prediction under wide-band
   stationary random processes", Int. J. Fatigue 27 (2005) 867-877.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .curves import SNCurve

Densities = Float[np.ndarray, " point"]

POINTS = 20_000
LARGEST = 12.0
"""Amplitude to which distributions are integrated, in standard deviations of the stress [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class SpectralMoments:
    """Moments of a one-sided spectral density of stress over frequency in Hz."""

    m0: float
    m1: float
    m2: float
    m4: float

    @classmethod
    def of(
        cls, frequency_hz: Float[np.ndarray, " f"], density: Float[np.ndarray, " f"]
    ) -> "SpectralMoments":
        """Integrate a spectral density by the trapezoidal rule.

        Parameters
        ----------
        frequency_hz
            Ascending [Hz].
        density
            One-sided [unit of stress squared per Hz].

        Returns
        -------
        Spectral moments.
        """
        if not (np.isfinite(density).all() and (density >= 0).all() and density.any()):
            raise ValueError(
                "The spectral density has values that are negative, not finite, or all zero. "
                "Give one value of at least 0 for each frequency."
            )
        return cls(*(float(np.trapezoid(frequency_hz**n * density, frequency_hz))
                     for n in (0, 1, 2, 4)))  # fmt: skip

    @property
    def zero_crossings_hz(self) -> float:
        """Expected up-crossings of the mean a second."""
        return math.sqrt(self.m2 / self.m0)

    @property
    def peaks_hz(self) -> float:
        """Expected peaks a second."""
        return math.sqrt(self.m4 / self.m2)

    @property
    def alpha1(self) -> float:
        """Vanmarcke's bandwidth parameter [1]: 1 for a narrow band."""
        return min(1.0, self.m1 / math.sqrt(self.m0 * self.m2))

    @property
    def alpha2(self) -> float:
        """Irregularity factor, up-crossings over peaks [1]: 1 for a narrow band."""
        return min(1.0, self.m2 / math.sqrt(self.m0 * self.m4))


def damage_rate(moments: SpectralMoments, curve: SNCurve, method: str = "dirlik") -> float:
    """Damage per second by Gaussian stress of zero mean [1/s].

    Parameters
    ----------
    moments
        Of the spectral density of the stress.
    curve
        Of one slope or two, with or without a cut-off.
    method
        ``"narrow_band"``: exact for a narrow band, too much otherwise; ``"wirsching_light"``
        corrects it by a factor, ``"tovo_benasciutti"`` between two bounds; ``"dirlik"`` fits
        the distribution of rainflow ranges.

    Examples
    --------
    >>> tone = SpectralMoments(2.0, 10.0, 50.0, 1250.0)  # a narrow band at 5 Hz
    >>> rate = damage_rate(tone, SNCurve(constant=1e9, slope=4.0), "narrow_band")
    >>> round(rate * 1e9 / (5 * (2 * 2.0) ** 2 * math.gamma(3) * 2**4), 9)
    1.0
    """
    if method not in METHODS:
        raise ValueError(f"{method=} is not known. Allowed: {', '.join(METHODS)}.")
    return METHODS[method](moments, curve)


def _narrow_band(moments: SpectralMoments, curve: SNCurve) -> float:
    return moments.zero_crossings_hz * _rayleigh(math.sqrt(moments.m0), curve)


def _wirsching_light(moments: SpectralMoments, curve: SNCurve) -> float:
    m = curve.slope
    width = math.sqrt(1 - moments.alpha2**2)
    a, b = 0.926 - 0.033 * m, 1.587 * m - 2.323
    share = a + (1 - a) * math.pow(1 - width, b)
    return share * _narrow_band(moments, curve)


def _tovo_benasciutti(moments: SpectralMoments, curve: SNCurve) -> float:
    a1, a2 = moments.alpha1, moments.alpha2
    if a2 > 1 - 1e-9:
        return _narrow_band(moments, curve)
    b = (
        (a1 - a2)
        * (1.112 * (1 + a1 * a2 - (a1 + a2)) * math.exp(2.11 * a2) + (a1 - a2))
        / (a2 - 1) ** 2
    )
    lower = moments.peaks_hz * _rayleigh(a2 * math.sqrt(moments.m0), curve)
    return b * _narrow_band(moments, curve) + (1 - b) * lower


def dirlik_density(moments: SpectralMoments, amplitude: Densities) -> Densities:
    """Density of rainflow amplitudes by Dirlik's formula.

    Parameters
    ----------
    moments
        Spectral moments of the stress.
    amplitude
        Amplitudes, in standard deviations of the stress [1].

    Returns
    -------
    Densities over the amplitude in standard deviations [1].
    """
    gamma = moments.alpha2
    x = moments.m1 / moments.m0 * math.sqrt(moments.m2 / moments.m4)
    if gamma > 1 - 1e-9:
        return np.asarray(amplitude * np.exp(-(amplitude**2) / 2))
    d1 = 2 * (x - gamma**2) / (1 + gamma**2)
    r = (gamma - x - d1**2) / (1 - gamma - d1 + d1**2)
    d2 = (1 - gamma - d1 + d1**2) / (1 - r)
    d3 = 1 - d1 - d2
    q = 1.25 * (gamma - d3 - d2 * r) / d1
    return np.asarray(
        d1 / q * np.exp(-amplitude / q)
        + d2 * amplitude / r**2 * np.exp(-(amplitude**2) / (2 * r**2))
        + d3 * amplitude * np.exp(-(amplitude**2) / 2)
    )


def _dirlik(moments: SpectralMoments, curve: SNCurve) -> float:
    amplitude = np.linspace(0.0, LARGEST, POINTS)
    each = curve.damage(2 * math.sqrt(moments.m0) * amplitude)
    density = dirlik_density(moments, amplitude)
    return moments.peaks_hz * float(np.trapezoid(each * density, amplitude))


def _rayleigh(sd: float, curve: SNCurve) -> float:
    """Mean damage of a cycle whose amplitude is Rayleigh with parameter `sd` [1]."""
    if curve.lower_slope is None and curve.cut_off == 0:
        m = curve.slope
        return math.pow(2 * math.sqrt(2) * sd, m) * math.gamma(1 + m / 2) / curve.constant
    amplitude = np.linspace(0.0, LARGEST, POINTS)
    density = amplitude * np.exp(-(amplitude**2) / 2)
    return float(np.trapezoid(curve.damage(2 * sd * amplitude) * density, amplitude))


METHODS: dict[str, Callable[[SpectralMoments, SNCurve], float]] = {
    "narrow_band": _narrow_band,
    "wirsching_light": _wirsching_light,
    "dirlik": _dirlik,
    "tovo_benasciutti": _tovo_benasciutti,
}
