"""Indexes the samples of batches by counters, stamps or arrival order.

An index counts lost samples too. Where a device has begun anew, indices go on by the time that
has passed, so that what follows is never joined to what came before.
"""

import abc
import math
from typing import NamedTuple, Protocol, runtime_checkable

from edge_agent.acquire.live.batch import UNIT_NS, Batch
from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.layouts import Stamp

from .delays import Delays

FOLLOWS_WITHIN = 64
"""Two messages so close, by their counters, confirm each other after a jump."""


class BatchPlacement(NamedTuple):
    """A batch and its index; `restart` if the number of missing samples is unknown."""

    first_index: int
    batch: Batch
    restart: bool = False


@runtime_checkable
class Positions(Protocol):
    """Gives each batch its place."""

    def begin_beside(self, other: "Positions", batch: Batch) -> None:
        """Start numbering at the place of `batch` in the numbers of another lane, if known."""
        ...

    def place(self, batch: Batch) -> list[BatchPlacement]:
        """Return indices that are known by now, of this batch or of those that waited."""
        ...

    def finish(self) -> list[BatchPlacement]:
        """Places of those that still wait: nothing will follow for a while."""
        ...


class IndexStep(NamedTuple):
    """The distance of a batch from where it was expected [samples]."""

    samples: int
    restarts: bool = False


class Numbered(abc.ABC):
    """Base of positions by counters and stamps: small steps back are late samples."""

    def __init__(self, rate_hz: float, horizon: int, tally: SampleCounts) -> None:
        self._rate_hz, self._horizon, self._tally = rate_hz, horizon, tally
        self._delays = Delays(rate_hz)
        self._front = 0
        self._arrival_ns = 0
        self._begun = False
        self._suspect: Batch | None = None

    def begin_beside(self, other: Positions, batch: Batch) -> None:
        """Start numbering at the place of `batch` in the numbers of another lane, if known."""
        if not self._begun and isinstance(other, Numbered) and other._begun:
            step = other._step(batch)
            # Counters that are no neighbours say nothing: it begins beside the other lane.
            self._front = other._front + (0 if step.restarts else step.samples)

    def place(self, batch: Batch) -> list[BatchPlacement]:
        """Place a batch; one that contradicts those before waits for the next to confirm it."""
        if not self._begun:
            self._begun = True
            self._expect_after(batch, 0)
            return [self._accept(self._front, batch)]
        step = self._step(batch)
        if self._suspect is not None and (step.restarts or step.samples != 0):
            return self._decide(self._suspect, batch, step)
        if step.restarts:
            self._suspect = batch
            return []
        self._refuse_suspect()
        return [self._follow(batch, step)]

    def finish(self) -> list[BatchPlacement]:
        """Accept batches that wait."""
        suspect, self._suspect = self._suspect, None
        return [] if suspect is None else [self._restart(suspect)]

    def _decide(self, suspect: Batch, batch: Batch, step: IndexStep) -> list[BatchPlacement]:
        if self._confirms(suspect, batch):
            self._suspect = None
            first = self._restart(suspect)
            return [first, *self.place(batch)]
        self._refuse_suspect()
        if step.restarts:
            self._suspect = batch
            return []
        return [self._follow(batch, step)]

    def _refuse_suspect(self) -> None:
        if self._suspect is not None:
            self._tally.add("samples_refused", len(self._suspect.rows))
            self._suspect = None

    def _restart(self, batch: Batch) -> BatchPlacement:
        self._tally.add("sensor_restarts")
        by_time = round(self._delays.index_at(batch.arrival_ns)) - len(batch.rows)
        index = max(self._front + 1, by_time)
        self._expect_after(batch, index)
        return self._accept(index, batch)._replace(restart=True)

    def _follow(self, batch: Batch, step: IndexStep) -> BatchPlacement:
        index = self._front + step.samples
        if step.samples < 0:
            return BatchPlacement(index, batch)
        self._expect_after(batch, step.samples)
        return self._accept(index, batch)

    def _accept(self, index: int, batch: Batch) -> BatchPlacement:
        self._front, self._arrival_ns = index + len(batch.rows), batch.arrival_ns
        self._delays.note(self._front, batch.arrival_ns)
        return BatchPlacement(index, batch)

    def _judge(self, samples: int, batch: Batch) -> IndexStep:
        """Decide whether a batch is late, follows a gap, or follows a restart."""
        if samples < 0:
            return IndexStep(samples, restarts=-samples > self._latest(batch))
        next_index = self._front + samples + len(batch.rows)
        # What this agent itself has dropped had come: no time needs to have passed for it.
        unexplained = samples > batch.dropped
        ahead = unexplained and self._delays.is_ahead(next_index, batch.arrival_ns)
        return IndexStep(samples, restarts=ahead)

    def _latest(self, batch: Batch) -> int:
        """Return how far a late sample may be behind [samples]."""
        return max(self._horizon, 4 * len(batch.rows))

    @abc.abstractmethod
    def _step(self, batch: Batch) -> IndexStep: ...

    @abc.abstractmethod
    def _expect_after(self, batch: Batch, samples: int) -> None: ...

    @abc.abstractmethod
    def _confirms(self, suspect: Batch, batch: Batch) -> bool: ...


