"""Degradation laws weighed by evidence, and the futures that they allow together."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from slowtime.evolution.forecasting.outlook import Outlook
from slowtime.evolution.life.remaining_life import SHARES, RemainingLife
from slowtime.evolution.life.threshold_crossing import SampledFutures

from .fleet import FleetPrior
from .gaussian import NAME as GAUSSIAN
from .gaussian import GaussianLaw
from .history import KnownChange, Series, history_of
from .law import DegradationLaw, Posterior
from .registry import PRIOR_WEIGHTS, STANDARD

BOUND = -1.0
"""Physical bound of a relative change [1]: at -1 nothing is left."""

NEGLIGIBLE = 1e-3
"""Posterior probability below which a law takes no part in forecasts [1]."""

MISFIT = 0.005
"""Posterior predictive p-value below which no law fits the readings [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Mixture:
    """Degradation laws with what each believes after the readings so far.

    Parameters
    ----------
    posteriors
        Of each law by name.
    prior
        Prior probability of each law [1].
    now
        Slow time of the last reading.
    bound
        Lower bound of the quantity: paths end on it.
    """

    posteriors: Mapping[str, Posterior]
    prior: Mapping[str, float]
    now: float
    bound: float = BOUND

    @property
    def weights(self) -> dict[str, float]:
        """Posterior probability of each law, by evidence [1]."""
        names = list(self.posteriors)
        log = np.array(
            [np.log(self.prior[name]) + self.posteriors[name].log_evidence for name in names]
        )
        log = np.where(np.isnan(log), -np.inf, log)
        share = np.exp(log - logsumexp(log))
        return dict(zip(names, share.tolist(), strict=True))

    @property
    def p_value(self) -> float:
        """Posterior predictive probability of a misfit as large, over all laws [1]."""
        used = {name: share for name, share in self.weights.items() if share >= NEGLIGIBLE}
        return float(sum(share * self.posteriors[name].p_value for name, share in used.items()))

    @property
    def warning(self) -> str | None:
        """Say that no law fits, and what to do; None where one does."""
        p_value = self.p_value
        if p_value >= MISFIT:
            return None
        likeliest = max(self.weights.items(), key=lambda item: item[1])[0]
        return (
            f"No degradation law fits the readings: a misfit as large as theirs has a "
            f"probability of {p_value:.1g} under the likeliest, {likeliest}. Check the "
            "standard deviations of the readings, or give a law of your own."
        )

    def follow(self, time: Series, value: Series, sd: Series) -> "Mixture":
        """Update every law by further readings, at a constant cost each.

        Parameters
        ----------
        time, value, sd
            Slow time, value, and standard deviation of each reading; NaN readings are left out.

        Returns
        -------
        The laws after the readings.

        Raises
        ------
        ValueError
            Where one is earlier than the last: learn anew from all readings in order.
        """
        usable = np.isfinite(time) & np.isfinite(value) & np.isfinite(sd) & (sd >= 0.0)
        order = np.argsort(time[usable], kind="stable")
        at, seen, spread = (one[usable][order] for one in (time, value, sd))
        if not len(at):
            return self
        if at[0] < self.now:
            raise ValueError(
                f"A reading at slow time {at[0]:g} was given after one at {self.now:g}. Learn "
                "anew from all readings in order."
            )
        told = {name: one.follow(at, seen, spread) for name, one in self.posteriors.items()}
        return dataclasses.replace(self, posteriors=told, now=float(at[-1]))

    def futures(
        self,
        horizon: float,
        *,
        points: int = 120,
        paths: int = 2000,
        seed: int = 0,
        only: str | None = None,
    ) -> SampledFutures:
        """Draw paths from the posterior, each law as often as it is probable.

        Parameters
        ----------
        horizon
            Slow time up to which paths are drawn.
        points, paths, seed
            Steps up to the horizon, how many paths, and of which random numbers: the same
            seed gives the same numbers, so that plans can be compared by common ones.
        only
            Name of one law, to see what it says alone.

        Returns
        -------
        Futures whose paths are never below `bound`. Paths are ended on the bound, not
        reflected: that keeps the order of values, so that quantiles of the bounded paths are
        bounded quantiles, and first passages through any threshold above it stay as they are.
        """
        if not horizon > self.now:
            raise ValueError(
                f"The horizon {horizon:g} is not after the last reading at {self.now:g}. Give "
                "a later slow time."
            )
        later = np.linspace(self.now, horizon, points + 1)
        weights = {only: 1.0} if only is not None else self.weights
        used = {name: share for name, share in weights.items() if share >= NEGLIGIBLE}
        counts = _counts(paths, np.array(list(used.values())))
        drawn = [
            self.posteriors[name].draw(later, int(count), np.random.default_rng([seed, k, 77]))
            for k, (name, count) in enumerate(zip(used, counts.tolist(), strict=True))
        ]
        rng = np.random.default_rng([seed, paths, 78])
        common, chance = rng.standard_normal(paths), rng.random(paths)
        return SampledFutures(
            later,
            np.maximum(np.concatenate([one.paths for one in drawn]), self.bound),
            common,
            np.concatenate([one.roughness for one in drawn]),
            chance,
            weights,
        )

    def remaining_life(
        self,
        threshold: float,
        horizon: float,
        *,
        toward: Literal["below", "above"] | None = None,
        common_sd: float = 0.0,
        survived: bool = True,
        shares: tuple[float, ...] = SHARES,
        points: int = 120,
        paths: int = 2000,
        seed: int = 0,
        only: str | None = None,
    ) -> RemainingLife:
        """Distribution of the time of the first crossing of a threshold.

        Parameters
        ----------
        threshold, horizon
            In the unit of the quantity, and the slow time up to which is looked.
        toward
            The side that is asked for; None for the one where the quantity is not now.
        common_sd
            Of the error that all readings share, in the unit of the quantity.
        survived
            Whether it is known that the threshold has not been crossed by now.
        shares
            Probabilities whose times are told.
        points, paths, seed, only
            As for `futures`.

        Returns
        -------
        Distribution of the time of the first crossing.
        """
        futures = self.futures(horizon, points=points, paths=paths, seed=seed, only=only)
        return futures.crossing(
            threshold, shares=shares, toward=toward, common_sd=common_sd, survived=survived
        )

    def hyperparameters(self) -> dict[str, FleetPrior]:
        """Give what each law says of its parameters, to be pooled over sister assets."""
        found = {name: one.hyperparameters() for name, one in self.posteriors.items()}
        return {name: one for name, one in found.items() if one is not None}


def learn(
    time: Series,
    value: Series,
    sd: Series,
    *,
    laws: Sequence[DegradationLaw] | None = None,
    outlook: Outlook | None = None,
    events: Sequence[KnownChange] = (),
    origin: float | None = None,
    fleet: Mapping[str, FleetPrior] | None = None,
    prior: Mapping[str, float] | None = None,
    bound: float = BOUND,
) -> Mixture:
    """Learn every law from the readings of one quantity, and weigh them by evidence.

    Parameters
    ----------
    time, value, sd
        Readings in any order: slow time, value and its known standard deviation. Entries that
        are not finite are missing.
    laws
        The family; by default `registry.STANDARD` and the Gaussian processes.
    outlook
        What `forecast.fit` has learnt from the same readings, where that is known.
    events
        Known jumps and repairs.
    origin
        Slow time at which the age is zero; by default that of the first reading.
    fleet
        Of each law by name, what sister assets say of its parameters (`fleet.pooled`).
    prior
        Prior probability of laws by name, up to a factor; by default `registry.PRIOR_WEIGHTS`,
        and one for a law that is not named there.
    bound
        Lower bound of the quantity.

    Returns
    -------
    The laws with their probabilities.

    Examples
    --------
    >>> t = np.arange(40.0)
    >>> mixture = learn(t, -0.002 * t, np.full(40, 0.002))
    >>> life = mixture.remaining_life(-0.1, 100.0)
    >>> bool(45.0 < life.median < 55.0)
    True
    """
    history = history_of(time, value, sd, events=events, origin=origin)
    family: Sequence[DegradationLaw] = (
        [*STANDARD, GaussianLaw(outlook)] if laws is None else laws
    )
    told = fleet or {}
    posteriors = {law.name: law.learn(history, told.get(law.name)) for law in family}
    if len(posteriors) < len(family):
        names = ", ".join(law.name for law in family)
        raise ValueError(f"Two laws have one name among {names}. Give each its own.")
    odds = {name: (prior or PRIOR_WEIGHTS).get(name, 1.0) for name in posteriors}
    total = sum(odds.values())
    shares = {name: one / total for name, one in odds.items()}
    return Mixture(posteriors, shares, float(history.time[-1]), bound)


def _counts(paths: int, weights: Float[np.ndarray, " law"]) -> np.ndarray:
    """Share paths out by weight: whole parts first, then the largest remainders."""
    exact = paths * weights / weights.sum()
    counts = np.floor(exact).astype(int)
    rest = np.argsort(-(exact - counts), kind="stable")[: paths - counts.sum()]
    counts[rest] += 1
    return np.asarray(counts)


__all__ = ["BOUND", "GAUSSIAN", "Mixture", "learn"]
