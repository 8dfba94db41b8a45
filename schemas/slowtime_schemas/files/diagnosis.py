"""The machine-readable report of a diagnosis: ``report.json``."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, NonNegativeFloat

from slowtime_schemas.quantities import Finite, Free, Frozen, Sd

Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NotNegative = Annotated[NonNegativeFloat, Field(allow_inf_nan=False)]
Span = tuple[Finite, Finite]


class Where(Frozen):
    """A place on the model: an element, a node, the base, an input or a sensor, by name."""

    kind: Literal["element", "node", "base", "input", "sensor"]
    id: str


class Estimated(Frozen):
    """A parameter in its unit; sd 0 for one that was chosen, not estimated."""

    value: Finite
    sd: Sd
    unit: str = ""


class Rival(Frozen):
    """Another effect that might stand in the place of one that was named."""

    effect: str
    where: Where
    probability: Share


class FoundEffect(Frozen):
    """One effect that the model lacks."""

    effect: str
    family: str
    where: Where
    parameters: dict[str, Estimated]
    probability: Share
    alternatives: tuple[Rival, ...] = ()
    sentence: str = ""


class SuspectPlace(Frozen):
    """A place, by how much of what was left one unknown force there explains."""

    kind: Literal["element", "node", "base", "input", "sensor"]
    id: str
    score: Finite
    p_value: Share
    share: Finite


class WhenSeen(Frozen):
    """Where in time, frequency and motion the discrepancy stands out."""

    times_s: tuple[Span, ...] = ()
    bands_hz: tuple[Span, ...] = ()
    amplitude: str = ""
    linear: bool | None = None
    steady: bool | None = None


class GapStep(Frozen):
    """Error once one more effect had been added."""

    effect: str
    where: Where
    nrmse: NotNegative


class GapShown(Frozen):
    """Error of the free run over the scatter of the measurement, averaged over sensors."""

    measure: Literal["nrmse"] = "nrmse"
    nominal: NotNegative
    refitted_nominal: NotNegative
    steps: tuple[GapStep, ...] = ()
    augmented: NotNegative
    noise_floor: NotNegative
    worst_sensor: NotNegative
    on: Annotated[
        Literal["holdout", "tail"],
        Field(description="Held-out records, or the last third of the records themselves."),
    ]

    @property
    def adopts_another(self) -> bool:
        """Whether the adopted model is none of the steps: its constants were refitted."""
        last = self.steps[-1].nrmse if self.steps else self.refitted_nominal
        return self.augmented not in (last, self.nominal)


class MovedConstant(Frozen):
    """A constant of the model that left its tolerance."""

    name: str
    value: Finite
    sd: Sd
    unit: str


class ChannelFinding(Frozen):
    """A fault of one channel that needs no physics to be seen."""

    fault: str
    channel: str
    share: Share
    spans_s: tuple[Span, ...]
    sentence: str


class SearchEnd(Frozen):
    """What ended a search before every law was tried."""

    by: Annotated[
        Literal["budget", "clock", "request"],
        Field(description="The budget of work, the limit of processor time, or its user."),
    ]
    budget_s: Annotated[
        NotNegative | None,
        Field(description="Budget [s of a reference machine]; null where none was set."),
    ] = None
    used_s: Annotated[NotNegative, Field(description="Time by the clock [s].")]


class DiagnosisFile(Frozen):
    """The answer of a diagnosis."""

    MESSAGE: ClassVar[str] = "diagnosis_file"
    VERSION: ClassVar[int] = 1

    slowtime_diagnosis: Literal[1] = 1
    verdict: Literal[
        "missing_effect",
        "nothing_missing",
        "parameters_only",
        "sensor_fault",
        "input_fault",
        "undecided",
        "unknown_effect",
    ]
    sentence: str
    effects: tuple[FoundEffect, ...]
    undecided: Annotated[
        tuple[Rival, ...], Field(description="Effects that the records cannot tell apart.")
    ]
    where: tuple[SuspectPlace, ...]
    when: WhenSeen
    gap: GapShown
    residual_white: bool
    white_p_value: Share
    chi2_per_datum: Annotated[
        NotNegative,
        Field(description="Of what is left, over the noise; 1 is the best there is."),
    ]
    nothing_probability: Annotated[
        Share, Field(description="That the model, refitted within tolerance, lacks nothing.")
    ]
    experiment: Annotated[str | None, Field(description="What would decide, for people.")]
    experiment_request: Annotated[
        Free | None,
        Field(
            description="The same for machines: level_factor, band_hz, excitation, start_s, "
            "add_sensors and add_inputs (entries of a model file); what is absent stays."
        ),
    ] = None
    moved: tuple[MovedConstant, ...] = ()
    findings: tuple[ChannelFinding, ...] = ()
    notes: tuple[str, ...] = ()
    model: Annotated[str, Field(description="Name of the model.")] = ""
    records: tuple[str, ...] = ()
    holdout: tuple[str, ...] = ()
    measured_s: Annotated[
        tuple[Span, ...],
        Field(
            description="Begin and end of each record that states its time [s since "
            "1970-01-01 UTC]."
        ),
    ] = ()
    ended: Annotated[SearchEnd | None, Field(description="Null where every law was tried.")] = (
        None
    )
    seconds: NotNegative

    def plain(self) -> dict[str, Any]:
        """Everything, as JSON has it."""
        return self.model_dump(mode="json")
