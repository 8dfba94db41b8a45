"""How a part of a simulated structure changes in slow time."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from slowtime.dynamics.degradation import mass_change, stiffness_change

from .fields import Frozen, NotNegative, Positive


class Constant(Frozen):
    """Nothing changes after a first difference from the structure as built."""

    kind: Literal["constant"] = "constant"
    change: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = 0.0

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        return self.change


class Linear(Frozen):
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
        drift = self.rate * max(slow_time - self.begins, 0.0)
        return max(drift, self.limit) if self.rate < 0 else min(drift, abs(self.limit))


class Step(Frozen):
    """A sudden change, as after a collision."""

    kind: Literal["step"] = "step"
    at_slow_time: float = 100.0
    change: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = -0.1

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        return self.change if slow_time >= self.at_slow_time else 0.0


class Fatigue(Frozen):
    """Exponential loss with a ripple, eq. 5.12 of the book."""

    kind: Literal["fatigue"] = "fatigue"
    rate: NotNegative = 4e-4
    ripple: Annotated[float, Field(ge=0, lt=1)] = 0.05
    ripple_rate: NotNegative = 2e-2
    renewed_after: Positive | None = None
    """Slow time after which the structure is as built again, and so on; None for never."""

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        age = slow_time if self.renewed_after is None else slow_time % self.renewed_after
        series = stiffness_change(
            np.array([age]),
            rate=self.rate,
            ripple=self.ripple,
            ripple_rate=self.ripple_rate,
        )
        return float(series[0])


class FillingAndEmptying(Frozen):
    """Mass that comes and goes in steps, as in a tank or an aircraft, eq. 5.13 of the book."""

    kind: Literal["filling"] = "filling"
    amplitude: NotNegative = 0.25
    rate: NotNegative = 0.15

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        series = mass_change(np.array([slow_time]), amplitude=self.amplitude, rate=self.rate)
        return float(series[0])


Evolution = Annotated[
    Constant | Linear | Step | Fatigue | FillingAndEmptying, Field(discriminator="kind")
]
