"""Limit states of a twin: what fails, under which load, how often."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from slowtime.design import AddedStructure
from slowtime.dynamics.description import Description, Node, Spring
from slowtime.dynamics.elements import BASE
from slowtime.limit_states import (
    LimitState,
    Resonance,
    ResponseLimit,
    Threshold,
    gumbel_of_maxima,
)
from slowtime_schemas.files.design import DesignLoad, DesignResponse
from slowtime_schemas.files.reliability import RandomInput
from slowtime_schemas.quantities import Immutable, Plain, PlainText
from slowtime_services.problem_files.design import load_of, response_of
from slowtime_services.problem_files.reliability import law_of

from .thresholds import Positive, Quantity

Name = Annotated[PlainText, Field(min_length=1, max_length=60)]
Probability = Annotated[float, Field(gt=0, lt=1)]
MASS, SPRING = "mass", "spring"
"""Node and element that stand for a twin of one mode without a model."""


class _Named(Immutable):
    """Fields that all limit states share."""

    name: Name
    accepted: Annotated[
        Probability,
        Field(description="Probability of failure up to a horizon that the owner accepts."),
    ] = 0.001


class ThresholdState(_Named):
    """Failed once a change passes a value."""

    kind: Literal["threshold"]
    quantity: Quantity
    below: float | None = None
    above: float | None = None

    @model_validator(mode="after")
    def _has_one_side(self) -> Self:
        if (self.below is None) == (self.above is None):
            raise ValueError(f"The limit state {self.name} has one side. Give below or above.")
        return self


class ResonanceState(_Named):
    """Failed while the natural frequency of a twin of one mode is near an excitation's."""

    kind: Literal["resonance"]
    excitation_hz: RandomInput
    margin: Annotated[float, Field(gt=0, lt=1)] = 0.1

    @model_validator(mode="after")
    def _has_a_law(self) -> Self:
        law_of(self.excitation_hz)
        return self


class ResponseState(_Named):
    """Failed once a response to a load event exceeds a capacity."""

    kind: Literal["response"]
    load: DesignLoad
    response: DesignResponse
    capacity: Positive | RandomInput
    events: Annotated[Positive, Field(description="Load events over one unit of slow time.")]
    maxima: Annotated[
        tuple[Positive, ...],
        Field(
            max_length=10_000,
            description="Instead of `load.intensity`: its largest value in each past period.",
        ),
    ] = ()

    @model_validator(mode="after")
    def _has_laws(self) -> Self:
        if self.load.kind == "record":
            raise ValueError(
                "A limit state under a recorded load is not kept in a registration. Give noise "
                "or a harmonic load."
            )
        if isinstance(self.capacity, RandomInput):
            law_of(self.capacity)
        if self.load.intensity is not None:
            law_of(self.load.intensity)
        if self.maxima and self.load.intensity is not None:
            raise ValueError("Give load.intensity or maxima, not both.")
        if self.maxima:
            gumbel_of_maxima(_array(self.maxima))
        if self.load.kind == "noise" and self.response.statistic == "rms":
            raise ValueError(
                "What fails under noise is a peak. Give response.statistic='peak' with its "
                "duration_s."
            )
        return self


class OwnState(_Named):
    """A limit state of the owner's, an installed part of the group `slowtime.limit_states`."""

    kind: Literal["own"]
    part: Annotated[str, Field(min_length=1, max_length=100), Plain]
    settings: dict[str, float | str] = Field(default_factory=dict)


LimitStateSpec = Annotated[
    ThresholdState | ResonanceState | ResponseState | OwnState, Field(discriminator="kind")
]
EXAMPLE: list[Any] = [
    {"kind": "threshold", "name": "30 % softer", "quantity": "stiffness_change", "below": -0.3},
    {
        "kind": "resonance",
        "name": "near the machine",
        "excitation_hz": {"marginal": "normal", "mean": 2.5, "sd": 0.05},
        "margin": 0.05,
    },
    {
        "kind": "response",
        "name": "drift in a storm",
        "load": {
            "kind": "noise",
            "psd": 0.01,
            "low_pass_hz": 5.0,
            "intensity": {"marginal": "gumbel", "mean": 1.0, "sd": 0.3},
        },
        "response": {
            "quantity": "displacement",
            "node": MASS,
            "statistic": "peak",
            "duration_s": 600.0,
        },
        "capacity": {"marginal": "lognormal", "mean": 0.05, "sd": 0.01},
        "events": 0.1,
    },
]


def limit_state_of(
    spec: "ThresholdState | ResonanceState | ResponseState",
    *,
    description: Description | None,
    parts: Mapping[str, str],
    frequency_hz: float | None,
) -> LimitState:
    """Make a limit state as the arithmetic takes it.

    Parameters
    ----------
    description
        The model of responses.
    parts
        Quantity of the twin → part of the model that it multiplies, ``storey1.stiffness``.
    frequency_hz
        Nominal natural frequency of a twin of one mode.

    Raises
    ------
    ValueError
        Where the twin has not what the limit state asks for; the text says what to do.
    """
    if isinstance(spec, ThresholdState):
        at, side = (spec.below, "below") if spec.below is not None else (spec.above, "above")
        assert at is not None
        return Threshold(spec.quantity, at, side)  # type: ignore[arg-type]
    if isinstance(spec, ResonanceState):
        if frequency_hz is None:
            raise ValueError(
                f"{spec.name}: a resonance is asked of a twin of one mode. Register one for "
                "the mode that matters."
            )
        return Resonance(
            frequency_hz,
            law_of(spec.excitation_hz),
            spec.margin,
            stiffness="stiffness_change" if "stiffness_change" in parts else None,
            mass="mass_change" if "mass_change" in parts else None,
        )
    if description is None:
        raise ValueError(f"{spec.name}: the model of this twin is not known yet. Wait.")
    return _response_limit(spec, description, parts)


def _response_limit(
    spec: ResponseState, description: Description, parts: Mapping[str, str]
) -> ResponseLimit:
    load = spec.load
    intensity = None if load.intensity is None else law_of(load.intensity)
    if spec.maxima:
        intensity = gumbel_of_maxima(_array(spec.maxima))
    capacity = spec.capacity
    return ResponseLimit(
        structure=AddedStructure(description, (), tuple(parts.values())),
        names=tuple(parts),
        load=load_of(load),
        response=response_of(spec.response),
        capacity=law_of(capacity) if isinstance(capacity, RandomInput) else capacity,
        rate=spec.events,
        intensity=intensity,
    )


def one_mass(frequency_hz: float, damping_ratio: float, mass_kg: float | None) -> Description:
    """Equivalent oscillator for a twin of one mode without a model; 1 kg if not given.

    Parameters
    ----------
    frequency_hz
        Natural frequency [Hz].
    damping_ratio
        Damping ratio [1].
    mass_kg
        Mass [kg].

    Returns
    -------
    A mass on a spring and a damper.
    """
    mass = 1.0 if mass_kg is None else mass_kg
    omega = 2.0 * math.pi * frequency_hz
    spring = Spring(
        id=SPRING,
        between=(BASE, MASS),
        stiffness_n_per_m=mass * omega**2,
        damping_n_s_per_m=2.0 * damping_ratio * mass * omega,
    )
    return Description(name="mode", nodes=(Node(id=MASS, mass_kg=mass),), elements=(spring,))


def _array(values: Sequence[float]) -> Float[np.ndarray, " value"]:
    return np.array(values)
