"""When will a threshold be crossed: the distribution of the time of the first crossing."""

import dataclasses
import functools
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.estimation import sweeps

from . import continuation
from .change import Series
from .continuation import Continuation
from .outlook import JumpLaw, Outlook

SHARES = (0.1, 0.5, 0.9)


@dataclasses.dataclass(frozen=True, slots=True)
class Crossing:
    """When a threshold is first crossed.

    Parameters
    ----------
    threshold
        In the unit of the quantity.
    shares, slow_time
        Probabilities, and the slow time by which the threshold has been crossed with each;
        infinite where that is not within the horizon.
    probability
        That it is crossed within the horizon [1].
    horizon
        Slow time up to which was looked.
    already
        Probability that it has been crossed by now [1].
    """

    threshold: float
    shares: tuple[float, ...]
    slow_time: Float[np.ndarray, " share"]
    probability: float
    horizon: float
    already: float = 0.0

    def words(self) -> str:
        """Say it in a sentence.

        Examples
        --------
        >>> Crossing(-0.2, (0.5,), np.array([np.inf]), 0.03, 900.0).words()
        '50 %: not within the horizon of 900. Crossed within it with probability 3 %.'
        """
        each = ", ".join(
            f"{100 * share:g} %: "
            + (
                f"by {at:.6g}"
                if np.isfinite(at)
                else f"not within the horizon of {self.horizon:g}"
            )
            for share, at in zip(self.shares, self.slow_time, strict=True)
        )
        return f"{each}. Crossed within it with probability {100 * self.probability:.3g} %."


def first_crossing(
    outlook: Outlook,
    slow_time: Series,
    value: Series,
    sd: Series,
    threshold: float,
    horizon: float,
    *,
    shares: tuple[float, ...] = SHARES,
    toward: Literal["below", "above"] | None = None,
    common_sd: float = 0.0,
    points: int = 200,
    paths: int = 4000,
    seed: int = 0,
) -> Crossing:
    """Draw futures, and see when each first crosses the threshold.

    Parameters
    ----------
    outlook
        What `forecast.fit` has learnt.
    slow_time, value, sd
        The history, as for `forecast.fit`.
    threshold
        In the unit of the quantity.
    horizon
        Slow time up to which is looked.
    shares
        Probabilities whose times are asked for.
    toward
        The side that is asked for, which the quantity may be on already; where not given, the
        one on which it is believed not to be now.
    common_sd
        Of the error that all readings share, which no number of them averages out.
    points
        Instants up to the horizon at which a future is looked at, straight between.
    paths, seed
        How many futures, and of which random numbers.
    """
    begun = continuation.begin(outlook, slow_time, value, sd)
    futures = draw(begun, horizon, points=points, paths=paths, seed=seed)
    return futures.crossing(threshold, shares=shares, toward=toward, common_sd=common_sd)


@dataclasses.dataclass(frozen=True, slots=True)
class Futures:
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
    """

    later: Float[np.ndarray, " later"]
    paths: Float[np.ndarray, "path later"]
    common: Float[np.ndarray, " path"]

    def crossing(
        self,
        threshold: float,
        *,
        shares: tuple[float, ...] = SHARES,
        toward: Literal["below", "above"] | None = None,
        common_sd: float = 0.0,
    ) -> Crossing:
        """See when each future first crosses a threshold, as for `first_crossing`."""
        drawn = self.paths + common_sd * self.common[:, None]
        if toward is None:
            side = np.sign(np.median(drawn[:, 0]) - threshold) or 1.0
        else:
            side = 1.0 if toward == "below" else -1.0
        return _first(side * (drawn - threshold), self.later, threshold, shares)


def draw(
    begun: Continuation, horizon: float, *, points: int = 200, paths: int = 4000, seed: int = 0
) -> Futures:
    """Draw futures up to a horizon; the parameters as for `first_crossing`."""
    if not horizon > begun.time:
        raise ValueError(
            f"The horizon {horizon:g} is not after the last reading at {begun.time:g}. Give a "
            "later slow time."
        )
    later = np.linspace(begun.time, horizon, points + 1)
    kinds = list(begun.kinds())
    weights = np.concatenate([weights for _, _, weights in kinds])
    counts = np.random.default_rng(seed).multinomial(paths, weights / weights.sum())
    drawn, first = [], 0
    for process, belief, own in kinds:
        mine, counts = counts[: len(own)], counts[len(own) :]
        owners = np.repeat(np.arange(len(own)), mine)
        shocks = _shocks(seed, paths, points + 2, belief.mean.shape[-1])
        rows = slice(first, first + len(owners))
        drawn.append(sweeps.sample(process, belief, later, owners, shocks[rows]))
        first += len(owners)
    together = np.concatenate(drawn)
    if begun.outlook.further is not None:
        together += _jumps(begun.outlook.further, later, paths, seed)
    return Futures(later, together, _shocks(seed, paths, 1, 1)[:, 0, 0])


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


def _first(
    above: Float[np.ndarray, "path later"],
    later: Float[np.ndarray, " later"],
    threshold: float,
    shares: tuple[float, ...],
) -> Crossing:
    below = above <= 0.0
    crossed = below.any(axis=1)
    k = np.where(crossed, below.argmax(axis=1), 0)
    row, before = np.arange(len(above)), np.maximum(k - 1, 0)
    high, low = above[row, before], above[row, k]
    part = np.where(k > 0, high / np.where(high > low, high - low, 1.0), 0.0)
    at = later[before] + part * (later[k] - later[before])
    when = np.sort(np.where(crossed, at, np.inf))
    places = np.minimum((np.array(shares) * len(when)).astype(int), len(when) - 1)
    return Crossing(
        threshold,
        shares,
        when[places],
        float(crossed.mean()),
        float(later[-1]),
        float(below[:, 0].mean()),
    )
