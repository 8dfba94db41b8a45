"""The memory of the estimation of one twin between batches, as JSON."""

import dataclasses
import json
import math
from typing import Any, NamedTuple

from twin_server.registration.twin import Registration

from .covariates import Condition, Training, condition_of, training_of
from .elements.memory import ElementMemory

Epoch = tuple[float, float, float, float]
"""Frequency [Hz] and its sd, damping ratio [1] and its sd, of one epoch learnt from."""


@dataclasses.dataclass(frozen=True, slots=True)
class NominalInUse:
    """The nominal model in use.

    Parameters
    ----------
    frequency_hz, frequency_relative_sd
        Natural frequency [Hz], and its standard deviation over itself [1].
    damping_ratio, damping_relative_sd
        Likewise for damping [1]; NaN where unknown.
    """

    frequency_hz: float
    frequency_relative_sd: float
    damping_ratio: float
    damping_relative_sd: float


@dataclasses.dataclass(frozen=True, slots=True)
class SteadyFlag:
    """One yes or no that is changed only by several readings in a row.

    Parameters
    ----------
    holds
        What is believed.
    against
        Readings in a row that said otherwise.
    """

    holds: bool
    against: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class Checkpoint:
    """State of the estimation of a twin between batches.

    Parameters
    ----------
    known
        The nominal model; None while it is being learnt.
    learning
        Epochs it will be learnt from.
    trusted
        Whether states are believed to be valid.
    raised
        For each quantity that an alarm of the registration watches, whether it is raised.
    elements
        What a twin of elements remembers beside.
    training, condition
        Of a twin of one mode under covariates: readings of its training, and, once that is
        over, what is normal.
    renewals
        How often the structure was renewed, as the edge counts it; None where it does not.
    """

    known: NominalInUse | None = None
    learning: tuple[Epoch, ...] = ()
    trusted: SteadyFlag = SteadyFlag(True)
    raised: tuple[SteadyFlag, ...] = ()
    elements: ElementMemory | None = None
    training: Training | None = None
    condition: Condition | None = None
    renewals: float | None = None

    @classmethod
    def start(cls, registration: Registration) -> "Checkpoint":
        """Make the checkpoint of a twin that has not seen anything yet."""
        known = None
        if (nominal := registration.nominal) is not None:
            frequency, damping = nominal.modal
            known = NominalInUse(
                frequency, nominal.frequency_relative_sd, damping, nominal.damping_relative_sd
            )
        return cls(
            known=known,
            raised=(SteadyFlag(False),) * len(registration.watched()),
            elements=ElementMemory() if registration.changes == "elements" else None,
        )

    def to_json(self) -> str:
        """Write it as text, every float exactly."""
        return _ENCODER.encode(self)

    @classmethod
    def from_json(cls, text: str) -> "Checkpoint":
        """Read the output of `to_json`."""
        content: dict[str, Any] = json.loads(text)
        known, elements = content["known"], content.get("elements")
        return cls(
            known=NominalInUse(**known) if known else None,
            learning=tuple((f, s, z, e) for f, s, z, e in content["learning"]),
            trusted=SteadyFlag(**content["trusted"]),
            raised=tuple(SteadyFlag(**belief) for belief in content["raised"]),
            elements=None if elements is None else ElementMemory.from_dict(elements),
            training=training_of(content.get("training")),
            condition=condition_of(content.get("condition")),
            renewals=content.get("renewals"),
        )

    def nominal(self) -> dict[str, float] | None:
        """Return the known numbers of the nominal model; for elements, of the first mode."""
        if self.elements is not None and self.elements.knows:
            first = dataclasses.asdict(self.elements.baselines[0])
            first["frequency_relative_sd"] = first["relative_sd"]
            known = {
                field.name: first[field.name] for field in dataclasses.fields(NominalInUse)
            }
        elif self.known is not None:
            known = dataclasses.asdict(self.known)
        else:
            return None
        return {name: value for name, value in known.items() if not math.isnan(value)}

    def nominal_modes(self) -> list[dict[str, Any]]:
        """Return the modes of a model as they were learnt."""
        return [
            {
                "model_mode": one.mode,
                "frequency_hz": one.frequency_hz,
                "relative_sd": one.relative_sd,
                "damping_ratio": None if math.isnan(one.damping_ratio) else one.damping_ratio,
            }
            for one in (() if self.elements is None else self.elements.baselines)
        ]

    def conditions(self) -> list[tuple[int | None, Condition]]:
        """Return the normal behaviour under covariates of each mode."""
        if self.elements is not None:
            return [
                (one.mode, one.condition)
                for one in self.elements.baselines
                if one.condition is not None
            ]
        return [] if self.condition is None else [(None, self.condition)]

    @property
    def has_damping(self) -> bool:
        """Whether a nominal damping ratio is known."""
        return self.known is not None and not math.isnan(self.known.damping_ratio)


def _fields(part: Any) -> dict[str, Any]:
    """Fields of a dataclass by name; not `asdict`, which copies all that is within."""
    return {field.name: getattr(part, field.name) for field in dataclasses.fields(part)}


_ENCODER = json.JSONEncoder(default=_fields)


class Twin(NamedTuple):
    """Registration and checkpoint of one twin."""

    registration: Registration
    checkpoint: Checkpoint
