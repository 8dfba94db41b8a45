"""The run of one boot, the runs of one asset, and the changes that follow from messages."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from slowtime_schemas.messages import Features
from slowtime_services.digests import MODULUS, digest_of
from twin_server.settings import BackfillSettings

SEQUENCES = 2**40
"""Sequences are smaller than this: at a thousand features a second, 35 years of one boot."""

MOST_AT_ONCE = 5_000
"""Features asked for in one question."""


class Arrival(NamedTuple):
    """One features message, checked, with its bytes."""

    features: Features
    payload: bytes
    replayed: bool = False
    age_s: float = 0.0
    """On arrival, where that is more than usual; else 0."""


class Holding(NamedTuple):
    """The features of one boot that an edge reports to hold."""

    boot: str
    first: int
    last: int
    damaged: tuple[tuple[int, int], ...] = ()
    """First and last of each range whose records are damaged there."""
    ack_version: int = 1
    withheld: bool = False
    """Whether readings of another agent have been acknowledged to it."""


class EdgeQuery(NamedTuple):
    """A question to an edge: for features of `boot`, or, where that is "", its account."""

    site: str
    asset: str
    boot: str = ""
    first: int = 0
    last: int = -1
    replayed: bool = False


@dataclasses.dataclass(slots=True, eq=False)
class Run:
    """The account of one boot.

    Parameters
    ----------
    number
        Place in the order of all boots; 0 until it is let in.
    next
        The sequence that is expected; all before it are durable or lost.
    last, last_t_ns
        Sequence and sensor time of the newest that was let through; -1 before the first.
    told
        The newest the edge has made, as far as it said.
    forgotten
        Up to where the edge has said so in vain, nothing following.
    followed
        Whether a later boot has been let in.
    gone
        Whether the edge has forgotten this boot: what is missing cannot be had.
    aged
        Whether it has been told that readings of this boot came late.
    stretch, digest
        From where on all has been accepted, none lost in between, and the sum of its digests.
    ack_version
        Of the acknowledgements that its agent reads.
    held_from, held_to
        What its agent said it holds, to be compared before it is acknowledged; -1 where that
        is done, or where it did not say.
    agents
        When the agents began that speak of it [ms]; more than one are a mistake.
    rivalled
        Whether it has been told that two agents send as this asset.
    contested
        Whether two agents send under this very boot: then nothing more is acknowledged.
    outlived
        How often its agent was heard of after a later boot had begun.
    disbelieved
        Why the sensor time of what came under a sequence was not believed.
    earlier
        The boot before it, until the first reading is accepted; None for the first boot.
    before_ns
        Sensor time of the newest reading of all earlier boots; -1 without any.
    """

    site: str
    asset: str
    boot: str
    number: int = 0
    next: int = 0
    last: int = -1
    last_t_ns: int = -1
    told: int = -1
    forgotten: int = -1
    flows: bool = False
    closed: bool = False
    gone: bool = False
    followed: bool = False
    aged: bool = False
    stretch: int = 0
    digest: int = 0
    ack_version: int = 1
    held_from: int = -1
    held_to: int = -1
    agents: list[int] = dataclasses.field(default_factory=list)
    rivalled: bool = False
    contested: bool = False
    outlived: int = 0
    disbelieved: dict[int, str] = dataclasses.field(default_factory=dict)
    held: dict[int, Arrival] = dataclasses.field(default_factory=dict)
    lost: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    earlier: "Run | None" = None
    before_ns: int = -1
    worried: bool = False
    since_s: float = 0.0
    due_s: float = 0.0
    tries: int = 0
    delays: int = 0

    def __str__(self) -> str:
        return f"boot {self.boot} of {self.site}.{self.asset}"

    def missing(self) -> tuple[int, int] | None:
        """First and last sequence of the first hole; None if there is no hole."""
        if self.held:
            first_held = min(self.held)
            return (self.next, first_held - 1) if first_held > self.next else None
        last = self.told if self.told > self.forgotten else -1
        return (self.next, last) if last >= self.next else None

    def follow_earlier(self) -> None:
        """Note where the readings of earlier boots end, which are all accepted by now."""
        chain = [self]
        while chain[-1].earlier is not None:
            chain.append(chain[-1].earlier)
        for before, run in zip(chain[:0:-1], chain[-2::-1], strict=True):
            run.before_ns = max(before.before_ns, before.last_t_ns)
            run.earlier = None

    def take(self, sequence: int, payload: bytes) -> None:
        """Add accepted features to the digest."""
        self.digest = (self.digest + digest_of(sequence, payload)) % MODULUS

    def extend(self, rows: Sequence[tuple[int, bytes]]) -> None:
        """Add to the digest accepted features that directly precede it; ascending."""
        for sequence, payload in reversed(rows):
            if sequence != self.stretch - 1:
                return
            self.take(sequence, payload)
            self.stretch = sequence

    def interrupt(self, first: int) -> None:
        """Begin a new digest at `first`, because earlier features are lost."""
        self.stretch, self.digest = first, 0

    def calm(self) -> None:
        """Nothing is missing."""
        self.worried = False
        self.tries = self.delays = 0

    def progress(self, now_s: float) -> None:
        """Ask on at once, with new patience, since features came."""
        self.tries = self.delays = 0
        self.since_s, self.due_s = now_s, now_s

    def put_off(self, now_s: float, settings: BackfillSettings) -> None:
        """Nothing came: ask again later."""
        self.due_s = now_s + _delay(self.delays, settings)
        self.delays += 1

    def impatient(
        self, certain: bool, line: "AssetRuns", now_s: float, settings: BackfillSettings
    ) -> bool:
        """Whether to stop waiting for missing features."""
        if certain:
            self.tries += 1
            return self.tries >= settings.tries
        patience = settings.absent_patience_s if line.spooled else settings.foreign_patience_s
        return now_s - self.since_s >= patience


@dataclasses.dataclass(slots=True, eq=False)
class AssetRuns:
    """The boots of one asset, in order.

    Parameters
    ----------
    waiting
        Boots that were heard of and not yet let in.
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
    """

    site: str
    asset: str
    runs: list[Run] = dataclasses.field(default_factory=list)
    waiting: dict[str, Run] = dataclasses.field(default_factory=dict)
    alive: bool = False
    spooled: bool = False
    replayed: bool = False
    inquire: bool = False
    busy: bool = False
    ack_version: int = 1
    foreign_acks: int = 0
    due_s: float = 0.0
    tries: int = 0
    delays: int = 0

    def all_runs(self) -> tuple[Run, ...]:
        """Those let in and those waiting."""
        return (*self.runs, *self.waiting.values())

    def ease(self) -> None:
        """Ask at the next occasion, with new patience."""
        self.due_s, self.tries, self.delays = 0.0, 0, 0

    def put_off(self, now_s: float, settings: BackfillSettings) -> None:
        """Ask again later."""
        self.due_s = now_s + _delay(self.delays, settings)
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
        uneasy = False
        if self.busy:
            return None, True
        if self.waiting or self.inquire:
            if now_s >= self.due_s:
                return EdgeQuery(self.site, self.asset), True
            uneasy = True
        for run in self.runs:
            hole = None if run.closed else run.missing()
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


class Ordered(NamedTuple):
    """Features that are next in order."""

    run: Run
    features: Features
    payload: bytes
    missing_before: int
    replayed: bool = False
    previous_ns: int = -1
    """Sensor time of the reading before it in its boot; -1 for the first."""
    covered: float = 0.0
    """Share of its time that earlier windows have measured [1]."""


class LostRange(NamedTuple):
    """A range of features that no edge and no twin holds any more."""

    run: Run
    first: int
    last: int
    why: str


class OldReading(NamedTuple):
    """The first reading of a boot that was old on arrival."""

    run: Run
    sequence: int
    age_s: float


class RivalAgents(NamedTuple):
    """Two agents that send as the same asset.

    Parameters
    ----------
    run
        Of the one; of both where they use the same boot.
    other
        Boot of the other.
    first
        From where on the features of `run` are not taken in.
    how
        What tells the two apart.
    """

    run: Run
    other: str
    first: int
    how: str


class RepeatedFeatures(NamedTuple):
    """Features with a known sequence, to be compared with those stored."""

    run: Run
    sequence: int
    payload: bytes


@dataclasses.dataclass(slots=True)
class Change:
    """The changes that follow from messages, to be made durable at once.

    Parameters
    ----------
    ordered
        Features to be estimated from, in order.
    held, released
        Features to be kept until their turn, and those whose turn has come.
    lost
        Ranges the order has passed over.
    aged
        Boots of which readings were old on arrival, each once.
    rivals
        Agents that send as one asset, each pair once.
    repeated
        What came again.
    refused
        Reasons and sentences.
    early
        How many came before their turn.
    touched
        Runs whose account has changed, or of which the edge should be told again.
    """

    ordered: list[Ordered] = dataclasses.field(default_factory=list)
    held: list[tuple[Run, int, bytes]] = dataclasses.field(default_factory=list)
    released: list[tuple[Run, int]] = dataclasses.field(default_factory=list)
    lost: list[LostRange] = dataclasses.field(default_factory=list)
    aged: list[OldReading] = dataclasses.field(default_factory=list)
    rivals: list[RivalAgents] = dataclasses.field(default_factory=list)
    repeated: list[RepeatedFeatures] = dataclasses.field(default_factory=list)
    refused: list[tuple[str, str]] = dataclasses.field(default_factory=list)
    touched: dict[Run, None] = dataclasses.field(default_factory=dict)
    early: int = 0


def _delay(count: int, settings: BackfillSettings) -> float:
    return min(settings.backoff_s * 2.0 ** min(count, 30), settings.max_backoff_s)
