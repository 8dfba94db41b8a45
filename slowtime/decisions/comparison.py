"""Which option is best now, whether that is known, and at what cost it would change."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .costs import ITEMS, Costs
from .option import BAND, Option

DRAWS = 2000
"""Draws of uncertain costs: the ends of a 90 % interval lie within about 2 % of it."""


@dataclasses.dataclass(frozen=True, slots=True)
class BreakEven:
    """Cost of an item at which the two options cost the same, all else as it is.

    Parameters
    ----------
    item
        Name of the item.
    given, at
        Its mean as given, and where the ranking changes [currency, or currency/time].
    """

    item: str
    given: float
    at: float


@dataclasses.dataclass(frozen=True, slots=True)
class Ranking:
    """The best option, and the best of those that do something else now.

    Parameters
    ----------
    best, other
        Index of each among the options; `other` is None where all do the same now.
    difference
        Expected cost of `other` minus that of `best` [currency].
    low, high
        5 and 95 % ends of the difference, over draws of uncertain costs and the sampling error
        of the futures (common to both options).
    break_even
        Costs at which the ranking changes.
    """

    best: int
    other: int | None
    difference: float
    low: float
    high: float
    break_even: tuple[BreakEven, ...]

    @property
    def is_known(self) -> bool:
        """Whether the best is cheaper over the whole band."""
        return self.other is None or self.low > 0.0


def rank(
    options: Sequence[Option], weights: Float[np.ndarray, " path"], costs: Costs, seed: int = 0
) -> Ranking:
    """Compare options on common futures and common draws of costs.

    Parameters
    ----------
    options
        Options to compare, with their items in the same futures.
    weights
        Weight of each future; their sum is 1.
    costs
        Costs of the items.
    seed
        Seed of the draws of costs.

    Returns
    -------
    Best option, best one that does something else now, and the difference of their costs.
    """
    prices = costs.prices()
    means = np.array([float(option.quantities(weights) @ prices) for option in options])
    best = int(means.argmin())
    others = [k for k, each in enumerate(options) if each.now != options[best].now]
    if not others:
        return Ranking(best, None, 0.0, 0.0, 0.0, ())
    other = min(others, key=lambda k: means[k])
    apart = options[other].items - options[best].items
    quantity = weights @ apart
    difference = float(quantity @ prices)
    of_paths = apart @ prices - difference
    error = float(np.sqrt(np.sum((weights * of_paths) ** 2)))
    rng = np.random.default_rng(seed)
    drawn = costs.draws(DRAWS, seed) @ quantity + error * rng.standard_normal(DRAWS)
    low, high = (float(end) for end in np.quantile(drawn, BAND))
    return Ranking(
        best, other, difference, low, high, _break_even(quantity, prices, difference)
    )


def _break_even(
    quantity: Float[np.ndarray, " item"], prices: Float[np.ndarray, " item"], difference: float
) -> tuple[BreakEven, ...]:
    found = []
    for name, amount, price in zip(ITEMS, quantity.tolist(), prices.tolist(), strict=True):
        if price > 0.0 and abs(amount) > 1e-12:
            at = price - difference / amount
            if at > 0.0:
                found.append(BreakEven(name, price, at))
    return tuple(sorted(found, key=lambda one: abs(np.log(one.at / one.given))))
