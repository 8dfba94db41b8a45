"""Answers about members: which have lost stiffness since the reference period."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from .base import Extensible, RestAnswer

AssessmentVerdict = Literal["unchanged", "changed", "undecided", "not comparable"]
"""What a comparison of two states of a structure says of its members."""

ASSESSMENT_EXAMPLE: dict[str, Any] = {
    "verdict": "changed",
    "sentence": "Changed: storey2 has lost 8.0 ± 0.5 %.",
    "p_value": 3.3e-12,
    "other_p_value": 3.0e-10,
    "sets": [
        [
            {
                "name": "storey2",
                "kind": "member",
                "probability": 0.99,
                "loss": 0.08,
                "sd": 0.005,
            }
        ]
    ],
    "probability": {"storey1": 0.01, "storey2": 0.99},
    "common_change": {"value": -0.001, "sd": 0.0012},
    "readings": 24,
    "since_ns": 1795147200123456789,
    "until_ns": 1795233600123456789,
    "reference_readings": 40,
    "false_alarm": 0.00026,
    "false_alarms_per_year": 0.1,
}


class SuspectedMember(RestAnswer):
    """A member that may be the changed one of its set."""

    name: str
    kind: Annotated[Literal["member", "connection"], Extensible] = "member"
    probability: float = Field(description="Of it being the one of its set.")
    loss: float = Field(description="Share of its stiffness that it has lost, if it is.")
    sd: float = Field(description="Standard deviation of the loss.")


class CommonChange(RestAnswer):
    """Relative change of all stiffness alike, as by temperature; no damage."""

    value: float | None
    sd: float | None


class MemberAssessment(RestAnswer):
    """Comparison of the mean of some readings with the reference, member by member."""

    model_config = ConfigDict(json_schema_extra={"examples": [ASSESSMENT_EXAMPLE]})

    verdict: Annotated[AssessmentVerdict, Extensible]
    sentence: str
    p_value: float | None = Field(
        description="Probability of scores of the members as large without a change."
    )
    other_p_value: float | None = Field(
        description="Likewise of a difference of the modes as large as a whole."
    )
    sets: tuple[tuple[SuspectedMember, ...], ...] = Field(
        description="For each changed member, those that it may be, together with 95 %."
    )
    probability: dict[str, float] = Field(
        description="Of each member having changed; empty without a change."
    )
    common_change: CommonChange
    readings: int = Field(description="How many were averaged.")
    since_ns: int = Field(description="Sensor time of the first [ns since 1970-01-01 UTC].")
    until_ns: int = Field(description="Sensor time of the last [ns since 1970-01-01 UTC].")
    reference_readings: int = Field(description="How many the reference was learnt from.")
    false_alarm: float = Field(description="Probability of a false alarm of this comparison.")
    false_alarms_per_year: float = Field(description="Expected at most, of all comparisons.")
