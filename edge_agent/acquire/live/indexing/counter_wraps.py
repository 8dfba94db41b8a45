"""Decides after a pause how often a counter has wrapped.

A counter of M samples tells a gap up to a multiple of M. Of the candidates that are left, no
sample may have come before it was taken, which bounds the gap from above; and what came late
because it was held back is made up for by what follows, which bounds it from below. Where more
than one candidate is left, or a device that began anew explains the counter as well, the gap
is not decidable: the least is counted, and the rest told apart.
"""

import math
from typing import NamedTuple

from edge_agent.acquire.live.batch import Batch

from .delays import Delays

JITTER_S = 0.05
"""Least delays of half a second and of the time before it differ by less [s]. Source:
judgement; no study is recorded."""

SETTLE_S = 0.5
"""For so long nothing may have been made up for, before a delay is thought to be none [s].
Source: judgement; no study is recorded."""

QUEUE_S = 0.2
"""A message that was delayed by so much more than those after it was held back with them [s].
Source: judgement; no study is recorded."""

CHANCE = 0.25
"""Share of a wrap that arrivals are inexact by [1], beyond which they do not tell wraps.
Source: judgement; no study is recorded."""

LONGEST_S = 5.0
"""So long batches wait at most [s]. Source: judgement; no study is recorded."""


class PauseVerdict(NamedTuple):
    """The number of wraps of a counter in a pause, and whether it is certain.

    Parameters
    ----------
    wraps
        Of the counter, beyond the gap that it shows.
    unsure
        Samples that may have been lost beyond those.
    restarts
        The device began anew; nothing is known of the gap.
    """

    wraps: int
    unsure: int = 0
    restarts: bool = False


class Pause:
    """Batches since a pause, whose indices are known up to wraps of the counter.

    Parameters
    ----------
    front
        Index after the last sample before the pause.
    wrap
        Samples until the counter wraps.
    least_wraps
        -1 where what came first may be a late sample, else 0.
    may_be_new
        Whether the counter of what came first is that of a device that has just begun.
    """

    def __init__(
        self, delays: Delays, front: int, wrap: int, *, least_wraps: int, may_be_new: bool
    ) -> None:
        self._delays, self._begin, self._wrap = delays, front, wrap
        self._least_wraps, self._may_be_new = least_wraps, may_be_new
        self.held: list[tuple[int, Batch]] = []
        self.front = front
        self._lag = self._first_lag = self._slack = math.inf
        self._last_lag = self._noted_lag = self._emptied_lag = math.inf
        self._emptied_ns = 0
        self._lowered_ns = 0
        self._settle_ns = SETTLE_S * 1e9

    def add(self, index: int, batch: Batch) -> None:
        """Take up a batch, at the place that it has without wraps."""
        lag = self._delays.lag(index + len(batch.rows), batch.arrival_ns)
        if not self.held:
            self._first_lag = lag
        lasts_ns = self._delays.lasts_ns(len(batch.rows))
        if self.held and batch.arrival_ns - self.last_ns > lasts_ns / 2:
            # What came before it was the last of a queue, if there was one.
            self._emptied_lag, self._emptied_ns = self._last_lag, self.last_ns
        self._last_lag = lag
        self.held.append((index, batch))
        self.front = max(self.front, index + len(batch.rows))
        # Messages that are far apart tell later that nothing is made up for.
        self._settle_ns = max(self._settle_ns, 2 * lasts_ns)
        slack = self._delays.slack(batch.arrival_ns, JITTER_S)
        if lag < self._lag:
            self._lag, self._slack = lag, slack
            if self._noted_lag - lag > slack / 2:
                self._noted_lag, self._lowered_ns = lag, batch.arrival_ns

    @property
    def last_ns(self) -> int:
        """Arrival of the last message."""
        return self.held[-1][1].arrival_ns

    def judge(self, *, now: bool = False) -> PauseVerdict | None:
        """Return the verdict on the pause, or the preliminary one."""
        most = math.floor((self._lag + self._slack) / self._wrap)
        least = max(self._least_wraps, math.ceil((self._lag - self._slack) / self._wrap))
        if most < self._least_wraps:
            return PauseVerdict(0, restarts=True)
        queue_s = self._delays.lasts_ns(1) * (self._first_lag - self._lag) / 1e9
        made_up = queue_s > QUEUE_S
        is_new = self._may_be_new and not made_up
        gap = self.held[0][0] + most * self._wrap - self._begin
        if not (least == most == self._least_wraps or self._is_settled()):
            # Where the clock was set back, nothing tells how long they have waited.
            waited_ns = self.last_ns - self.held[0][1].arrival_ns
            if not now and 0 <= waited_ns < LONGEST_S * 1e9:
                return None
            least = self._least_wraps
        is_chance = 2 * self._slack > CHANCE * self._wrap
        if (least > most and made_up) or (least > self._least_wraps and is_chance):
            # A queue is no new beginning; and any delay is about some number of short wraps.
            least = self._least_wraps
        if least > most:
            return PauseVerdict(0, 0 if self._may_be_new else max(0, gap), restarts=True)
        if is_new:
            return PauseVerdict(0, max(0, gap), restarts=True)
        return PauseVerdict(least, (most - least) * self._wrap)

    def _is_settled(self) -> bool:
        """Whether messages come at their pace, so that nothing is left to be made up for."""
        at_pace = self._emptied_lag - self._lag <= self._slack
        return at_pace and self._emptied_ns - self._lowered_ns >= self._settle_ns
