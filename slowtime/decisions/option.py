"""One thing that may be done with an asset, and what it costs in each future."""

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float

Now = Literal["repair", "inspect", "close", "wait"]
"""What an option does at once."""

BAND = (0.05, 0.95)
"""Quantiles of the cost over futures that are told with each expected cost."""


@dataclasses.dataclass(frozen=True, slots=True)
class Option:
    """Something that may be done.

    Parameters
    ----------
    name
        Of the kind of option, such as `repair_at`.
    now
        What it does at once.
    items
        Discounted items of each future until the horizon.
    curve
        Expected discounted items until each time.
    parameters
        What was optimised, or given: times from now, thresholds [1].
    repair_time
        Of the first planned repair in each future; infinite where there is none, or where it
        hangs on what an inspection finds [time].
    """

    name: str
    now: Now
    items: Float[np.ndarray, "path item"]
    curve: Float[np.ndarray, "time item"]
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    repair_time: Float[np.ndarray, " path"] | None = None

    def quantities(self, weights: Float[np.ndarray, " path"]) -> Float[np.ndarray, " item"]:
        """Compute the expected discounted number of each item.

        Parameters
        ----------
        weights
            Weight of each future; their sum is 1.

        Returns
        -------
        Number of each item.
        """
        found: Float[np.ndarray, " item"] = weights @ self.items
        return found


def band(
    cost: Float[np.ndarray, " path"], weights: Float[np.ndarray, " path"]
) -> tuple[float, float]:
    """Weighted 5 and 95 % quantiles of a cost over futures.

    Parameters
    ----------
    cost
        Cost of each future [currency].
    weights
        Weight of each future; their sum is 1.

    Returns
    -------
    Both quantiles [currency].
    """
    order = np.argsort(cost)
    total = np.cumsum(weights[order])
    places = [min(int(np.searchsorted(total, at)), len(cost) - 1) for at in BAND]
    low, high = (float(cost[order[place]]) for place in places)
    return low, high
