"""Remaining life as a distribution of the first crossing of a threshold."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from .probability_words import foretold, probability_in_words

SHARES = (0.1, 0.5, 0.9)
"""Probabilities whose times are told where none are asked for [1]."""

WINDOW = 0.02
"""Half width of the window of the hazard rate, over the time up to the horizon [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class RemainingLife:
    """Distribution of the slow time at which a threshold is first crossed.

    Parameters
    ----------
    threshold
        In the unit of the quantity.
    now, horizon
        Slow time of the last reading, and the latest slow time that was looked at.
    time, probability
        Points of the distribution function, ascending, straight between: the probability that
        the threshold has been crossed by each time [1].
    already
        Probability that it has been crossed by now [1]; 0 where survival is known.
    weights
        Posterior probability of each degradation law [1].
    shares
        Probabilities whose times `slow_time` and `words` tell.
    """

    threshold: float
    now: float
    horizon: float
    time: Float[np.ndarray, " point"]
    probability: Float[np.ndarray, " point"]
    already: float = 0.0
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    shares: tuple[float, ...] = SHARES

    @property
    def within(self) -> float:
        """Probability that the threshold is crossed by the horizon [1]."""
        return float(self.probability[-1]) if len(self.probability) else 0.0

    @property
    def beyond(self) -> float:
        """Probability that it is not crossed by the horizon [1]."""
        return 1.0 - self.within

    @property
    def median(self) -> float:
        """Slow time of the median; infinite where `within` is below one half."""
        return float(self.quantile(0.5))

    @property
    def slow_time(self) -> Float[np.ndarray, " share"]:
        """Slow time by which the threshold has been crossed with each of `shares`."""
        return np.asarray(self.quantile(np.array(self.shares)))

    def cdf(self, t: float | Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Probability that the threshold has been crossed by slow time t.

        Parameters
        ----------
        t
            Slow times; NaN is given beyond the horizon, where nothing is known.

        Returns
        -------
        Probability [1], of the shape of `t`.
        """
        at = np.asarray(t, dtype=float)
        found = (
            np.interp(at, self.time, self.probability, left=0.0) if len(self.time) else 0 * at
        )
        return np.asarray(
            np.where(at > self.horizon, np.nan, np.where(at < self.now, 0.0, found))
        )

    def survival(self, t: float | Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Probability that the threshold has not been crossed by slow time t.

        Parameters
        ----------
        t
            Slow times.

        Returns
        -------
        Probability.
        """
        return np.asarray(1.0 - self.cdf(t))

    def hazard(self, t: float | Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        r"""Hazard rate :math:`-d \ln S / dt`, over a short window.

        Parameters
        ----------
        t
            Slow times.

        Returns
        -------
        Rate [1 / slow time].
        """
        half = WINDOW * (self.horizon - self.now)
        at = np.asarray(t, dtype=float)
        low, high = np.maximum(at - half, self.now), np.minimum(at + half, self.horizon)
        first, last = self.survival(low), self.survival(high)
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = (np.log(first) - np.log(last)) / (high - low)
        return np.asarray(np.where(at > self.horizon, np.nan, rate))

    def quantile(self, p: float | Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Slow time by which the threshold has been crossed with probability p.

        Parameters
        ----------
        p
            Probabilities [1].

        Returns
        -------
        Slow times, none before now; infinite where p is more than `within`.
        """
        share = np.asarray(p, dtype=float)
        if np.any(~((share >= 0.0) & (share <= 1.0))):
            raise ValueError(f"{p} is not a valid probability. Give numbers from 0 to 1.")
        if not len(self.time):
            return np.full(share.shape, np.inf)
        place = np.searchsorted(self.probability, share, side="left")
        inside = np.minimum(place, len(self.time) - 1)
        before = np.maximum(inside - 1, 0)
        rise = self.probability[inside] - self.probability[before]
        part = np.where(
            rise > 0.0, (share - self.probability[before]) / np.where(rise > 0, rise, 1.0), 1.0
        )
        at = self.time[before] + np.clip(part, 0.0, 1.0) * (
            self.time[inside] - self.time[before]
        )
        at = np.where(share <= self.already, self.now, np.maximum(at, self.now))
        return np.asarray(np.where(share > self.within, np.inf, at))

    def words(self) -> str:
        """Say it in a sentence.

        Examples
        --------
        >>> never = np.zeros(0)
        >>> RemainingLife(-0.2, 0.0, 9.0, never, never, shares=()).words()[2:]
        'Crossed by 9 with probability below 1 in 10,000, as of 0.'
        """
        each = ", ".join(
            f"{100 * share:g} %: "
            + (
                f"by {foretold(at, self.now):.12g}"
                if np.isfinite(at)
                else f"not within the horizon of {self.horizon:g}"
            )
            for share, at in zip(self.shares, self.slow_time.tolist(), strict=True)
        )
        within = probability_in_words(self.within)
        return (
            f"{each}. Crossed by {self.horizon:.6g} with probability {within}, as of "
            f"{self.now:.6g}."
        )


def from_failure_times(
    failure_time: Float[np.ndarray, " path"],
    *,
    threshold: float,
    now: float,
    horizon: float,
    shares: tuple[float, ...] = SHARES,
    weights: Mapping[str, float] | None = None,
) -> RemainingLife:
    """Distribution of sampled failure times, each as probable as the others.

    Parameters
    ----------
    failure_time
        Slow time of the first crossing of each path; infinite where not by the horizon.
    threshold, now, horizon, shares, weights
        As for `RemainingLife`.
    """
    count = len(failure_time)
    at = np.sort(failure_time[np.isfinite(failure_time)])
    share = np.arange(1, len(at) + 1) / max(count, 1)
    passed = int(np.searchsorted(at, now, side="right"))
    already = passed / max(count, 1)
    time = np.concatenate([[now], np.maximum(at[passed:], now)])
    probability = np.concatenate([[already], share[passed:]])
    if time[-1] < horizon:
        time, probability = np.append(time, horizon), np.append(probability, probability[-1])
    return RemainingLife(
        threshold, now, horizon, time, probability, already, weights or {}, shares
    )
