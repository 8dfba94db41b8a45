"""Requests for features that have not reached the recorder.

A router that comes back is found by the edge before the recorder finds it, and what the edge
sends in between is heard by others or by nobody. The recorder notices the gap in the sequence,
or that the edge's health message states a later end, and asks the edge's spool.
"""

import bisect
import collections
import dataclasses
import itertools
import logging
import threading
import time
from collections.abc import Callable, Iterator

from slowtime_schemas.codec import Refused, decode_sample
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import FEATURES, HEALTH, request_key
from slowtime_services.bus import Bus, Sample
from slowtime_services.feature_runs import AgentRun, run_and_sequence

logger = logging.getLogger(__name__)

MAX_WAIT_S = 30.0
"""Longest pause between two requests for the same gap [s]."""
MAX_FINAL_WAIT_S = 3.0
"""Time that missing features are waited for when a recording ends [s]."""
FURTHEST = 2**24
"""How far ahead of what has come a sequence is believed to be [1]: half a year of a feature a
second. What is farther is recorded, but says nothing of what lies between."""
MOST_GAPS = 256
"""Gaps of a run that are known at once [1]; of more, the oldest are given up."""
MOST_BOOTS = 16
"""Runs of an asset that are known at once [1]; of more, those heard last are kept."""
MOST_ASSETS = 100_000
"""Assets that are known at once [1], likewise: ten times what a server is measured with."""
MOST_AT_ONCE = 4
"""Requests to one asset before the others have their turn [1]: each may take seconds."""


@dataclasses.dataclass(slots=True)
class _Gap:
    """Consecutive sequences that have not come."""

    first: int
    last: int
    due: float
    """When to ask for them, on the monotonic clock."""
    asked: int = 0

    def __len__(self) -> int:
        return max(0, self.last - self.first + 1)