class ByStamp(Numbered):
    """Places by the device's stamps: a loop follows their phase and their period.

    Losses are exact as long as the loop's period is within half a sample over the gap.
    """

    PHASE_GAIN, PERIOD_GAIN, LONGEST_LEARNT = 0.1, 0.005, 4
    """Gains that the loop settles at; before, those of a growing least-squares line."""

    def __init__(self, stamp: Stamp, rate_hz: float, horizon: int, tally: SampleCounts) -> None:
        super().__init__(rate_hz, horizon, tally)
        self._unit_ns = UNIT_NS[stamp.unit]
        self._modulus_ns: int = 2**stamp.bits * self._unit_ns
        self._nominal_ns = self._period_ns = 1e9 / rate_hz
        self._expected_ns = 0.0
        self._learnt = 0

    def _first_ns(self, batch: Batch) -> float:
        """Stamp of the first row [ns]."""
        assert batch.stamp is not None
        return batch.stamp * self._unit_ns - batch.stamp_at * self._period_ns

    def _error_ns(self, batch: Batch) -> float:
        """Return the difference of a stamp from the expected one, wraps undone [ns]."""
        error = self._first_ns(batch) - self._expected_ns
        if abs(error) > self._modulus_ns / 2:
            error = math.remainder(error, self._modulus_ns)
        passed = batch.arrival_ns - self._arrival_ns
        if 4 * passed > self._modulus_ns:
            error += self._modulus_ns * round((passed - error) / self._modulus_ns)
        return error

    def _expect_after(self, batch: Batch, samples: int) -> None:
        count = len(batch.rows)
        rest = 0.0
        if self._arrival_ns and 0 <= samples <= self.LONGEST_LEARNT:
            rest = self._error_ns(batch) - samples * self._period_ns
            if abs(rest) < self._nominal_ns:
                rest = self._learn(rest, count)
        self._expected_ns = self._first_ns(batch) - rest + count * self._period_ns

    def _learn(self, rest_ns: float, count: int) -> float:
        """Correct phase and period by the error of a stamp; return the remaining error."""
        self._learnt += 1
        n = self._learnt
        phase = max(self.PHASE_GAIN, 2 * (2 * n + 1) / ((n + 1) * (n + 2)))
        period = max(self.PERIOD_GAIN, 6 / ((n + 1) * (n + 2)))
        low, high = 0.95 * self._nominal_ns, 1.05 * self._nominal_ns
        self._period_ns = min(max(self._period_ns + period * rest_ns / count, low), high)
        return rest_ns * (1 - phase)

    def _step(self, batch: Batch) -> IndexStep:
        return self._judge(round(self._error_ns(batch) / self._period_ns), batch)

    def _confirms(self, suspect: Batch, batch: Batch) -> bool:
        apart = (self._first_ns(batch) - self._first_ns(suspect)) % self._modulus_ns
        return 0 < apart <= FOLLOWS_WITHIN * len(suspect.rows) * self._period_ns


class ByArrival:
    """Places in order of arrival; losses are inferred from pauses that are not made up for.

    After a pause, batches wait for `SETTLE_S`: if the least delay among them is larger than it
    was before by some samples, so many are missing. That is known to about the jitter.
    """

    SETTLE_S, FEWEST = 0.5, 3

    def __init__(self, rate_hz: float, tally: SampleCounts) -> None:
        self._rate_hz, self._tally = rate_hz, tally
        self._delays = Delays(rate_hz)
        self._front = self._waiting_rows = 0
        self._arrival_ns = 0
        self._waiting: list[Batch] = []
        self._least_s = 0.0

    def begin_beside(self, other: Positions, batch: Batch) -> None:
        """Begin with 0: the order of arrival gives no relation to other lanes."""

    def place(self, batch: Batch) -> list[BatchPlacement]:
        """Index a batch, or hold it until the number of missing samples is known."""
        count = len(batch.rows)
        pause_s = (batch.arrival_ns - self._arrival_ns) / 1e9 if self._arrival_ns else 0.0
        self._arrival_ns = batch.arrival_ns
        if self._waiting or pause_s > 0.2 + 10 * count / self._rate_hz:
            lag_s = self._delays.lag_s(
                self._front + self._waiting_rows + batch.dropped + count, batch.arrival_ns
            )
            self._least_s = min(self._least_s, lag_s) if self._waiting else lag_s
            self._waiting.append(batch)
            self._waiting_rows += count + batch.dropped
            since_s = (batch.arrival_ns - self._waiting[0].arrival_ns) / 1e9
            # A clock that was set back would have them wait until it is there again.
            return [] if 0.0 <= since_s < self.SETTLE_S else self.finish()
        return [self._next(batch)]

    def finish(self) -> list[BatchPlacement]:
        """Index the batches that wait."""
        waiting, self._waiting = self._waiting, []
        missing = round(self._least_s * self._rate_hz) if waiting else 0
        if missing >= self.FEWEST:
            self._front += missing
            self._tally.add("samples_lost_inferred", missing)
        self._waiting_rows, self._least_s = 0, 0.0
        return [self._next(batch) for batch in waiting]

    def _next(self, batch: Batch) -> BatchPlacement:
        index = self._front + batch.dropped
        self._front = index + len(batch.rows)
        self._delays.note(self._front, batch.arrival_ns)
        return BatchPlacement(index, batch)
