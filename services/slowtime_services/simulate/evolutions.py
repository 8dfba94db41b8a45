"""Laws by which a part of a simulated structure changes in slow time."""

from collections.abc import Iterable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime_schemas.quantities import Immutable

from .field_types import NotNegative, Positive


class Unchanged(Immutable):
    """Nothing changes after a first difference from the structure as built."""

    kind: Literal["constant"] = "constant"
    change: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = 0.0

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        return self.change


class Renewable(Immutable):
    """A structure that ages until a renewal, and then starts again as built."""

    renewed_after: Positive | None = None
    """Slow time after which the structure is as built again, and so on; None for never."""

    def age(self, slow_time: float) -> float:
        """Slow time since the structure was last as built."""
        return slow_time if self.renewed_after is None else slow_time % self.renewed_after

    def renewals(self, slow_time: float) -> int:
        """Return the number of renewals of the structure up to `slow_time`."""
        return 0 if self.renewed_after is None else int(slow_time // self.renewed_after)


class Linear(Renewable):
    """A steady drift that stops at a limit."""

    kind: Literal["linear"] = "linear"
    rate: Annotated[
        float, Field(allow_inf_nan=False, description="Change per unit of slow time.")
    ] = -2e-4
    limit: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = -0.5
    begins: float = 0.0
    """Slow time until which nothing changes."""

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        drift = self.rate * max(self.age(slow_time) - self.begins, 0.0)
        return max(drift, self.limit) if self.rate < 0 else min(drift, abs(self.limit))


class StepLoss(Renewable):
    """A sudden change, as after a collision."""

    kind: Literal["step"] = "step"
    at_slow_time: float = 100.0
    change: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = -0.1

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        return self.change if self.age(slow_time) >= self.at_slow_time else 0.0


class FatigueLoss(Renewable):
    """Exponential loss with a ripple, eq. 5.12 of the book."""

    kind: Literal["fatigue"] = "fatigue"
    rate: NotNegative = 4e-4
    ripple: Annotated[float, Field(ge=0, lt=1)] = 0.05
    ripple_rate: NotNegative = 2e-2

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        series = stiffness_change(
            np.array([self.age(slow_time)]),
            rate=self.rate,
            ripple=self.ripple,
            ripple_rate=self.ripple_rate,
        )
        return float(series[0])


class FillingAndEmptying(Immutable):
    """Mass that comes and goes in steps, as in a tank or an aircraft, eq. 5.13 of the book."""

    kind: Literal["filling"] = "filling"
    amplitude: NotNegative = 0.25
    rate: NotNegative = 0.15

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        series = mass_change(np.array([slow_time]), amplitude=self.amplitude, rate=self.rate)
        return float(series[0])


Evolution = Annotated[
    Unchanged | Linear | StepLoss | FatigueLoss | FillingAndEmptying,
    Field(discriminator="kind"),
]


def renewals(evolutions: Iterable[Evolution], slow_time: float) -> int | None:
    """Return the number of renewals up to `slow_time`; None if no part is renewed.

    Examples
    --------
    >>> renewals([FatigueLoss(renewed_after=1000.0), Unchanged()], 2500.0)
    2
    """
    renewed = [
        one
        for one in evolutions
        if isinstance(one, Renewable) and one.renewed_after is not None
    ]
    return sum(one.renewals(slow_time) for one in renewed) if renewed else None
