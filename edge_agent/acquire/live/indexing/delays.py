"""Bounds the index of a sample by arrival times, since none arrives before it was taken."""

import collections
import itertools
import statistics

ANCHOR_S = 3.0
"""Least delays are taken over this long [s]: of some messages one is hardly delayed. Source:
judgement; no study is recorded."""

SLACK_S = 0.1
"""What arrivals of one device differ by at least [s], on any network and any machine. Source:
judgement; no study is recorded."""

DRIFT = 0.02
"""A nominal rate is within 2 % of the true one, or is another rate [1]. Source: twice the
standard deviation `ClockTolerances.rate`; judgement, no study is recorded."""

ANCHORS = 24
"""Least delays that are kept [1]; the slope through them is that of the device's clock. Source:
judgement, 72 s in all; no study is recorded."""

FEWEST = 4
"""Complete ones among them [1], from which on their slope is believed. Source: judgement; no
study is recorded."""

LEAST_DRIFT = 1e-3
"""What a slope through least delays is uncertain by, at least [1]. Source: judgement; no study
is recorded."""


class Delays:
    """Bounds numbers by arrivals, since no sample arrives before it was taken."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = 1e9 / rate_hz
        self._anchors: collections.deque[tuple[float, int]] = collections.deque(maxlen=ANCHORS)
        """Least delay [ns] and its arrival, of each span of `ANCHOR_S`."""
        self._since_ns = 0
        self._slope, self._drift = 0.0, DRIFT

    def begin(self) -> None:
        """Forget delays, not their slope: numbers may be off by any amount from here on."""
        self._anchors.clear()

    def note(self, next_index: int, arrival_ns: int) -> None:
        """Take up that all samples before `next_index` had come at `arrival_ns`."""
        delay = arrival_ns - next_index * self._period_ns
        if not self._anchors or arrival_ns - self._since_ns > ANCHOR_S * 1e9:
            self._learn()
            self._anchors.append((delay, arrival_ns))
            self._since_ns = arrival_ns
            return
        least, when_ns = self._anchors[-1]
        if delay - least < self._slope * (arrival_ns - when_ns):
            self._anchors[-1] = delay, arrival_ns

    def _learn(self) -> None:
        """Slope of the delays, by the median over pairs: a step of a clock moves it little."""
        if len(self._anchors) < FEWEST:
            return
        slopes = [
            (later - early) / (after - before)
            for (early, before), (later, after) in itertools.combinations(self._anchors, 2)
            if after > before
        ]
        span_ns = self._anchors[-1][1] - self._anchors[0][1]
        if slopes and span_ns > 0:
            self._slope = min(max(statistics.median(slopes), -DRIFT), DRIFT)
            self._drift = min(DRIFT, max(LEAST_DRIFT, SLACK_S * 1e9 / span_ns))

    def _least(self, arrival_ns: int) -> tuple[float, int]:
        """Least delay expected at an arrival [ns], and how long ago it was seen [ns]."""
        ages = [(delay, max(0, arrival_ns - when)) for delay, when in self._anchors]
        # An old one is believed where it is lower than all that its age explains.
        delay, age = min(ages, key=lambda one: one[0] + (self._slope + self._drift) * one[1])
        return delay + self._slope * age, age

    def index_at(self, arrival_ns: int) -> float:
        """Return the index of the next sample, if the message at `arrival_ns` is not late."""
        if not self._anchors:
            return 0.0
        return (arrival_ns - self._least(arrival_ns)[0]) / self._period_ns

    def slack(self, arrival_ns: int, least_s: float = SLACK_S) -> float:
        """Return the greatest error of `index_at` [samples].

        The least delays of one time and another differ by `least_s`, apart from drift.
        """
        if not self._anchors:
            return float("inf")
        _, age = self._least(arrival_ns)
        return 2 + (least_s * 1e9 + self._drift * age) / self._period_ns

    def is_ahead(self, next_index: int, arrival_ns: int) -> bool:
        """Whether samples up to `next_index` cannot have been taken at `arrival_ns`."""
        if not self._anchors:
            return False
        return next_index > self.index_at(arrival_ns) + self.slack(arrival_ns)

    def lasts_ns(self, samples: int) -> float:
        """Return the time in which so many samples are taken [ns]."""
        return samples * self._period_ns

    def lag(self, next_index: int, arrival_ns: int) -> float:
        """Return the delay of an arrival over the least delayed ones [samples]."""
        return self.index_at(arrival_ns) - next_index

    def lag_s(self, next_index: int, arrival_ns: int) -> float:
        """Return the delay of an arrival over the least delayed ones [s]."""
        return self.lag(next_index, arrival_ns) * self._period_ns / 1e9
