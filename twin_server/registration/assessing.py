"""What a twin assumes where it compares its members with those of the reference period."""

from typing import Annotated, Any

from pydantic import Field

from slowtime_schemas.quantities import Immutable

ASSESSMENT_EXAMPLE: dict[str, Any] = {"readings": 24, "false_alarms_per_year": 0.1}

Share = Annotated[float, Field(gt=0, lt=1)]


class Assessing(Immutable):
    """Comparison of the mean of some readings with the reference, member by member.

    The reference are the readings that the twin learnt from: `learn_epochs`, or the training
    under covariates. Each comparison may raise a false alarm with the probability
    `false_alarms_per_year` times the time since the comparison before, so that they add up to
    that rate however the readings depend on each other.

    Examples
    --------
    >>> Assessing().readings
    20
    """

    readings: Annotated[
        int, Field(ge=1, le=10_000, description="Averaged for each comparison.")
    ] = 20
    false_alarms_per_year: Annotated[
        float, Field(gt=1e-6, le=100, description="Expected at most, of all members together.")
    ] = 0.1
    model_error: Annotated[
        Share, Field(description="Relative sd of the stiffness of a member about the model.")
    ] = 0.02
    temperature_sd: Annotated[
        float,
        Field(
            ge=0,
            lt=1,
            description="Relative sd of a common change of all stiffness that covariates do "
            "not explain.",
        ),
    ] = 0.02
    frequency_error: Annotated[
        float,
        Field(ge=0, lt=1, description="Relative scatter of a mean frequency besides its sd."),
    ] = 0.001
    shape_error: Annotated[
        float,
        Field(
            ge=0,
            lt=1,
            description="Likewise of a component of a shape of norm 1.",
        ),
    ] = 0.005
    most: Annotated[
        int, Field(ge=1, le=3, description="Members that are told to have changed at most.")
    ] = 3
