"""Answers about composites, as the API's document describes them."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from slowtime_schemas.keyed_access import KeyedAccess

from .base import Extensible, RestAnswer

CompositeKind = Literal["site", "line", "structure"]


class HealthOfTwins(RestAnswer):
    """Of all twins within a composite; valid where all of them are."""

    twins: int
    alive: int
    valid_twins: int
    valid: bool
    alarms: int = Field(description="Alarms that are raised now.")
    reasons: tuple[str, ...]


class HealthOfComposite(HealthOfTwins):
    """Beside that, the twin that accounts for most of the failures."""

    worst: str | None


class Chance(RestAnswer):
    """A failure probability with its 95 % band; null if unknown."""

    value: float | None
    lo: float
    hi: float


class ChanceWithReasons(Chance):
    """Beside that, why it should not be relied on."""

    reasons: tuple[str, ...]


class ChanceOfTwin(ChanceWithReasons):
    """Of a twin, at the instant and up to the horizon of its outlook."""

    since: float | None = Field(default=None, description="Slow time of its last reading.")
    horizon: float | None = Field(default=None, description="Slow time up to which it is.")


class ChanceOfMember(Chance):
    """Of a direct member; of a twin also why it should not be relied on, and its instants."""

    reasons: tuple[str, ...] = ()
    since: float | None = None
    horizon: float | None = None


class AnyDependence(KeyedAccess, RestAnswer):
    """Bounds that hold however the members depend on each other."""

    lo: float
    hi: float


class FailureOfComposite(ChanceWithReasons):
    """Probability that the composite fails within the horizon."""

    lowest: float = Field(description="All members at the lower ends of their bands.")
    highest: float = Field(description="All members at the upper ends of their bands.")
    any_dependence: AnyDependence
    horizon: float | None = Field(description="How far ahead, in slow time.")
    slow_time_unit: str | None


class ImportanceOfTwin(RestAnswer):
    """Importance of a twin; see `docs/composites.md`."""

    birnbaum: float
    criticality: float
    fussell_vesely: float | None


class MemberOfComposite(RestAnswer):
    """A direct member: a twin, or a composite of some kind."""

    id: str
    kind: Annotated[CompositeKind | Literal["twin"], Extensible]
    valid: bool
    failure: ChanceOfMember


class TwinOfComposite(RestAnswer):
    """A twin within a composite, at any depth."""

    id: str
    name: str
    alive: bool
    valid: bool
    reasons: tuple[str, ...]
    alarms: tuple[dict[str, Any], ...]
    failure: ChanceOfTwin
    importance: ImportanceOfTwin | None


class RateModel(RestAnswer):
    """A drift rate per slow time, with its 95 % interval; null where it does not exist."""

    value: float | None
    sd: float | None
    lo: float | None
    hi: float | None


class OwnRate(RestAnswer):
    """The drift rate from a twin's own readings."""

    value: float
    sd: float


class PooledRate(RateModel):
    """Rate of a member, given the readings of all."""

    id: str
    shrinkage: float = Field(description="Share drawn towards the fleet: 0 to 1.")
    own: OwnRate | None


class PoolModel(RestAnswer):
    """Drift rates of like members."""

    quantity: str
    slow_time_unit: str | None
    fleet: RateModel
    spread: RateModel
    another: RateModel = Field(description="Of an asset of which nothing is known yet.")
    members: tuple[PooledRate, ...]


_PAIR = ["demo.tower", "demo.mast"]
_CHANCES: list[dict[str, Any]] = [
    {"value": 0.02, "lo": 0.0145, "hi": 0.0268},
    {"value": 0.5, "lo": 0.478, "hi": 0.522},
]
_IMPORTANCE = [
    {"birnbaum": 0.5, "criticality": 1.0, "fussell_vesely": 1.0},
    {"birnbaum": 0.02, "criticality": 1.0, "fussell_vesely": 1.0},
]
_HEALTHY: dict[str, Any] = {"alive": True, "valid": True, "reasons": [], "alarms": []}
_EXAMPLE: dict[str, Any] = {
    "id": "demo.yard",
    "name": "Yard",
    "kind": "site",
    "registration": {"name": "Yard", "members": _PAIR, "tree": {"parallel": _PAIR}},
    "health": {
        "twins": 2, "alive": 2, "valid_twins": 2, "valid": True, "alarms": 0, "reasons": [],
        "worst": "demo.mast",
    },
    "failure": {
        "value": 0.01, "lo": 0.0072, "hi": 0.0135, "lowest": 0.0069, "highest": 0.014,
        "any_dependence": {"lo": 0.0, "hi": 0.0268}, "horizon": 365.0, "slow_time_unit": "d",
        "reasons": [],
    },
    "tree": {"parallel": _PAIR},
    "members": [
        {"id": name, "kind": "twin", "valid": True, "failure": chance | {"reasons": []}}
        for name, chance in zip(_PAIR, _CHANCES, strict=True)
    ],
    "twins": [
        {
            "id": name, "name": name, **_HEALTHY, "failure": chance | {"reasons": []},
            "importance": importance,
        }
        for name, chance, importance in zip(_PAIR, _CHANCES, _IMPORTANCE, strict=True)
    ],
    "pooled": [],
}  # fmt: skip


class CompositeModel(RestAnswer):
    """A composite with its health, failure probability, importance and rates."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    id: str
    name: str
    kind: Annotated[CompositeKind, Extensible]
    registration: dict[str, Any]
    health: HealthOfComposite
    failure: FailureOfComposite
    tree: dict[str, Any]
    members: tuple[MemberOfComposite, ...]
    twins: tuple[TwinOfComposite, ...]
    pooled: tuple[PoolModel, ...]


class CompositeBrief(RestAnswer):
    """A composite in a list, without results that need forecasts."""

    id: str
    name: str
    kind: Annotated[CompositeKind, Extensible]
    members: tuple[str, ...]
    health: HealthOfTwins


class CompositeList(RestAnswer):
    """All composites whose twins the caller may see."""

    composites: tuple[CompositeBrief, ...]


class MemberBrief(RestAnswer):
    """A member by its id, and whether it is a twin or a composite."""

    id: str
    kind: Annotated[CompositeKind | Literal["twin"], Extensible]


class MemberList(RestAnswer):
    """Members, and the twins within at any depth."""

    id: str
    members: tuple[MemberBrief, ...]
    twins: tuple[str, ...]


class MembershipList(RestAnswer):
    """Composites that a twin is in: at once, and at any height."""

    id: str
    composites: tuple[str, ...]
    above: tuple[str, ...]


class Revision(RestAnswer):
    """A registration of a composite; null where it was deleted."""

    t_ns: int
    principal: str
    registration: dict[str, Any] | None


class RevisionList(RestAnswer):
    """Registrations of a composite whose twins the caller may see, in order."""

    id: str
    revisions: tuple[Revision, ...]
