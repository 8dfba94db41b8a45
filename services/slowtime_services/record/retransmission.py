"""Requests for features that have not reached the recorder.

A router that comes back is found by the edge before the recorder finds it, and what the edge
sends in between is heard by others or by nobody. The recorder notices the gap in the sequence,
or that the edge's health message states a later end, and asks the edge's spool.
"""

import bisect
import dataclasses
import logging
import threading
import time
from collections.abc import Callable

from slowtime_schemas.codec import Refused, decode_sample
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH, request_key
from slowtime_services.bus import Bus, Sample
from slowtime_services.feature_runs import Run, run_and_sequence

logger = logging.getLogger(__name__)

MAX_WAIT_S = 30.0
"""Longest pause between two requests for the same gap [s]."""
MAX_FINAL_WAIT_S = 3.0
"""Time that missing features are waited for when a recording ends [s]."""


@dataclasses.dataclass(slots=True)
class _Gap:
    """Consecutive sequences that have not come."""

    first: int
    last: int
    due: float
    """When to ask for them, on the monotonic clock."""
    asked: int = 0

    def __len__(self) -> int:
        return self.last - self.first + 1


@dataclasses.dataclass(slots=True)
class _Seen:
    """Sequences of one run that have arrived."""

    newest: int
    gaps: list[_Gap] = dataclasses.field(default_factory=list)


class Retransmission:
    """Keeps account of arrived features, and requests missing ones.

    Parameters
    ----------
    bus
        Where to ask.
    deliver
        Takes what is answered, as if it had just arrived.
    grace_s
        How long a gap may close by itself before it is asked for; then twice that, and so on.
    tries
        How often to ask before a gap is given up.
    """

    def __init__(
        self,
        bus: Bus,
        deliver: Callable[[Sample], None],
        *,
        grace_s: float = 1.0,
        tries: int = 8,
    ) -> None:
        self._bus, self._deliver = bus, deliver
        self._grace_s, self._tries = grace_s, tries
        self._runs: dict[Run, _Seen] = {}
        self._given_up = 0
        self._lock = threading.Lock()

    @property
    def missing(self) -> int:
        """Number of features that are known to exist and have not arrived."""
        with self._lock:
            open_gaps = (gap for seen in self._runs.values() for gap in seen.gaps)
            return self._given_up + sum(map(len, open_gaps))

    def note(self, key: str, payload: bytes) -> None:
        """Enter a message that has come into the account."""
        if (known := run_and_sequence(key, payload)) is not None:
            with self._lock:
                self._has_come(*known)
        elif f"/{HEALTH.name}/" in key:
            self._note_health(key, payload)

    def heal(self, *, at_last: bool = False) -> None:
        """Request gaps that are due; with `at_last` all that a few seconds allow."""
        began = time.monotonic()
        for run, gap in self._due(at_last):
            if at_last and time.monotonic() - began > MAX_FINAL_WAIT_S:
                return
            answers = self._bus.ask(
                request_key(run.site, run.asset, "features"),
                {"boot": run.boot, "first": str(gap.first), "last": str(gap.last)},
            )
            for sample in answers:
                self._deliver(sample._replace(key=FEATURES.key(run.site, run.asset)))
            logger.info(
                "Asked %s.%s for features %d to %d: %d came.",
                run.site,
                run.asset,
                gap.first,
                gap.last,
                len(answers),
            )

    def _has_come(self, run: Run, sequence: int) -> None:
        seen = self._runs.setdefault(run, _Seen(newest=sequence))
        if sequence <= seen.newest:
            if seen.gaps:
                _fill(seen.gaps, sequence)
            return
        if sequence > seen.newest + 1:
            self._open(seen, sequence - 1)
        seen.newest = sequence

    def _note_health(self, key: str, payload: bytes) -> None:
        try:
            health = decode_sample(key, payload)
        except Refused:
            return
        with self._lock:
            run = Run(health.site, health.asset, health.boot)
            seen = self._runs.get(run)
            if isinstance(health, Health) and seen and health.last_sequence > seen.newest:
                self._open(seen, health.last_sequence)
                seen.newest = health.last_sequence

    def _open(self, seen: _Seen, last: int) -> None:
        seen.gaps.append(_Gap(seen.newest + 1, last, time.monotonic() + self._grace_s))

    def _due(self, at_last: bool) -> list[tuple[Run, _Gap]]:
        now, due = time.monotonic(), []
        with self._lock:
            for run, seen in self._runs.items():
                for gap in tuple(seen.gaps):
                    if gap.asked >= self._tries:
                        seen.gaps.remove(gap)
                        self._given_up += len(gap)
                    elif at_last or gap.due <= now:
                        gap.asked += 1
                        gap.due = now + min(self._grace_s * 2**gap.asked, MAX_WAIT_S)
                        due.append((run, dataclasses.replace(gap)))
        return due


def _fill(gaps: list[_Gap], sequence: int) -> None:
    """Remove one sequence from its gap, if any; gaps are ascending and disjoint."""
    where = bisect.bisect_right(gaps, sequence, key=lambda gap: gap.first) - 1
    if where < 0 or sequence > gaps[where].last:
        return
    gap = gaps[where]
    before = dataclasses.replace(gap, last=sequence - 1)
    after = dataclasses.replace(gap, first=sequence + 1)
    gaps[where : where + 1] = [part for part in (before, after) if len(part) > 0]