@dataclasses.dataclass(slots=True)
class _Seen:
    """Sequences of one run that have arrived.

    Parameters
    ----------
    newest
        The greatest that has arrived.
    gaps
        Before it, ascending.
    stated
        Behind it, as the agent's health says; nothing else shows that they exist.
    given_up
        The same, where it was asked for in vain.
    """

    newest: int
    gaps: list[_Gap] = dataclasses.field(default_factory=list)
    stated: _Gap | None = None
    given_up: _Gap | None = None

    @property
    def missing(self) -> int:
        """Number of features that have not arrived."""
        last = (part for part in (self.stated, self.given_up) if part is not None)
        return sum(map(len, (*self.gaps, *last)))


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
        self._assets: collections.OrderedDict[
            tuple[str, str], collections.OrderedDict[str, _Seen]
        ] = collections.OrderedDict()
        self._given_up = 0
        self._lock = threading.Lock()

    @property
    def missing(self) -> int:
        """Number of features that are known to exist and have not arrived."""
        with self._lock:
            known = (seen for boots in self._assets.values() for seen in boots.values())
            return self._given_up + sum(seen.missing for seen in known)

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

    def _has_come(self, run: AgentRun, sequence: int) -> None:
        seen = self._seen(run, sequence)
        if sequence <= seen.newest:
            if seen.gaps:
                _fill(seen.gaps, sequence)
            return
        begin = seen.newest + 1
        for name in ("given_up", "stated"):  # ascending
            begin = _begin_behind(seen, name, sequence, begin)
        if begin < sequence and sequence - begin <= FURTHEST:
            seen.gaps.append(_Gap(begin, sequence - 1, time.monotonic() + self._grace_s))
        seen.newest = sequence
        while len(seen.gaps) > MOST_GAPS:
            self._given_up += len(seen.gaps.pop(0))

    def _seen(self, run: AgentRun, sequence: int) -> _Seen:
        """Return what is known of a run, which begins with `sequence` if nothing is."""
        address = run.site, run.asset
        boots = self._assets.setdefault(address, collections.OrderedDict())
        self._assets.move_to_end(address)
        seen = boots.setdefault(run.boot, _Seen(newest=sequence))
        boots.move_to_end(run.boot)
        if len(boots) > MOST_BOOTS:
            self._given_up += boots.popitem(last=False)[1].missing
        if len(self._assets) > MOST_ASSETS:
            _, left = self._assets.popitem(last=False)
            self._given_up += sum(one.missing for one in left.values())
        return seen

    def _note_health(self, key: str, payload: bytes) -> None:
        try:
            health = decode_sample(key, payload)
        except Refused:
            return
        if not isinstance(health, Health):
            return
        with self._lock:
            boots = self._assets.get((health.site, health.asset))
            if boots is not None and health.boot in boots:
                self._state(boots[health.boot], health.last_sequence)

    def _state(self, seen: _Seen, last: int) -> None:
        """Take up that features up to `last` exist, as their agent says."""
        if last - seen.newest > FURTHEST:
            return
        first = seen.newest + 1 if seen.given_up is None else seen.given_up.last + 1
        if seen.stated is not None:
            seen.stated.last = max(seen.stated.last, last)
        elif first <= last:
            seen.stated = _Gap(first, last, time.monotonic() + self._grace_s)

    def _due(self, at_last: bool) -> list[tuple[AgentRun, _Gap]]:
        """Return what to ask for now: one of each asset, then another of each, and so on."""
        now, due = time.monotonic(), []
        with self._lock:
            for (site, asset), boots in self._assets.items():
                gaps = (
                    (AgentRun(site, asset, boot), dataclasses.replace(gap))
                    for boot, seen in boots.items()
                    for gap in self._due_of(seen, now, at_last)
                )
                due.append(list(gaps if at_last else itertools.islice(gaps, MOST_AT_ONCE)))
        turns = itertools.zip_longest(*filter(None, due))
        return [one for turn in turns for one in turn if one is not None]

    def _due_of(self, seen: _Seen, now: float, at_last: bool) -> Iterator[_Gap]:
        """Yield the gaps of a run that are due, each asked once more; some are given up."""
        left = [gap for gap in seen.gaps if gap.asked < self._tries]
        self._given_up += sum(map(len, seen.gaps)) - sum(map(len, left))
        seen.gaps = left
        if seen.stated is not None and seen.stated.asked >= self._tries:
            first = seen.stated.first if seen.given_up is None else seen.given_up.first
            seen.given_up = dataclasses.replace(seen.stated, first=first)
            seen.stated = None
        for gap in (*seen.gaps, *((seen.stated,) if seen.stated is not None else ())):
            if at_last or gap.due <= now:
                gap.asked += 1
                gap.due = now + min(self._grace_s * 2**gap.asked, MAX_WAIT_S)
                yield gap


def _begin_behind(seen: _Seen, name: str, sequence: int, begin: int) -> int:
    """Part what an agent has stated at a sequence that has come; return what is behind it.

    What was stated before it is known to exist now, as gaps are.
    """
    stated: _Gap | None = getattr(seen, name)
    if stated is None or not len(stated):
        return begin
    before = dataclasses.replace(stated, last=min(stated.last, sequence - 1))
    if len(before):
        seen.gaps.append(before)
    behind = dataclasses.replace(stated, first=max(stated.first, sequence + 1))
    setattr(seen, name, behind if len(behind) else None)
    return max(begin, min(stated.last, sequence) + 1)


def _fill(gaps: list[_Gap], sequence: int) -> None:
    """Remove one sequence from its gap, if any; gaps are ascending and disjoint."""
    where = bisect.bisect_right(gaps, sequence, key=lambda gap: gap.first) - 1
    if where < 0 or sequence > gaps[where].last:
        return
    gap = gaps[where]
    before = dataclasses.replace(gap, last=sequence - 1)
    after = dataclasses.replace(gap, first=sequence + 1)
    gaps[where : where + 1] = [part for part in (before, after) if len(part) > 0]
