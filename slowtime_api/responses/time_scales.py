"""Two slow time scales of a history: a drift and a recurring part."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.evolution.forecasting.forecast import fit
from slowtime.evolution.time_scales import separation
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_services.argument_checks import Vector, checked

Series = Float[np.ndarray, " reading"]
KINDS = {
    "rough": "an irregular fluctuation",
    "repeating": "a wave that repeats itself",
    "teeth": "sawtooth: a rise or fall that jumps back at regular intervals",
}
"""Kind of the short scale → words."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SeparatedHistory(Result):
    """A history as the sum of a drift and a recurring part.

    Parameters
    ----------
    slow_time, value, sd
        Readings in ascending order, with their standard deviations.
    long, long_sd
        The drift, and its standard deviation, at each reading.
    short, short_sd
        The recurring part likewise.
    kind
        Of the short scale: ``"rough"``, ``"repeating"`` or ``"teeth"``.
    period
        After how long the short scale repeats itself; None where it does not.
    better_model
        ``"additive"``, or ``"mixture"``: a mixture of experts predicts the readings better, so
        the history may change its character at some time.
    log_odds
        Logarithm of the odds for the additive model [1].
    """

    slow_time: Series
    value: Series
    sd: Series
    long: Series
    long_sd: Series
    short: Series
    short_sd: Series
    kind: str
    period: float | None
    better_model: str
    log_odds: float

    @property
    def long_change(self) -> float:
        """Change of the drift from the first reading to the last."""
        return float(self.long[-1] - self.long[0])

    @property
    def long_change_sd(self) -> float:
        """Standard deviation of `long_change`."""
        return float(np.hypot(self.long_sd[0], self.long_sd[-1]))

    @property
    def short_range(self) -> float:
        """Range of the recurring part."""
        return float(np.ptp(self.short))

    @property
    def heading(self) -> str:
        """What was found, in a line."""
        return (
            f"Drift of {self.long_change:.4g} ± {self.long_change_sd:.2g}; short scale: "
            f"{KINDS[self.kind]}, over a range of {self.short_range:.4g}"
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return each reading.

        Returns
        -------
        One dictionary per reading: ``slow_time``, ``value``, ``sd``, ``long``, ``long_sd``,
        ``short`` and ``short_sd``.
        """
        names = ("slow_time", "value", "sd", "long", "long_sd", "short", "short_sd")
        columns = (getattr(self, name).tolist() for name in names)
        return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]

    @checked
    def plot(self, path: str | Path | None = None) -> list[Axes]:
        """Draw readings and drift, and below them the recurring part.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes: of the drift, and of the recurring part.
        """
        axes = new_figure(2)
        for panel, name in zip(axes, ("long", "short"), strict=True):
            value, sd = getattr(self, name), getattr(self, f"{name}_sd")
            panel.fill_between(self.slow_time, value - 1.96 * sd, value + 1.96 * sd, alpha=0.3)
            panel.plot(self.slow_time, value, label=f"{name} scale")
            panel.set(xlabel="slow time", ylabel=f"{name} scale")
        axes[0].plot(self.slow_time, self.value, ".", markersize=3, label="readings")
        axes[0].legend()
        return list(save(axes, path))


@checked
def separate(slow_time: Vector, value: Vector, sd: Vector) -> SeparatedHistory:
    """Separate a history into a drift and a recurring part.

    Parameters
    ----------
    slow_time
        Slow time of each reading, in any unit and any order.
    value, sd
        Readings, such as natural frequencies [Hz], and their standard deviations.

    Returns
    -------
    Both parts with standard deviations at each reading.

    Raises
    ------
    ValueError
        If there are fewer than 8 readings, or lengths differ.

    Examples
    --------
    >>> t = np.arange(60.0)
    >>> found = separate(t, 3.0 - 1e-3 * t + 0.01 * np.sin(t / 2), np.full(60, 1e-3))
    >>> found.kind, round(found.long_change, 2)
    ('repeating', -0.06)
    """
    if not len(slow_time) == len(value) == len(sd):
        raise ValueError(
            f"Series of {len(slow_time)}, {len(value)} and {len(sd)} values were given. Give "
            "one value of each for each reading."
        )
    order = np.argsort(slow_time, kind="stable")
    time, readings, errors = slow_time[order], value[order], sd[order]
    choice = separation.choose(time, readings, errors)
    found = choice.additive
    period = None
    if found.kind != "rough":
        period = fit(time, readings - found.long, errors).period
    return SeparatedHistory(
        slow_time=time, value=readings, sd=errors, long=found.long, long_sd=found.long_sd,
        short=found.short, short_sd=found.short_sd, kind=found.kind, period=period,
        better_model=choice.best, log_odds=choice.log_odds,
    )  # fmt: skip
