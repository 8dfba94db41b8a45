"""The boots of one asset, in order, and the question to put to its edge next."""

import collections
import dataclasses
import itertools
from collections.abc import Iterable

from twin_server.settings import BackfillSettings

from .held import HeldBytes
from .runs import MOST_AT_ONCE, EdgeQuery, Run, delay_s

MOST_ASKED_BOOTS = 8
"""Boots, the oldest that are not whole, that are looked at for what is missing: those after
them wait for these anyway, and a look at thousands would hold up other assets."""

PATIENT_QUESTIONS = 8
"""Questions in a row that bring nothing new before an edge is asked more and more rarely: an
honest one gives what it lists, and one that does not would keep the server asking."""


@dataclasses.dataclass(slots=True, eq=False)
class AssetRuns:
    """The boots of one asset, in order.

    Parameters
    ----------
    known
        All of them, by name.
    unfinished
        Those let in that are not closed, oldest first.
    latest
        The newest that was let in.
    waiting
        Boots that were heard of and not yet let in.
    held_bytes
        Bytes of all features that are held.
    crowded
        Whether it has been told that it has more boots than are allowed.
    alive
        Whether an edge agent is there now.
    spooled
        Whether an edge agent that keeps an account was ever there.
    replayed
        Whether it comes from a recording.
    inquire
        Whether to ask for its account.
    busy
        Whether it is being asked something.
    ack_version
        Of the acknowledgements that the agent that spoke last reads.
    foreign_acks
        How many acknowledgements its agent took for another's, as far as it said.
    barren
        Questions in a row that brought nothing new.
    rest_s
        Until when nothing is asked after these.
    """

    site: str
    asset: str
    known: dict[str, Run] = dataclasses.field(default_factory=dict)
    unfinished: collections.deque[Run] = dataclasses.field(default_factory=collections.deque)
    latest: Run | None = None
    waiting: dict[str, Run] = dataclasses.field(default_factory=dict)
    held_bytes: HeldBytes = dataclasses.field(default_factory=HeldBytes)
    crowded: bool = False
    alive: bool = False
    spooled: bool = False
    replayed: bool = False
    inquire: bool = False
    busy: bool = False
    ack_version: int = 1
    foreign_acks: int = 0
    barren: int = 0
    rest_s: float = 0.0
    inquired_s: float = 0.0
    due_s: float = 0.0
    tries: int = 0
    delays: int = 0

    def add(self, run: Run) -> None:
        """Know a boot."""
        self.known[run.boot] = run
        run.held.count_in(self.held_bytes)

    def follow(self, run: Run) -> None:
        """Put a boot that is let in behind all others."""
        if self.latest is not None:
            self.latest.followed = True
            run.earlier = self.latest
        self.latest = run
        if not run.closed:
            self.unfinished.append(run)

    def clear(self) -> None:
        """Forget all boots; only the presence of the edge is kept."""
        self.known.clear()
        self.unfinished.clear()
        self.waiting.clear()
        self.latest, self.crowded = None, False
        self.held_bytes = HeldBytes()

    def not_closed(self) -> Iterable[Run]:
        """Those let in and those waiting."""
        return itertools.chain(self.unfinished, self.waiting.values())

    def ease(self) -> None:
        """Ask at the next occasion, with new patience."""
        self.due_s, self.tries, self.delays = 0.0, 0, 0

    def note_answer(self, fruitful: bool, now_s: float, settings: BackfillSettings) -> None:
        """Rest after many questions that brought nothing new."""
        self.barren = 0 if fruitful else self.barren + 1
        if self.barren > PATIENT_QUESTIONS:
            self.rest_s = now_s + delay_s(self.barren - PATIENT_QUESTIONS, settings)

    def put_off(self, now_s: float, settings: BackfillSettings) -> None:
        """Ask again later."""
        self.due_s = now_s + delay_s(self.delays, settings)
        self.delays += 1

    def impatient(self, certain: bool, now_s: float, settings: BackfillSettings) -> bool:
        """Whether to admit boots before the edge has reported what it holds."""
        self.tries += 1
        if certain or not self.spooled:
            return self.tries >= settings.tries
        since = min(run.since_s for run in self.waiting.values())
        return now_s - since >= settings.absent_patience_s

    def want(self, now_s: float, settings: BackfillSettings) -> tuple[EdgeQuery | None, bool]:
        """Return the query to make now, and whether there is one now or later."""
        uneasy = len(self.unfinished) > MOST_ASKED_BOOTS
        if self.busy or now_s < self.rest_s:
            return None, True
        if self.waiting or self.inquire:
            if now_s >= self.due_s:
                return EdgeQuery(self.site, self.asset), True
            uneasy = True
        for run in itertools.islice(self.unfinished, MOST_ASKED_BOOTS):
            hole = run.missing()
            if hole is None:
                run.calm()
                uneasy = uneasy or bool(run.held)
                continue
            uneasy = True
            if not run.worried:
                run.worried, run.since_s, run.due_s = True, now_s, now_s + settings.grace_s
            elif now_s >= run.due_s:
                last = min(hole[1], hole[0] + MOST_AT_ONCE - 1)
                want = EdgeQuery(self.site, self.asset, run.boot, hole[0], last, self.replayed)
                return want, True
        return None, uneasy
