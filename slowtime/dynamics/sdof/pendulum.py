r"""The pendulum of section 1.2: small-angle, exact and learnt from data.

.. math:: m L \ddot\theta + m g \sin\theta = 0
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import scipy.special
from jaxtyping import Bool, Float

from slowtime.signals.units import GRAVITY

Series = Float[np.ndarray, " time"]
Samples = Float[np.ndarray, " sample"]


def small_angle_period(length_m: float, gravity: float = GRAVITY) -> float:
    r"""Period of a small swing, :math:`2 \pi \sqrt{L / g}` (eq. 1.5).

    Examples
    --------
    >>> round(small_angle_period(1.0, 9.81), 6)
    2.006067
    """
    return 2 * math.pi * math.sqrt(length_m / gravity)


def period(amplitude: float, length_m: float, gravity: float = GRAVITY) -> float:
    r"""Period :math:`4 \sqrt{L / g} \, K(\sin^2(\theta_0 / 2))` of any amplitude below pi.

    Examples
    --------
    >>> round(period(1.0, 1.0, 9.81), 6)
    2.139138
    """
    _check_amplitude(amplitude)
    # Of one minus the parameter, which near the top is what there is of it.
    quarter = float(scipy.special.ellipkm1(math.cos(amplitude / 2) ** 2))
    return 4 * math.sqrt(length_m / gravity) * quarter


def small_angle_swing(
    times: Series, amplitude: float, length_m: float, gravity: float = GRAVITY
) -> Series:
    r"""Angle :math:`\theta_0 \cos \omega t` after release from rest (eq. 1.3) [rad]."""
    return np.asarray(amplitude * np.cos(math.sqrt(gravity / length_m) * times))


def swing(
    times: Series, amplitude: float, length_m: float, gravity: float = GRAVITY
) -> tuple[Series, Series]:
    r"""Angle [rad] and its rate [rad/s] after release from rest at any amplitude below pi.

    .. math:: \theta = 2 \arcsin(k \operatorname{sn}(\omega t + K)), \qquad k = \sin(\theta_0/2)
    """
    _check_amplitude(amplitude)
    k, omega = math.sin(amplitude / 2), math.sqrt(gravity / length_m)
    quarter = float(scipy.special.ellipkm1(math.cos(amplitude / 2) ** 2))
    sn, cn, _, _ = scipy.special.ellipj(omega * times + quarter, k**2)
    return np.asarray(2 * np.arcsin(k * sn)), np.asarray(2 * k * omega * cn)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PeriodLaw:
    r"""A period learnt from data (eq. 1.6 to 1.8).

    .. math:: T = C \prod_i x_i^{e_i} \, (1 + d_1 \theta^2 + d_2 \theta^4 + \dots)

    fitted in its logarithm.

    Parameters
    ----------
    exponents, exponents_sd
        By quantity.
    amplitude_terms, amplitude_terms_sd
        Of :math:`\theta^2, \theta^4, \dots` in :math:`\ln T`.
    scatter
        Relative standard deviation of a reading about the law.
    seen
        Least and greatest value of each quantity among the data.
    """

    constant: float
    exponents: Mapping[str, float]
    exponents_sd: Mapping[str, float]
    amplitude_terms: tuple[float, ...]
    amplitude_terms_sd: tuple[float, ...]
    scatter: float
    seen: Mapping[str, tuple[float, float]]

    def predict(
        self, quantities: Mapping[str, Samples], amplitude: Samples | None = None
    ) -> tuple[Samples, Bool[np.ndarray, " sample"]]:
        """Predict periods, and tell whether each lies within the range of the data.

        True where none is extrapolated. Raises `ValueError` where other quantities are given
        than the law was learnt from.
        """
        given = dict(quantities) | ({} if amplitude is None else {"amplitude": amplitude})
        if set(given) != set(self.seen):
            raise ValueError(
                f"The law was learnt from {', '.join(self.seen)}; {', '.join(given)} were "
                "given. Give the same quantities."
            )
        log = math.log(self.constant) + sum(
            exponent * np.log(given[name]) for name, exponent in self.exponents.items()
        )
        for power, term in enumerate(self.amplitude_terms, start=1):
            log = log + term * given["amplitude"] ** (2 * power)
        within = [
            (low <= given[name]) & (given[name] <= high)
            for name, (low, high) in self.seen.items()
        ]
        return np.exp(log), np.logical_and.reduce(within)


def learn_period(
    periods: Samples,
    quantities: Mapping[str, Samples],
    amplitude: Samples | None = None,
    *,
    amplitude_powers: int = 2,
) -> PeriodLaw:
    """Fit a power law of a period in the quantities that were recorded with it.

    Parameters
    ----------
    quantities
        Positive numbers by name: length, gravity, mass, …
    amplitude
        [rad]; enters in even powers, since a pendulum swings as far left as right.
    amplitude_powers
        How many of them.

    Raises
    ------
    ValueError
        If the data cannot tell the quantities apart.

    Examples
    --------
    >>> length = np.array([0.2, 0.5, 1.0, 2.0])
    >>> law = learn_period(2 * np.pi * np.sqrt(length / 9.81), {"length": length})
    >>> round(law.exponents["length"], 9)
    0.5
    """
    columns = [np.ones_like(periods), *(np.log(value) for value in quantities.values())]
    if amplitude is not None:
        columns += [amplitude ** (2 * power) for power in range(1, amplitude_powers + 1)]
    design = np.stack(columns, axis=1)
    size = np.linalg.norm(design, axis=0)
    size[size == 0] = 1.0
    free = len(periods) - design.shape[1]
    if (
        free < 0
        or np.linalg.matrix_rank(design / size, tol=1e-8 * len(periods)) < design.shape[1]
    ):
        raise ValueError(
            f"{len(periods)} readings do not tell {design.shape[1] - 1} effects apart. Vary "
            "each quantity by itself, and read more often; leave out what never varied."
        )
    found = np.linalg.lstsq(design / size, np.log(periods), rcond=None)[0] / size
    misfit = np.log(periods) - design @ found
    scatter = math.sqrt(float(misfit @ misfit) / free) if free else math.nan
    spread = (
        scatter * np.sqrt(np.diag(np.linalg.inv((design / size).T @ (design / size)))) / size
    )
    names = list(quantities)
    seen = dict(quantities) | ({} if amplitude is None else {"amplitude": amplitude})
    after = 1 + len(names)
    return PeriodLaw(
        constant=float(np.exp(found[0])),
        exponents=dict(zip(names, found[1:after].tolist(), strict=True)),
        exponents_sd=dict(zip(names, spread[1:after].tolist(), strict=True)),
        amplitude_terms=tuple(found[after:].tolist()),
        amplitude_terms_sd=tuple(spread[after:].tolist()),
        scatter=scatter,
        seen={name: (float(v.min()), float(v.max())) for name, v in seen.items()},
    )


def _check_amplitude(amplitude: float) -> None:
    if not abs(amplitude) < math.pi:
        raise ValueError(
            f"{amplitude=} rad is not below pi, where a pendulum released from rest would not "
            "swing. Give radians, not degrees."
        )
