"""The machine-readable report of a diagnosis in slow time: ``report.json`` of `--history`."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from slowtime_schemas.quantities import Count, Finite, Frozen

from .diagnosis import Estimated, NotNegative, Share


class SlowRival(Frozen):
    """Another law in the place of one that was named."""

    effect: str
    covariate: str | None
    probability: Share


class FollowedEffect(Frozen):
    """One thing that the history follows."""

    effect: str
    family: str
    covariate: Annotated[str | None, Field(description="What it follows; null for time alone.")]
    parameters: dict[str, Estimated]
    probability: Share
    alternatives: tuple[SlowRival, ...] = ()
    sentence: str = ""


class SlowGap(Frozen):
    """Scatter of what is left of the readings, over the scatter of the readings."""

    measure: Literal["scatter"] = "scatter"
    nominal: NotNegative
    augmented: NotNegative
    nominal_step: Annotated[
        NotNegative, Field(description="Of expecting each reading from all before it.")
    ]
    augmented_step: NotNegative
    noise_floor: NotNegative


class SlowDiagnosisFile(Frozen):
    """The answer of a diagnosis in slow time."""

    MESSAGE: ClassVar[str] = "slow_diagnosis_file"
    VERSION: ClassVar[int] = 1

    slowtime_slow_diagnosis: Literal[1] = 1
    clock: Literal["slow"] = "slow"
    of: Annotated[str, Field(description="The twin, or the name of the file.")]
    quantity: Literal["stiffness_change", "frequency_ratio", "frequency_hz"]
    slow_time_unit: str
    verdict: Literal[
        "missing_effect", "nothing_missing", "sensor_fault", "undecided", "unknown_effect"
    ]
    sentence: str
    effects: tuple[FollowedEffect, ...]
    undecided: Annotated[
        tuple[str, ...], Field(description="Effects that the history cannot tell apart.")
    ]
    experiment: Annotated[str | None, Field(description="What would decide, for people.")]
    nothing_probability: Share
    gap: SlowGap
    residual_white: bool
    white_p_value: Share
    noise_factor: Annotated[
        NotNegative, Field(description="To multiply stated standard deviations by.")
    ]
    outliers: Annotated[
        tuple[Finite, ...], Field(description="Slow times of readings that were not used.")
    ]
    ignored_covariates: tuple[str, ...]
    readings: Count
    since: Finite
    until: Finite
    seconds: NotNegative
