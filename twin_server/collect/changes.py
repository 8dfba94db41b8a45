"""The changes that follow from messages, to be made durable at once."""

import dataclasses
from typing import NamedTuple

from slowtime_schemas.messages import Features

from .runs import Run


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


class DoubtedSequence(NamedTuple):
    """A sequence that an agent has stated and that is not believed.

    Parameters
    ----------
    stated
        What it has said.
    expected
        The sequence that was due then.
    corrected
        Whether an earlier server had believed it, so that the kept account was corrected.
    """

    run: Run
    stated: int
    expected: int
    corrected: bool = False


class ReachedLimit(NamedTuple):
    """A limit of what is kept of one asset, which its agent has reached.

    Parameters
    ----------
    boot
        Which is not taken in.
    setting
        Name of the setting that allows so many.
    allowed
        Number allowed.
    """

    site: str
    asset: str
    boot: str
    setting: str
    allowed: int


class RepeatedFeatures(NamedTuple):
    """Features with a known sequence, to be compared with those stored."""

    run: Run
    sequence: int
    payload: bytes


@dataclasses.dataclass(slots=True)
class StoreChange:
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
    doubted
        Stated sequences that are not believed, each boot once.
    limits
        Limits that were reached, each asset once.
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
    doubted: list[DoubtedSequence] = dataclasses.field(default_factory=list)
    limits: list[ReachedLimit] = dataclasses.field(default_factory=list)
    repeated: list[RepeatedFeatures] = dataclasses.field(default_factory=list)
    refused: list[tuple[str, str]] = dataclasses.field(default_factory=list)
    touched: dict[Run, None] = dataclasses.field(default_factory=dict)
    early: int = 0

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to store."""
        return not (
            self.ordered
            or self.touched
            or self.lost
            or self.held
            or self.released
            or self.rivals
            or self.doubted
            or self.limits
        )
