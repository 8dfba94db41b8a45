"""Distribution of the time at which a forecast first crosses a threshold."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.estimation import filtering
from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Sum
from slowtime.evolution.forecasting.continuation import Continuation
from slowtime.evolution.forecasting.outlook import JumpLaw

from .first_passage import first_passage
from .remaining_life import SHARES, RemainingLife, from_failure_times


@dataclasses.dataclass(frozen=True, slots=True)
class SampledFutures:
    """Futures of a quantity, each a whole path of one process, as often as it is probable.

    Readings that come later move together, which bands at single times do not say.

    Parameters
    ----------
    later
        Instants, from the last reading to the horizon.
    paths
        The quantity at each of them.
    common
        Of each future, the error that all readings share, over its standard deviation.
    roughness
        Of each future, the variance that its diffusion gains over one unit of slow time; 0 for
        one that is smooth between instants or jumps. Rough ones are bridged (`first_passage`).
    chance
        Of each future, the uniform random number by which bridges decide.
    weights
        Posterior probability of each degradation law that took part [1].
    """

    later: Float[np.ndarray, " later"]
    paths: Float[np.ndarray, "path later"]
    common: Float[np.ndarray, " path"]
    roughness: Float[np.ndarray, " path"]
    chance: Float[np.ndarray, " path"]
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def widened(self, factor: float) -> "SampledFutures":
        """Move every future away from their median by a factor, at each instant.

        Parameters
        ----------
        factor
            Spread over the present one, at least 1.

        Returns
        -------
        Futures whose median is as before; diffusion between instants grows likewise.
        """
        if factor == 1.0:
            return self
        middle = np.median(self.paths, axis=0)
        return dataclasses.replace(
            self,
            paths=middle + factor * (self.paths - middle),
            roughness=factor**2 * self.roughness,
        )

    def failure_time(
        self,
        threshold: float,
        *,
        toward: Literal["below", "above"] | None = None,
        common_sd: float = 0.0,
    ) -> Float[np.ndarray, " path"]:
        """Slow time at which each future first crosses a threshold.

        Parameters
        ----------
        threshold
            Threshold [unit of the readings].
        toward
            Side on which the quantity has failed; by default the side away from its present
            median.
        common_sd
            Standard deviation of the error that all readings share [unit of the readings].

        Returns
        -------
        The first instant where a future is across already; infinite where it is not across by
        the horizon.
        """
        drawn = self.paths + common_sd * self.common[:, None]
        if toward is None:
            side = np.sign(np.median(drawn[:, 0]) - threshold) or 1.0
        else:
            side = 1.0 if toward == "below" else -1.0
        above = side * (drawn - threshold)
        return first_passage(above, self.later, self.roughness, self.chance)

    def crossing(
        self,
        threshold: float,
        *,
        shares: tuple[float, ...] = SHARES,
        toward: Literal["below", "above"] | None = None,
        common_sd: float = 0.0,
        survived: bool = False,
    ) -> RemainingLife:
        """Distribution of the first crossing of a threshold.

        With `survived`, futures that are across already are left out: it is known that the
        threshold has not been crossed.

        Parameters
        ----------
        threshold
            Threshold, in the unit of the readings.
        shares
            Probabilities whose times are given.
        toward
            Direction of the crossing.
        common_sd
            Standard deviation of a common error.
        survived
            Whether the threshold was not crossed so far.

        Returns
        -------
        Distribution of the time.
        """
        when = self.failure_time(threshold, toward=toward, common_sd=common_sd)
        now = float(self.later[0])
        if survived and bool((when > now).any()):
            when = when[when > now]
        return from_failure_times(
            when, threshold=threshold, now=now, horizon=float(self.later[-1]), shares=shares,
            weights=self.weights,
        )  # fmt: skip


def draw_futures_at(
    begun: Continuation, later: Float[np.ndarray, " later"], *, paths: int, seed: int = 0
) -> SampledFutures:
    """Sample paths at ascending times, the first that of the last reading.

    Parameters
    ----------
    begun
        Continuation of the history.
    later
        Slow times.
    paths
        Number of paths.
    seed
        Seed of the draws.
    """
    points = len(later) - 1
    kinds = list(begun.kinds())
    weights = np.concatenate([weights for _, _, weights in kinds])
    counts = np.random.default_rng(seed).multinomial(paths, weights / weights.sum())
    drawn, rough, first = [], [], 0
    for process, belief, own in kinds:
        mine, counts = counts[: len(own)], counts[len(own) :]
        owners = np.repeat(np.arange(len(own)), mine)
        shocks = _shocks(seed, paths, points + 2, belief.mean.shape[-1])
        rows = slice(first, first + len(owners))
        drawn.append(filtering.sample(process, belief, later, owners, shocks[rows]))
        rough.append(_roughness(process)[owners])
        first += len(owners)
    together = np.concatenate(drawn)
    if begun.outlook.further is not None:
        together += _jumps(begun.outlook.further, later, paths, seed)
    chance = np.random.default_rng([seed, paths]).random(paths)
    common = _shocks(seed, paths, 1, 1)[:, 0, 0]
    return SampledFutures(later, together, common, np.concatenate(rough), chance)


def _roughness(process: SlowProcess | Sum) -> Float[np.ndarray, " member"]:
    """Variance over one unit of time that each member gains by diffusion: Matern 1/2 only."""
    if not isinstance(process, SlowProcess):
        return np.zeros(len(process.logs))
    length, sd = np.broadcast_arrays(np.asarray(process.length), np.asarray(process.sd))
    return np.asarray(2.0 * sd**2 / length if process.smoothness == 0.5 else 0.0 * length)


def _jumps(
    law: JumpLaw, later: Float[np.ndarray, " later"], paths: int, seed: int
) -> Float[np.ndarray, "path later"]:
    """Draw what further jumps add to each future."""
    rng = np.random.default_rng([seed, law.count])
    counts = rng.poisson(law.rate * np.diff(later, prepend=later[0]), (paths, len(later)))
    means = law.mean + law.sd / np.sqrt(law.count) * rng.standard_normal((paths, 1))
    sizes = counts * means + np.sqrt(counts) * law.sd * rng.standard_normal(counts.shape)
    return np.asarray(np.cumsum(sizes, axis=1))


@functools.lru_cache(maxsize=4)
def _shocks(
    seed: int, paths: int, steps: int, size: int
) -> Float[np.ndarray, "path step state"]:
    """Random numbers of futures: the same at every call, and half the time that they take.

    Of 2,000 paths over 121 times 4 to 8 MB without a wave, 25 to 45 MB with one.
    """
    rng = np.random.default_rng([seed, size])
    shocks: Float[np.ndarray, "path step state"] = rng.standard_normal((paths, steps, size))
    shocks.flags.writeable = False
    return shocks
