"""Indexes the samples of batches by a counter of any width."""

import collections
import logging

from edge_agent.acquire.live.batch import Batch
from edge_agent.acquire.live.counts import SampleCounts
from edge_agent.layouts import CounterField

from .counter_wraps import JITTER_S, Pause, PauseVerdict
from .positions import FOLLOWS_WITHIN, BatchPlacement, IndexStep, Numbered

logger = logging.getLogger(__name__)

PAUSE_S = 0.5
"""A device that starts takes longer than this [s], and one that only sends late hardly does.
Source: judgement; no study is recorded."""

FEW = 4
"""A counter that has just begun is below this [counts]; the first samples may be lost. Source:
judgement; no study is recorded."""

RECENT = 64
"""Messages and gaps that are remembered [1], to recognise what comes again or late. Source:
judgement; no study is recorded."""


class ByCounter(Numbered):
    """Places by a counter of samples or messages, of any width.

    After a pause in which it may have wrapped, batches wait until it is known how often.
    """

    def __init__(
        self, counter: CounterField, rate_hz: float, horizon: int, tally: SampleCounts
    ) -> None:
        super().__init__(rate_hz, horizon, tally)
        self._modulus: int = 2**counter.bits
        self._by_message = counter.counts == "messages"
        self._expected = 0
        self._pause: Pause | None = None
        self._counted = 0
        self._recent: collections.deque[tuple[int, int]] = collections.deque(maxlen=RECENT)
        """Counts, wraps undone, of messages that came, and first counts and lengths of gaps."""

    def place(self, batch: Batch) -> list[BatchPlacement]:
        """Index a batch, or hold it until its index is known."""
        if self._pause is not None and self._may_be_new(batch, self._pause.last_ns):
            return [*self._leave(self._pause.judge(now=True)), *self.place(batch)]
        if self._pause is None:
            if not self._begun or self._suspect is not None or not self._opens(batch):
                return super().place(batch)
            self._pause = Pause(
                self._delays,
                self._front,
                self._wrap(batch),
                least_wraps=-1 if self._is_known(batch) else 0,
                may_be_new=self._may_be_new(batch, self._arrival_ns),
            )
            self._pause.add(self._front + self._jump(batch) * self._each(batch), batch)
        else:
            samples = self._jump(batch) * self._each(batch)
            samples -= self._wrap(batch) if self._is_known(batch) else 0
            self._pause.add(self._pause.front + samples, batch)
            if samples < 0:
                return self._leave(self._pause.judge())
        self._expect_after(batch, 0)
        return self._leave(self._pause.judge())

    def finish(self) -> list[BatchPlacement]:
        """Accept batches that wait."""
        placed = [] if self._pause is None else self._leave(self._pause.judge(now=True))
        return [*placed, *super().finish()]

    def _leave(self, verdict: PauseVerdict | None) -> list[BatchPlacement]:
        """Index the batches that waited, as soon as there is a verdict."""
        pause = self._pause
        if pause is None or verdict is None:
            return []
        self._pause = None
        self._tally.add("samples_lost_unsure", verdict.unsure)
        if verdict.unsure:
            logger.warning(
                "Up to %d samples more than counted may be lost: a counter that wraps every %d "
                "samples cannot measure so long a gap, or the sensor has restarted. Give it a "
                "wider counter.",
                verdict.unsure, self._wrap(pause.held[0][1]),
            )  # fmt: skip
        if verdict.unsure and not verdict.restarts:
            self._delays.begin()
        if verdict.restarts:
            (_, first), *others = pause.held
            placed = [self._restart(first)]
            for _, batch in others:
                placed += self.place(batch)
            return placed
        placed = []
        for index, batch in pause.held:
            at = index + verdict.wraps * self._wrap(batch)
            is_late = at < self._front
            placed.append(BatchPlacement(at, batch) if is_late else self._accept(at, batch))
        return placed

    def _opens(self, batch: Batch) -> bool:
        """Whether arrival times must decide what the gap before a batch is."""
        jump, wrap = self._jump(batch), self._wrap(batch)
        if batch.dropped and (batch.dropped - jump * self._each(batch)) % wrap == 0:
            return False
        after = self._front + jump * self._each(batch) + len(batch.rows)
        lag = self._delays.lag(after, batch.arrival_ns)
        if lag < -self._delays.slack(batch.arrival_ns):
            return False  # It could not have been taken: late, or begun anew.
        slack = self._delays.slack(batch.arrival_ns, JITTER_S)
        may_wrap = lag + slack >= wrap
        is_odd = jump > 0 and lag > slack and 4 * lag > wrap
        if jump > 0 and (self._is_late(batch) or self._may_be_new(batch, self._arrival_ns)):
            return True
        return may_wrap or is_odd

    def _jump(self, batch: Batch) -> int:
        """Return the counts from the expected counter to that of a batch, up to wraps."""
        assert batch.counter is not None
        return (batch.counter - self._expected) % self._modulus

    def _is_late(self, batch: Batch) -> bool:
        """Whether a jump ahead may as well be a small one back."""
        back = (self._modulus - self._jump(batch)) * self._each(batch)
        return back <= min(self._latest(batch), self._wrap(batch) // 2)

    def _is_known(self, batch: Batch) -> bool:
        """Whether a late batch is one that came before, or belongs in a gap."""
        count = self._counted + self._jump(batch) - self._modulus
        return self._is_late(batch) and any(
            first <= count < first + length for first, length in self._recent
        )

    def _may_be_new(self, batch: Batch, since_ns: int) -> bool:
        """Whether a batch may be the first after a restart of the device."""
        assert batch.counter is not None
        passed_s = (batch.arrival_ns - since_ns) / 1e9
        is_pause = passed_s > PAUSE_S + 5 * len(batch.rows) / self._rate_hz
        return is_pause and batch.counter % self._modulus < FEW

    def _each(self, batch: Batch) -> int:
        """Return the samples of one count."""
        return len(batch.rows) if self._by_message else 1

    def _wrap(self, batch: Batch) -> int:
        """Return the samples until the counter wraps."""
        return self._modulus * self._each(batch)

    def _expect_after(self, batch: Batch, samples: int) -> None:
        assert batch.counter is not None
        counts = 1 if self._by_message else len(batch.rows)
        gap = self._jump(batch)
        self._recent.extend([(self._counted, gap), (self._counted + gap, 1)])
        self._counted += gap + counts
        self._expected = (batch.counter + counts) % self._modulus

    def _step(self, batch: Batch) -> IndexStep:
        samples = self._jump(batch) * self._each(batch)
        if samples == 0:
            return IndexStep(0)
        if self._may_be_new(batch, self._arrival_ns):
            return IndexStep(samples, restarts=True)
        if self._is_late(batch):
            samples -= self._wrap(batch)
        return self._judge(samples, batch)

    def _confirms(self, suspect: Batch, batch: Batch) -> bool:
        assert suspect.counter is not None
        assert batch.counter is not None
        jump = (batch.counter - suspect.counter) % self._modulus
        counts = 1 if self._by_message else len(suspect.rows)
        return 0 < jump <= FOLLOWS_WITHIN * counts
