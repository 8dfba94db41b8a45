r"""When a repair takes effect that is ordered at some time.

Ordered at :math:`\tau`, it takes effect at
:math:`e(\tau) = \min\{t \ge \tau + \ell : t \in W\}`
with the lead time :math:`\ell` and the windows :math:`W` in which the asset is accessible.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int

ROUNDING = 1e-9
"""Share of a step [1] by which a time may miss a time of the grid: rounding."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Lead time of a repair, and the windows in which it may take effect.

    Parameters
    ----------
    lead
        Time from the order to the effect, work included [time].
    windows
        Beginning and end of each window, from now, in order and apart [time]; None where the
        asset is always accessible.

    Raises
    ------
    ValueError
        Where the lead time is negative, or windows are out of order.

    Examples
    --------
    >>> season = Access(lead=0.5, windows=((0.2, 0.6), (1.2, 1.6)))
    >>> season.opening(np.array([0.0, 0.3, 0.7, 2.0]))
    array([0.2, 0.3, 1.2, inf])
    >>> season.effect(0.0), season.effect(0.2)
    (0.5, 1.2)
    """

    lead: float = 0.0
    windows: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lead) and self.lead >= 0.0):
            raise ValueError(
                f"A lead time of {self.lead:g} was given. Give a finite time of at least 0."
            )
        ends = [end for window in self.windows or () for end in window]
        if self.windows is not None and (not ends or np.any(np.diff(ends) < 0)):
            raise ValueError(
                f"Windows of access {self.windows} were given. Give at least one, each as "
                "(beginning, end), in order and without overlap."
            )

    @property
    def is_immediate(self) -> bool:
        """Whether every repair takes effect when it is ordered."""
        return self.lead == 0.0 and self.windows is None

    def opening(self, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        """Give the first accessible time at or after each time; infinite where none is."""
        if self.windows is None:
            return time
        begins, ends = np.array(self.windows).T
        place = np.searchsorted(ends, time, side="left")
        at = np.maximum(np.append(begins, np.inf)[place], time)
        return np.asarray(at)

    def closing(self, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        """Give the last accessible time at or before each time; minus infinity for none."""
        if self.windows is None:
            return time
        begins, ends = np.array(self.windows).T
        place = np.searchsorted(begins, time, side="right")
        at = np.minimum(np.append(-np.inf, ends)[place], time)
        return np.asarray(at)

    def effect(self, order: float) -> float:
        """Give the time at which a repair takes effect that is ordered at a time."""
        return float(self.opening(np.array([order + self.lead]))[0])

    def effect_index(self, time: Float[np.ndarray, " time"]) -> Int[np.ndarray, " order"]:
        """Give the index of the effect of an order at each time of a grid, and of none.

        Parameters
        ----------
        time
            Equal steps from 0 [time].

        Returns
        -------
        Index of the first time at or after each effect; the count of times beyond the last,
        and where nothing is ordered (the last entry).
        """
        count = len(time)
        if self.is_immediate:
            return np.arange(count + 1)
        at = self.opening(time + self.lead) / time[1]
        found = np.ceil(np.minimum(at, count) - ROUNDING).astype(int)
        return np.append(np.minimum(found, count), count)

    def planned_index(self, time: Float[np.ndarray, " time"]) -> Int[np.ndarray, " plan"]:
        """Give the first index at or after each at which a planned repair can take effect.

        Parameters
        ----------
        time
            Equal steps from 0 [time].

        Returns
        -------
        Index of the effect; the count of times where there is none, and of the last entry.
        """
        count = len(time)
        possible = np.append(np.isfinite(self.effect_times(time)), True)
        places = np.where(possible, np.arange(count + 1), count)
        return np.asarray(np.minimum.accumulate(places[::-1])[::-1])

    def effect_times(
        self, time: Float[np.ndarray, " time"], *, lead: bool = True
    ) -> Float[np.ndarray, " time"]:
        """Give the last accessible time in the step that ends at each time of a grid.

        Parameters
        ----------
        time
            Equal steps from 0 [time].
        lead
            Whether an order has to come before.

        Returns
        -------
        Times [time]; NaN where no repair can take effect in that step.
        """
        at, slack = self.closing(time), ROUNDING * float(time[1])
        possible = at > np.append(-slack, time[:-1] + slack)
        if lead:
            possible &= at >= self.lead - slack
        return np.where(possible, at, np.nan)

    def on_average(self, horizon: float) -> "Access":
        """Give the access of later cycles: the mean wait for a window added to the lead time.

        A cycle after a repair begins at a time that is not known, so that its windows are not.

        Parameters
        ----------
        horizon
            Time over which waits are averaged [time].

        Returns
        -------
        Access without windows.
        """
        if self.windows is None:
            return self
        asked = np.linspace(0.0, horizon, 1001)
        wait = self.opening(asked) - asked
        wait = wait[np.isfinite(wait)]
        return Access(lead=self.lead + (float(wait.mean()) if len(wait) else horizon))
