"""Costs of failing, repairing, inspecting, standing still and closing."""

import dataclasses
import math
from typing import Any

import numpy as np
from jaxtyping import Float

ITEMS = ("failure", "repair", "inspection", "downtime", "closing", "closed")
"""What is paid for, in the order of every axis `item`."""

FAILURE, REPAIR, INSPECTION, DOWNTIME, CLOSING, CLOSED = range(len(ITEMS))


@dataclasses.dataclass(frozen=True, slots=True)
class Cost:
    """A cost that is known up to a standard deviation: lognormal, constant where `sd` is 0.

    Parameters
    ----------
    mean, sd
        Mean and standard deviation [currency, or currency per time].

    Raises
    ------
    ValueError
        Where one is negative or not finite, or where `sd` is given of a mean of 0.
    """

    mean: float
    sd: float = 0.0

    def __post_init__(self) -> None:
        finite = math.isfinite(self.mean) and math.isfinite(self.sd)
        if not finite or self.mean < 0 or self.sd < 0 or (self.sd > 0 and self.mean == 0):
            raise ValueError(
                f"A cost of mean {self.mean:g} and sd {self.sd:g} was given. Allowed: finite "
                "numbers of at least 0, and an sd only where the mean is above 0."
            )

    def quantile(self, normal: Float[np.ndarray, " draw"]) -> Float[np.ndarray, " draw"]:
        """Values of the cost at standard normal numbers: exp(m + s z), of the same mean.

        Parameters
        ----------
        normal
            Standard normal numbers z.

        Returns
        -------
        Values [currency, or currency per time].
        """
        if self.sd == 0.0:
            return np.full(len(normal), self.mean)
        spread = math.sqrt(math.log1p((self.sd / self.mean) ** 2))
        return self.mean * np.exp(spread * normal - spread**2 / 2)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """All that an owner pays for; times in one unit throughout, that of the futures.

    Parameters
    ----------
    failure
        Of one failure, the replacement that follows it included [currency].
    repair, inspection
        Of one planned repair, and of one inspection [currency].
    downtime
        Of time out of service after a failure, or during repair or inspection
        [currency/time].
    closing, closed
        Of taking the asset out of service once [currency], and of the time that it is out of
        service from then on [currency/time].
    failure_downtime, repair_downtime, inspection_downtime
        How long each takes [time].
    discount_rate
        r: what is paid at t counts exp(-r t) [1/time].
    """

    failure: Cost
    repair: Cost
    inspection: Cost = Cost(0.0)
    downtime: Cost = Cost(0.0)
    closing: Cost | None = None
    closed: Cost = Cost(0.0)
    failure_downtime: float = 0.0
    repair_downtime: float = 0.0
    inspection_downtime: float = 0.0
    discount_rate: float = 0.0

    def __post_init__(self) -> None:
        for name in (
            "failure_downtime",
            "repair_downtime",
            "inspection_downtime",
            "discount_rate",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(
                    f"{name} = {value:g} was given. Allowed: a finite number of at least 0."
                )

    def _each(self) -> tuple[Cost, ...]:
        closing = self.closing or Cost(0.0)
        return (
            self.failure, self.repair, self.inspection, self.downtime, closing, self.closed,
        )  # fmt: skip

    def prices(self) -> Float[np.ndarray, " item"]:
        """Mean of each item's cost."""
        return np.array([cost.mean for cost in self._each()])

    def draws(self, count: int, seed: int = 0) -> Float[np.ndarray, "draw item"]:
        """Draw costs, the same at every call with the same seed."""
        normal = np.random.default_rng(seed).standard_normal((count, len(ITEMS)))
        each = [cost.quantile(z) for cost, z in zip(self._each(), normal.T, strict=True)]
        return np.column_stack(each)

    @property
    def is_uncertain(self) -> bool:
        """Whether any cost has a standard deviation."""
        return any(cost.sd > 0 for cost in self._each())

    def event(self, item: int) -> Float[np.ndarray, " item"]:
        """How much of each item one failure, repair or inspection takes."""
        found = np.zeros(len(ITEMS))
        found[item] = 1.0
        lasting = {
            FAILURE: self.failure_downtime,
            REPAIR: self.repair_downtime,
            INSPECTION: self.inspection_downtime,
        }
        found[DOWNTIME] = lasting.get(item, 0.0)
        return found

    def price(self, item: int) -> float:
        """Mean cost of one failure, repair or inspection, its downtime included."""
        return float(self.event(item) @ self.prices())

    def with_price(self, item: int, mean: float) -> "Costs":
        """Change the mean of one item and keep its relative standard deviation.

        Parameters
        ----------
        item
            Index of the item.
        mean
            Its new mean [currency, or currency per time].

        Returns
        -------
        The changed costs.
        """
        old = self._each()[item]
        sd = old.sd * mean / old.mean if old.mean > 0 and mean > 0 else 0.0
        changed: dict[str, Any] = {ITEMS[item]: Cost(mean, sd)}
        return dataclasses.replace(self, **changed)


def discount(time: Float[np.ndarray, " time"], rate: float) -> Float[np.ndarray, " time"]:
    """Weight exp(-r t) of a payment at each time [1].

    Parameters
    ----------
    time
        Times from now [time].
    rate
        Discount rate r [1/time].
    """
    return np.exp(-rate * time)
