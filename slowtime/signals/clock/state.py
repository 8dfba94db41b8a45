"""The state of the clock estimation of one device."""

import dataclasses
import math

from .line_fit import ClockSpan, Line
from .lower_hull import lowest


@dataclasses.dataclass(frozen=True, slots=True)
class ClockState:
    """What is remembered of the messages of one device.

    Parameters
    ----------
    first_index, first_arrival_ns
        Of the first message; sensor time [s] and delay [s] are counted from there.
    last_index, messages, ignored
        The newest index; messages taken, and left out because their index did not rise.
    width
        Shortest spans in one of `history`.
    history
        Spans, ascending; the last one may still grow.
    waiting
        Shortest spans that were late, or early, in a row: a stall, or a clock that stepped.
    filling
        The shortest span at hand.
    line
        Clock as of the complete spans.
    told
        The same, its slope averaged over the changes that it may have had.
    roughness_s
        Typical distance of a shortest span from the line [s].
    slope, slope_sd
        Assumed, before any of `history`, of the delay gained per sensor time.
    steps, rate_changes, began
        Noticed so far; which of them `history` begins with.
    """

    first_index: int = 0
    first_arrival_ns: int = 0
    last_index: int | None = None
    messages: int = 0
    ignored: int = 0
    width: int = 1
    history: tuple[ClockSpan, ...] = ()
    waiting: tuple[ClockSpan, ...] = ()
    filling: ClockSpan | None = None
    line: Line | None = None
    told: Line | None = None
    roughness_s: float = 0.0
    slope: float = 0.0
    slope_sd: float = 0.0
    steps: int = 0
    rate_changes: int = 0
    began: str = ""

    def posterior(self) -> tuple[float, float, tuple[str, ...]]:
        """Slope, its standard deviation, and flags: what was assumed and measured, together."""
        line = self.told
        if line is None:
            return self.slope, self.slope_sd, ("few",)
        apart = abs(line.slope - self.slope)
        if apart > 4 * math.hypot(line.slope_sd, self.slope_sd):
            return line.slope, line.slope_sd, ("beyond_tolerance",)
        own, prior = line.slope_sd**-2, self.slope_sd**-2
        return (
            (own * line.slope + prior * self.slope) / (own + prior),
            (own + prior) ** -0.5,
            (),
        )

    def offset(self, slope: float) -> tuple[float, float]:
        """Delay of the clock itself at the first message, and its standard deviation [s].

        Parameters
        ----------
        slope
            Delay gained per sensor time [1].
        """
        if self.line is not None:
            return self.line.level - slope * self.line.x, self.line.level_sd
        spans = (*self.history, *self.waiting, *((self.filling,) if self.filling else ()))
        hull = [point for span in spans for point in span.hull]
        if not hull:
            return 0.0, 0.0
        x, y = lowest(hull, slope)
        return y - slope * x, self.jitter_s()

    def jitter_s(self) -> float:
        """Mean delay beyond the least of each span [s]."""
        slope = self.line.slope if self.line is not None else self.slope
        late = [span.lateness_s(slope) for span in self.history]
        return sum(late) / len(late) if late else 0.0
