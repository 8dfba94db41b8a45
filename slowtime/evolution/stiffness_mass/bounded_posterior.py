r"""Posterior of a change within physical bounds: a truncated normal, transformed.

With :math:`\hat r \sim N(r, s^2)` and a prior on :math:`[r_-, r_+]`,

.. math:: p(r \mid \hat r) \propto w(r) \exp(-(r - \hat r)^2 / 2 s^2),
   \qquad w = 1 \text{ or } |d\Delta / dr| .

Both priors rank the changes by :math:`|r - \hat r|`, so the interval of highest density (in
the variable in which the prior is flat) is :math:`[c - t, c + t]` cut at the bounds, with
:math:`c` the allowed ratio nearest to the reading. Unlike an equal-tailed interval it holds a
change that sits on the bound, such as the zero of an intact structure.

Several functions share these parameters:

- `ratio`: damped frequency over the nominal natural frequency [1].
"""

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

from slowtime.evolution.change import Change, FlatIn, PerReading, Readings, Series, flags
from slowtime.evolution.reasons import FAR_OUTSIDE, Reason

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_NEGLIGIBLE = 40.0  # exp(-40): where the density is cut off


@runtime_checkable
class Scale(Protocol):
    """How a frequency ratio maps to a change, monotonically."""

    def change(self, ratio: np.ndarray) -> np.ndarray:
        """Change that gives a frequency ratio.

        Parameters
        ----------
        ratio
            Damped frequency over the nominal natural frequency [1].

        Returns
        -------
        Relative change [1], of the shape of `ratio`.
        """

    def ratio(self, change: np.ndarray) -> np.ndarray:
        """Frequency ratio that a change gives.

        Parameters
        ----------
        change
            Relative change [1].

        Returns
        -------
        Frequency ratio [1], of the shape of `change`.
        """

    def steepness(self, ratio: np.ndarray) -> np.ndarray:
        """Absolute derivative of the change to the frequency ratio.

        Returns
        -------
        Absolute derivative [1], of the shape of `ratio`.
        """


@dataclasses.dataclass(frozen=True, slots=True)
class StiffnessScale:
    """Change of stiffness against frequency ratio; `ground` is 1 - damping_ratio_0^2."""

    ground: PerReading

    def change(self, ratio: np.ndarray) -> np.ndarray:
        """Change of stiffness that gives a frequency ratio.

        Parameters
        ----------
        ratio
            Damped frequency over the nominal natural frequency [1].

        Returns
        -------
        Relative change [1], of the shape of `ratio`.
        """
        return ratio**2 - _column(self.ground, ratio)

    def ratio(self, change: np.ndarray) -> np.ndarray:
        """Frequency ratio that a change of stiffness gives; 0 where it would not ring.

        Parameters
        ----------
        change
            Relative change [1].

        Returns
        -------
        Frequency ratio [1], of the shape of `change`.
        """
        return np.sqrt(np.maximum(change + self.ground, 0.0))

    def steepness(self, ratio: np.ndarray) -> np.ndarray:
        """Absolute derivative of the change to the frequency ratio.

        Returns
        -------
        Absolute derivative [1], of the shape of `ratio`.
        """
        return 2.0 * ratio


@dataclasses.dataclass(frozen=True, slots=True)
class MassScale:
    """Change of mass against frequency ratio, on the branch of light damping."""

    damping_ratio_0: PerReading

    @property
    def highest_ratio(self) -> PerReading:
        """Ratio above which no mass exists."""
        zeta = np.maximum(self.damping_ratio_0, 1e-300)
        highest: PerReading = 0.5 / zeta
        return highest

    def change(self, ratio: np.ndarray) -> np.ndarray:
        """Change of mass that gives a frequency ratio; infinite for ratio zero.

        Parameters
        ----------
        ratio
            Damped frequency over the nominal natural frequency [1].

        Returns
        -------
        Relative change [1], of the shape of `ratio`.
        """
        zeta = _column(self.damping_ratio_0, ratio)
        root = np.sqrt(np.maximum(1.0 - (2.0 * zeta * ratio) ** 2, 0.0))
        with np.errstate(divide="ignore"):
            mass: np.ndarray = 0.5 * (1.0 + root) / ratio**2
        return mass - 1.0

    def ratio(self, change: np.ndarray) -> np.ndarray:
        """Frequency ratio that a change of mass gives, from the least mass of the branch on.

        Parameters
        ----------
        change
            Relative change [1].

        Returns
        -------
        Frequency ratio [1], of the shape of `change`.
        """
        least = 2.0 * np.square(self.damping_ratio_0)
        mass = np.maximum(1.0 + change, np.maximum(least, 1e-12))
        found: np.ndarray = np.sqrt(mass - np.square(self.damping_ratio_0)) / mass
        return found

    def steepness(self, ratio: np.ndarray) -> np.ndarray:
        """Absolute derivative of the change to the frequency ratio.

        Returns
        -------
        Absolute derivative [1], of the shape of `ratio`.
        """
        zeta = _column(self.damping_ratio_0, ratio)
        root = np.sqrt(np.maximum(1.0 - (2.0 * zeta * ratio) ** 2, 1e-12))
        steep: np.ndarray = 2.0 * ratio * (0.5 * (1.0 + root) / ratio**2) ** 2 / root
        return steep

    def mass_and_derivatives(self, ratio: Series) -> tuple[Series, Series, Series]:
        r"""Mass over the nominal one, and its first two derivatives to the frequency ratio [1].

        From :math:`r^2 \mu^2 - \mu + \zeta_0^2 = 0` with
        :math:`q = 2 r^2 \mu - 1 = \sqrt{1 - 4 r^2 \zeta_0^2}`:
        :math:`\mu' = -2 r \mu^2 / q` and
        :math:`\mu'' = -2 \mu^2/q + 8 r^2 \mu^3/q^2 - 8 r^2 \mu^2 \zeta_0^2/q^3`.
        """
        z2, r2 = np.square(self.damping_ratio_0), ratio**2
        q = np.sqrt(np.maximum(1.0 - 4.0 * r2 * z2, 1e-12))
        mass = 0.5 * (1.0 + q) / r2
        square = mass**2
        slope = -2.0 * ratio * square / q
        curvature = (-2.0 + 8.0 * r2 * (mass / q - z2 / q**2)) * square / q
        return mass, slope, curvature


