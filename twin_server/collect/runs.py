"""The run of one boot: what has come of it, what is missing, and what its agent states."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from slowtime_services.digests import MODULUS, digest_of
from twin_server.settings import BackfillSettings

from .held import Arrival, HeldFeatures
from .intervals import MOST_RANGES, Range, Reasons

MOST_AT_ONCE = 5_000
"""Features asked for in one question."""

MAX_JUMP = 10**6
"""How far a sequence may be ahead of the one expected, unless settings say otherwise."""


class Holding(NamedTuple):
    """The features of one boot that an edge reports to hold."""

    boot: str
    first: int
    last: int
    damaged: tuple[Range, ...] = ()
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
        The newest the edge has made, as far as it said; see `told_end`.
    reach
        How far ahead of `next` a sequence is believed without evidence.
    vouched
        First and last that the account of its agent lists, where that is farther ahead.
    forgotten
        Up to where the edge has said so in vain, nothing following.
    followed
        Whether a later boot has been let in.
    gone
        Whether the edge has forgotten this boot: what is missing cannot be had.
    aged
        Whether it has been told that readings of this boot came late.
    doubted
        Whether it has been told that its agent states an implausible sequence.
    stretch, digest
        From where on all has been accepted, none lost in between, and the sum of its digests.
    floor
        No digest begins earlier, because what is just before it is lost.
    part
        Digest of an earlier range to be acknowledged, of which more is to be read.
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
    lost
        The newest ranges that were passed over, ascending.
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
    reach: int = MAX_JUMP
    vouched: Range | None = None
    forgotten: int = -1
    flows: bool = False
    closed: bool = False
    gone: bool = False
    followed: bool = False
    aged: bool = False
    doubted: bool = False
    stretch: int = 0
    digest: int = 0
    floor: int = 0
    part: "Run | None" = None
    ack_version: int = 1
    held_from: int = -1
    held_to: int = -1
    agents: list[int] = dataclasses.field(default_factory=list)
    rivalled: bool = False
    contested: bool = False
    outlived: int = 0
    disbelieved: Reasons = dataclasses.field(default_factory=Reasons)
    held: HeldFeatures = dataclasses.field(default_factory=HeldFeatures)
    lost: list[Range] = dataclasses.field(default_factory=list)
    earlier: "Run | None" = None
    before_ns: int = -1
    worried: bool = False
    since_s: float = 0.0
    due_s: float = 0.0
    tries: int = 0
    delays: int = 0

    def __str__(self) -> str:
        return f"boot {self.boot} of {self.site}.{self.asset}"

    @property
    def horizon(self) -> int:
        """The largest sequence of features that are let in or held."""
        farthest = self.next if self.vouched is None else max(self.next, self.vouched[1])
        return farthest + self.reach

    @property
    def told_end(self) -> int:
        """The newest that is waited for, of what the edge has said; no farther than `reach`."""
        return min(self.told, self.next + self.reach) if self.told > self.forgotten else -1

    @property
    def is_implausible(self) -> bool:
        """Whether the edge has stated a sequence farther ahead than is believed."""
        return self.told > self.next + self.reach

    @property
    def asked_ahead(self) -> bool:
        """Whether features far ahead are asked for, as evidence that they exist."""
        return not self.held and self.vouched is not None and self.vouched[0] > self.next

    def missing(self) -> Range | None:
        """First and last sequence of the first hole; None if there is no hole."""
        first_held = self.held.first
        if first_held is not None:
            return (self.next, first_held - 1) if first_held > self.next else None
        if self.asked_ahead:
            return self.vouched
        last = self.told_end
        return (self.next, last) if last >= self.next else None

    def hold(self, arrival: Arrival) -> None:
        """Keep features until their turn."""
        self.held[arrival.features.sequence] = arrival

    def note_lost(self, first: int, last: int) -> None:
        """Remember a range that was passed over, behind all others."""
        if self.lost and self.lost[-1][1] == first - 1:
            first = self.lost.pop()[0]
        self.lost.append((first, last))
        del self.lost[:-MOST_RANGES]

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
        self.stretch, self.floor, self.digest = first, first, 0

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
        self.due_s = now_s + delay_s(self.delays, settings)
        self.delays += 1

    def impatient(
        self, certain: bool, spooled: bool, now_s: float, settings: BackfillSettings
    ) -> bool:
        """Whether to stop waiting for missing features.

        Parameters
        ----------
        certain
            Whether the edge has answered, without what is missing.
        spooled
            Whether an edge agent that keeps an account was ever there.
        """
        if certain:
            self.tries += 1
            return self.tries >= settings.tries
        patience = settings.absent_patience_s if spooled else settings.foreign_patience_s
        return now_s - self.since_s >= patience


def delay_s(count: int, settings: BackfillSettings) -> float:
    """Return how long to wait before the next question, after so many in vain [s]."""
    return min(settings.backoff_s * 2.0 ** min(count, 30), settings.max_backoff_s)
