"""Events of an asset: repairs, replacements, inspections, load tests and notes."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from .keyed_access import KeyedAccess
from .messages import Message
from .quantities import Covariates, Finite, Frozen, Nanoseconds, Plain

AssetEventKind = Literal["repair", "replacement", "inspection", "load_test", "note"]

EventName = Annotated[
    str,
    StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z._:-]{0,63}$"),
    Field(description="Given by who tells of the event; the same id twice is the same event."),
]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
Spread = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
Change = Annotated[float, Field(ge=-1, le=1e6, allow_inf_nan=False)]
Text = Annotated[str, StringConstraints(max_length=2_000), Plain]
PersonName = Annotated[str, StringConstraints(min_length=1, max_length=100), Plain]
QuantityName = Annotated[str, StringConstraints(min_length=1, max_length=200), Plain]
MOST_POINTS = 64


class RepairResult(KeyedAccess, Frozen):
    """How much of the damage a repair has restored."""

    restored_share: Annotated[
        Share | None,
        Field(description="1 for a perfect repair; null where nobody knows: 0 to 1."),
    ] = None
    restored_share_sd: Annotated[
        float, Field(ge=0, le=1, allow_inf_nan=False, description="Standard deviation.")
    ] = 0.0

    @model_validator(mode="after")
    def _has_a_share(self) -> Self:
        if self.restored_share is None and self.restored_share_sd > 0.0:
            raise ValueError(
                f"restored_share_sd={self.restored_share_sd} was given without restored_share. "
                "Give both, or neither where nobody knows."
            )
        return self


class NewPart(KeyedAccess, Frozen):
    """What is known of a part that has replaced another."""

    change: Annotated[
        Change | None,
        Field(description="Against the nominal model; null where only readings can tell."),
    ] = 0.0
    sd: Annotated[Spread | None, Field(description="Standard deviation of `change`.")] = None


class MeasuredChange(KeyedAccess, Frozen):
    """A relative change that was measured; -0.1 once a tenth is gone."""

    value: Change
    sd: Spread


class CurvePoint(Frozen):
    """One point of a curve of probability of detection."""

    damage: Annotated[float, Field(ge=0, le=1, description="Share that is gone.")]
    probability: Share


class DetectionLaw(KeyedAccess, Frozen):
    """Probability that damage of a size is found: Phi(slope ln(a / a50)), or by points."""

    a50: Annotated[
        Size | None, Field(description="Damage that is found with probability one half [1].")
    ] = None
    slope: Annotated[
        Size | None, Field(description="Rise of the probit over one unit of ln a.")
    ] = None
    points: Annotated[
        tuple[CurvePoint, ...],
        Field(max_length=MOST_POINTS, description="Ascending in damage; straight between."),
    ] = ()

    @model_validator(mode="after")
    def _is_one_curve(self) -> Self:
        formula = self.a50 is not None and self.slope is not None
        half = (self.a50 is None) != (self.slope is None)
        if half or formula == bool(self.points):
            raise ValueError(
                f"a50={self.a50}, slope={self.slope} and {len(self.points)} points were given. "
                "Give a50 and slope, or points."
            )
        damages = [point.damage for point in self.points]
        if damages != sorted(set(damages)):
            raise ValueError("The points of a curve ascend in damage. Sort them, each once.")
        return self


class DetectionResult(KeyedAccess, Frozen):
    """Whether an inspection has found damage, and how probable that was for each size."""

    detected: bool
    probability_of_detection: DetectionLaw


class EventContent(Frozen):
    """What has happened to an asset, but for when and who says so."""

    kind: AssetEventKind
    quantity: Annotated[
        QuantityName | None,
        Field(
            description="stiffness_change, mass_change, or an element of the twin's model; "
            "null for all of the asset.",
        ),
    ] = None
    text: Text = ""
    repair: Annotated[
        RepairResult | None, Field(description="Of a repair; null: nobody knows how much.")
    ] = None
    replacement: Annotated[
        NewPart | None, Field(description="Of a replacement; null: as the nominal model.")
    ] = None
    measured: Annotated[
        MeasuredChange | None, Field(description="Of an inspection or a load test.")
    ] = None
    detection: Annotated[DetectionResult | None, Field(description="Of an inspection.")] = None
    conditions: Annotated[
        Covariates, Plain, Field(description="Temperature, load and such at the time.")
    ] = Field(default_factory=dict)
    reverses: Annotated[
        EventName | None, Field(description="Event that this note takes back.")
    ] = None
    answers: Annotated[
        Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")] | None,
        Field(description="`event_id` of the question `repair_suspected` that this answers."),
    ] = None

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Self:
        for name, kinds in _PARTS.items():
            if getattr(self, name) is not None and self.kind not in kinds:
                raise ValueError(
                    f"{name} was given with kind {self.kind!r}. It goes with: "
                    f"{', '.join(kinds)}. Leave it out, or give another kind."
                )
        results = (self.measured is not None) + (self.detection is not None)
        if self.kind == "inspection" and results != 1:
            raise ValueError(
                "An inspection has one result. Give measured (value and sd) or detection; an "
                "inspection without a number is a note."
            )
        if self.detection is not None and is_mass(self.quantity):
            raise ValueError(
                f"A detection of {self.quantity} was given. Damage is a loss of stiffness: "
                "name a stiffness, or give measured."
            )
        return self


_PARTS: dict[str, tuple[AssetEventKind, ...]] = {
    "repair": ("repair",),
    "replacement": ("replacement",),
    "measured": ("inspection", "load_test"),
    "detection": ("inspection",),
    "reverses": ("note",),
}
"""With which kinds of event each part goes."""


def is_mass(quantity: str | None) -> bool:
    """Whether a quantity of a twin is a mass.

    Examples
    --------
    >>> [is_mass(name) for name in ("mass_change", "floor2.mass", "j2", None)]
    [True, True, False, False]
    """
    return quantity is not None and (quantity == "mass_change" or quantity.endswith(".mass"))


class Correction(Frozen):
    """The event that another one stands instead of, and why."""

    event: EventName
    text: Annotated[Text, Field(description="Reason of the correction.")] = ""


class AssetEvent(EventContent, Message):
    """Something that has happened to an asset, as a person has told it."""

    MESSAGE: ClassVar[str] = "asset_event"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    event: EventName
    happened_ns: Annotated[
        Nanoseconds | None, Field(description="By the sensor's clock; null with slow_time.")
    ] = None
    slow_time: Annotated[
        Finite | None, Field(description="When it happened; null with happened_ns.")
    ] = None
    person: PersonName
    principal: Annotated[
        str, StringConstraints(max_length=200), Field(description="Whose token it was.")
    ] = ""
    corrects: Annotated[
        Correction | None,
        Field(description="Event that this takes back and stands instead of."),
    ] = None

    @property
    def supersedes(self) -> str | None:
        """Name of the event that this one takes back or corrects."""
        return self.reverses if self.corrects is None else self.corrects.event

    @model_validator(mode="after")
    def _has_one_time(self) -> Self:
        if (self.happened_ns is None) == (self.slow_time is None):
            raise ValueError(
                f"happened_ns={self.happened_ns} and slow_time={self.slow_time} were given. "
                "Give one of them."
            )
        return self