@dataclasses.dataclass(frozen=True, slots=True)
class ChangePosterior:
    """Posterior of a bounded change: where it peaks, its moments, its densest interval."""

    mode: Float[np.ndarray, " time"]
    mean: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    lo: Float[np.ndarray, " time"]
    hi: Float[np.ndarray, " time"]


def bounded_change(
    readings: Readings,
    scale: Scale,
    bounds: tuple[PerReading, PerReading],
    flat_in: FlatIn,
    level: float,
) -> Change:
    """Most probable change within the bounds, its standard deviation and densest interval.

    Parameters
    ----------
    readings
        Frequency ratios with their standard deviations.
    scale
        Map between frequency ratio and change.
    bounds
        Least and largest change possible [1].
    flat_in
        Variable in which the prior is flat.
    level
        Probability of the interval [1].

    Returns
    -------
    Relative changes [1]; readings far outside the bounds are flagged.
    """
    sd = readings.total_sd
    found = posterior(readings.ratio, sd, scale, bounds, flat_in=flat_in, level=level)
    low, high = _window(scale, bounds, readings.ratio)
    outside = np.maximum(low - readings.ratio, readings.ratio - high)
    reasons = readings.reasons | flags(outside > FAR_OUTSIDE * sd, Reason.OUTSIDE_BOUNDS)
    return Change(found.mode, found.sd, found.lo, found.hi, reasons == 0, reasons)


