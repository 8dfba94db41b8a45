"""Typed answers of a server about composites."""

from typing import Any

from .answers import Answer


class Chance(Answer):
    """A failure probability with its 95 % band; None if unknown."""

    value: float | None
    lo: float
    hi: float
    reasons: tuple[str, ...] = ()


class CompositeChance(Chance):
    """Failure probability of a composite within a horizon.

    Parameters
    ----------
    lowest, highest
        With all members at the lower, and at the upper, ends of their bands.
    any_dependence
        Bounds `lo` and `hi` that hold however the members depend on each other.
    horizon
        How far ahead, in slow time.
    """

    lowest: float
    highest: float
    any_dependence: dict[str, float]
    horizon: float | None = None
    slow_time_unit: str | None = None


class Importance(Answer):
    """Importance of a twin; `docs/composites.md` defines each measure."""

    birnbaum: float
    criticality: float
    fussell_vesely: float | None


class CompositeHealth(Answer):
    """Health of all twins within a composite."""

    twins: int
    alive: int
    valid_twins: int
    valid: bool
    alarms: int
    reasons: tuple[str, ...] = ()
    worst: str | None = None


class CompositeTwin(Answer):
    """A twin within a composite, at any depth."""

    id: str
    valid: bool
    alive: bool
    failure: Chance
    importance: Importance | None = None


class CompositeMember(Answer):
    """A direct member: a twin, or a composite."""

    id: str
    kind: str
    valid: bool
    failure: Chance


class PooledRate(Answer):
    """A drift rate per slow time with its 95 % interval; None where it does not exist."""

    value: float | None
    sd: float | None
    lo: float | None
    hi: float | None
    id: str = ""
    shrinkage: float | None = None


class Pool(Answer):
    """Drift rates of like members: of the fleet, between assets, of an asset still unknown."""

    quantity: str
    slow_time_unit: str | None
    fleet: PooledRate
    spread: PooledRate
    another: PooledRate
    members: tuple[PooledRate, ...]


class CompositeBrief(Answer):
    """A composite in a list."""

    id: str
    name: str
    kind: str
    members: tuple[str, ...]
    health: CompositeHealth


class Composite(Answer):
    """A composite with its health, failure probability, importance and rates."""

    id: str
    name: str
    kind: str
    registration: dict[str, Any]
    health: CompositeHealth
    failure: CompositeChance
    tree: dict[str, Any]
    members: tuple[CompositeMember, ...]
    twins: tuple[CompositeTwin, ...]
    pooled: tuple[Pool, ...]
