"""The nominal structure of a twin, and the covariates that move its frequencies."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from slowtime_schemas.quantities import Immutable, Plain, PlainText
from twin_server.registration.thresholds import Number, Positive

NotNegative = Annotated[float, Field(ge=0, lt=1e300, allow_inf_nan=False)]


class Nominal(Immutable):
    """The structure as it was, in modal or in physical quantities.

    Examples
    --------
    >>> Nominal(mass_kg=1.0, damping_n_s_per_m=0.4, stiffness_n_per_m=100.0).modal
    (1.5915494309189535, 0.02)
    """

    frequency_hz: Positive | None = None
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] | None = None
    mass_kg: Positive | None = None
    damping_n_s_per_m: NotNegative | None = None
    stiffness_n_per_m: Positive | None = None
    frequency_relative_sd: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """How well the nominal frequency is known; its error is common to all epochs."""
    damping_relative_sd: Annotated[float, Field(ge=0, le=1)] = 0.0

    @model_validator(mode="after")
    def _is_one_or_the_other(self) -> Self:
        physical = (self.mass_kg, self.damping_n_s_per_m, self.stiffness_n_per_m)
        modal = (self.frequency_hz, self.damping_ratio)
        none_physical, whole = physical == (None,) * 3, None not in physical
        if not (
            (self.frequency_hz is not None and none_physical)
            or (whole and modal == (None, None))
        ):
            raise ValueError(
                "The nominal model is given twice, or not whole. Give frequency_hz and "
                "damping_ratio, or mass_kg, damping_n_s_per_m and stiffness_n_per_m."
            )
        if self.modal[1] >= 1.0:
            raise ValueError(
                f"With these values the damping ratio is {self.modal[1]:.3g}: nothing would "
                "ring. Give a damping_n_s_per_m below 2 sqrt(stiffness mass)."
            )
        return self

    @property
    def modal(self) -> tuple[float, float]:
        """Natural frequency [Hz] and damping ratio [1]; NaN for a damping ratio not given."""
        if self.frequency_hz is not None:
            given = self.damping_ratio
            return self.frequency_hz, math.nan if given is None else given
        assert self.stiffness_n_per_m is not None
        assert self.mass_kg is not None
        assert self.damping_n_s_per_m is not None
        root = math.sqrt(self.stiffness_n_per_m * self.mass_kg)
        return (
            math.sqrt(self.stiffness_n_per_m / self.mass_kg) / (2 * math.pi),
            self.damping_n_s_per_m / (2 * root),
        )


class Covariates(Immutable):
    """Measured covariates, temperature and load, whose effect on a frequency is removed.

    Training is over once it has spanned `train_span` and has had `train_epochs`. It must have
    seen what will come later: a year, for the weather.
    """

    names: Annotated[
        tuple[Annotated[str, Field(min_length=1, max_length=64), Plain], ...],
        Field(
            min_length=1,
            max_length=8,
            examples=[["temperature_c", "load_kg"]],
            description="As the edge's features call them; all are needed in an epoch.",
        ),
    ]
    temperature: Annotated[
        PlainText | None,
        Field(description="Which of them may bend the law at freezing; by default by name."),
    ] = None
    freezing_c: Number = 0.0
    train_span: Annotated[
        float, Field(ge=0, lt=1e300, description="In slow time, whose unit is the edge's.")
    ] = 0.0
    train_epochs: Annotated[int, Field(ge=30, le=1_000_000)] = 100
    reference: Annotated[
        dict[str, Number] | None,
        Plain,
        Field(
            description="Where frequencies are compared; by default at the mean in training."
        ),
    ] = None
    entered: Annotated[
        Literal["loss", "gain", "either"],
        Field(description="Of frequency: what an alarm is raised for."),
    ] = "loss"
    size: Annotated[
        float, Field(gt=0, lt=1, description="Typical relative change of frequency sought.")
    ] = 0.01
    time_between_false_alarms: Annotated[
        Positive | None,
        Field(description="Mean, at least, in slow time; by default ten times the training."),
    ] = None

    @model_validator(mode="after")
    def _names_what_it_has(self) -> Self:
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"Covariates {self.names} name one twice. Name each once.")
        strange = {*(self.reference or ()), *filter(None, [self.temperature])} - {*self.names}
        if strange:
            raise ValueError(
                f"{', '.join(sorted(strange))} is none of the covariates. Allowed in "
                f"`temperature` and `reference`: {', '.join(self.names)}."
            )
        return self

    @property
    def hinge(self) -> int | None:
        """Return the name of the temperature: as given, or the first one called so."""
        called = [name for name in self.names if name.startswith("temperature")]
        name = self.temperature or next(iter(called), None)
        return None if name is None else self.names.index(name)