def posterior(
    ratio: Series,
    sd: Series,
    scale: Scale,
    bounds: tuple[PerReading, PerReading],
    *,
    flat_in: FlatIn = "frequency",
    level: float = 0.95,
) -> ChangePosterior:
    """Posterior of the change given one reading each of `ratio` with standard deviation `sd`.

    Parameters
    ----------
    ratio, sd
        Measured frequency ratio and its standard deviation [1]; NaN gives NaN.
    scale
        `StiffnessScale` or `MassScale`.
    bounds
        Least and greatest change that physics allows [1].
    flat_in
        Whether the prior is flat in the frequency ratio or in the change.
    level
        Probability of the interval [1].

    Returns
    -------
    Posterior of each change [1].

    Notes
    -----
    Moments by 64-point Gauss-Legendre quadrature over the part of the window where the
    density exceeds exp(-40) of its peak, about the mean: the textbook recursion for moments
    of a truncated normal law cancels when the reading is far outside the bounds.
    """
    low, high = _window(scale, bounds, ratio)
    nearest = np.clip(ratio, low, high)
    gap = np.abs(ratio - nearest)
    root = np.sqrt(gap**2 + 2.0 * _NEGLIGIBLE * sd**2)
    with np.errstate(invalid="ignore"):
        reach = np.where(root > 0.0, 2.0 * _NEGLIGIBLE * sd**2 / (gap + root), 0.0)
    reach = np.where(np.isnan(ratio), np.nan, reach)
    law = _Law(ratio, sd, nearest, gap, low, high, reach, scale, flat_in == "change")
    points, density = law.on(reach)
    total = density.sum(axis=1)
    changes = scale.change(points)
    mean = (density * changes).sum(axis=1) / total
    variance = (density * (changes - mean[:, None]) ** 2).sum(axis=1) / total
    half = law.half_flat(level)
    if law.weighted:
        half = law.half_weighted(level)
    ends = scale.change(np.stack([law.low_end(half), law.high_end(half)], axis=1))
    return ChangePosterior(
        scale.change(nearest), mean, np.sqrt(variance), ends.min(axis=1), ends.max(axis=1)
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Law:
    """The truncated law of the ratio, and its probability within `t` of the nearest ratio."""

    ratio: Series
    sd: Series
    nearest: Series
    gap: Series
    low: Series
    high: Series
    reach: Series
    scale: Scale
    weighted: bool

    def low_end(self, half: Series) -> Series:
        end: Series = np.maximum(self.low, self.nearest - half)
        return end

    def high_end(self, half: Series) -> Series:
        end: Series = np.minimum(self.high, self.nearest + half)
        return end

    def density(self, points: np.ndarray) -> np.ndarray:
        """Density at `points`, relative to the peak of its Gaussian factor."""
        away = np.abs(points - self.nearest[:, None])
        exponent = away * (away + 2.0 * self.gap[:, None])
        scale = np.maximum(2.0 * self.sd[:, None] ** 2, 1e-300)
        height: np.ndarray = np.exp(-np.minimum(exponent / scale, 700.0))
        return height * self.scale.steepness(points) if self.weighted else height

    def on(self, half: Series) -> tuple[np.ndarray, np.ndarray]:
        """Quadrature points within `half`, and density times quadrature weight there."""
        start, end = self.low_end(half), self.high_end(half)
        width = 0.5 * (end - start)
        points = (0.5 * (start + end))[:, None] + width[:, None] * _NODES
        unit = np.where(width > 0.0, width, 1.0)
        return points, self.density(points) * _WEIGHTS * unit[:, None]

    def half_flat(self, level: float) -> Series:
        """Half-width that holds `level` of a law flat in the ratio, in closed form."""
        with np.errstate(divide="ignore", invalid="ignore"):
            near = np.minimum(self.nearest - self.low, self.high - self.nearest) / self.sd
            far = np.maximum(self.nearest - self.low, self.high - self.nearest) / self.sd
            gap = self.gap / self.sd
            share = level * (ndtr(near) + ndtr(far) - 1.0)
            both_sides = ndtri(0.5 + 0.5 * share)
            one_side = -ndtri(np.maximum(ndtr(near) - share, 0.0))
            inside = np.where(both_sides <= near, both_sides, one_side)
            lost = level * -np.expm1(log_ndtr(-gap - far) - log_ndtr(-gap))
            outside = -ndtri_exp(log_ndtr(-gap) + np.log1p(-lost)) - gap
            half: Series = self.sd * np.where(self.gap > 0.0, outside, inside)
        return np.where(self.sd > 0.0, np.clip(half, 0.0, self.reach), self.reach)

    def half_weighted(self, level: float) -> Series:
        """Half-width that holds `level` of a law flat in the change, by Newton's method.

        The probability is concave in the half-width, so from zero every step stays short of
        the root and the sequence climbs to it.
        """
        total = self.on(self.reach)[1].sum(axis=1)
        half = np.zeros_like(self.reach)
        for _ in range(_NEWTON_STEPS):
            lack = level * total - self.on(half)[1].sum(axis=1) * (half > 0.0)
            ends = np.stack([self.low_end(half), self.high_end(half)], axis=1)
            inside = np.stack(
                [self.nearest - half > self.low, self.nearest + half < self.high], 1
            )
            slope = (self.density(ends) * inside).sum(axis=1)
            step = np.where(slope > 0.0, lack / np.where(slope > 0.0, slope, 1.0), 0.0)
            half = np.clip(half + step, 0.0, self.reach)
        return half


_NEWTON_STEPS = 14


def _window(
    scale: Scale, bounds: tuple[PerReading, PerReading], ratio: Series
) -> tuple[Series, Series]:
    least = np.broadcast_to(np.asarray(bounds[0], dtype=np.float64), ratio.shape)
    most = np.broadcast_to(np.asarray(bounds[1], dtype=np.float64), ratio.shape)
    if not np.all((least >= -1.0) & (least < most) & np.isfinite(most)):
        raise ValueError(
            f"bounds=({bounds[0]}, {bounds[1]}) are not a least and a greatest change, both "
            "finite and not below -1 (all of it gone). Give such as (-0.9, 0.0)."
        )
    ends = scale.ratio(least), scale.ratio(most)
    return np.minimum(*ends), np.maximum(*ends)


def _column(per_reading: PerReading, like: np.ndarray) -> PerReading:
    """`per_reading` shaped to meet `like`, whose first axis is readings."""
    if isinstance(per_reading, np.ndarray) and per_reading.ndim == 1 and like.ndim == 2:
        column: np.ndarray = per_reading[:, None]
        return column
    return per_reading
