"""The registration of a twin: nominal model, free parameters, alarms and decisions."""

import functools
import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from slowtime_schemas.files.model import ModelFile
from slowtime_schemas.files.model_v2 import AnyLineModel, line_model
from slowtime_schemas.quantities import AS_STORED, Immutable, Plain
from slowtime_services.documents.bounds import document_text
from slowtime_services.documents.json_documents import read_json
from slowtime_services.documents.toml_documents import read_toml
from slowtime_services.models import description_of
from slowtime_services.reasons import reason_of
from twin_server.events.receivers import AlarmRoute
from twin_server.orders import Adopted
from twin_server.registration.nominal import Covariates, Nominal

from .assessing import ASSESSMENT_EXAMPLE, Assessing
from .costs import COSTS_EXAMPLE, DECISION_EXAMPLE, CostTable, Deciding
from .disagreement import DisagreementPolicy
from .finite_elements import self_contained
from .limit_states import EXAMPLE as LIMIT_STATES_EXAMPLE
from .limit_states import LimitStateSpec, ThresholdState
from .structure import ElementModel, model_of
from .thresholds import Alarm, Forecasting, Limit

MODEL_EXAMPLE: dict[str, Any] = {
    "name": "Frame",
    "changes": "elements",
    "model": {
        "slowtime_model": 1,
        "nodes": [{"id": "floor1", "mass_kg": 900.0}, {"id": "floor2", "mass_kg": 800.0}],
        "elements": [
            {"id": "storey1", "between": ["base", "floor1"], "stiffness_n_per_m": 1.2e6},
            {"id": "storey2", "between": ["floor1", "floor2"], "stiffness_n_per_m": 1.0e6},
        ],
        "sensors": [
            {
                "channel": f"a_{floor}",
                "quantity": "acceleration",
                "node": floor,
                "unit": "m/s^2",
            }
            for floor in ("floor1", "floor2")
        ],
        "tolerance": {"stiffness": 0.1},
    },
    "parameters": {"storey1": 0.3, "storey2": 0.3, "floor2.mass": 0.1},
    "alarms": [{"quantity": "elements", "below": -0.1}],
    "assessment": ASSESSMENT_EXAMPLE,
}

_OF_ONE_MODE = ("frequency_hz", "damping_ratio", "stiffness_change", "mass_change")
_EACH = "elements"


class Registration(Immutable):
    """One twin: its free parameters, nominal model, and alarms.

    Examples
    --------
    >>> Registration(nominal={"frequency_hz": 3.0, "damping_ratio": 0.02}).changes
    'stiffness'
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "name": "Tower",
                    "changes": "stiffness",
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
                    "alarm_routes": [{"receiver": "ops", "remind_s": 86400.0}],
                    "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.2}]},
                },
                {"changes": "both", "learn_epochs": 40, "damping_coefficient_sd": 0.0},
                {
                    "changes": "stiffness",
                    "covariates": {"names": ["temperature_c"], "train_span": 365.0},
                },
                MODEL_EXAMPLE,
                {"costs": COSTS_EXAMPLE, "decision": DECISION_EXAMPLE},
                {
                    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
                    "limit_states": LIMIT_STATES_EXAMPLE,
                },
            ]
        },
    )

    name: Annotated[str, Field(max_length=100), Plain] = ""
    """For people; the twin's id is what everything else knows it by."""
    changes: Literal["stiffness", "mass", "both", "elements"] = "stiffness"
    """What may change; the rest is assumed to stay, and said so in every state."""
    model: Annotated[AnyLineModel, BeforeValidator(self_contained)] | None = None
    """Nodes, elements, inputs, and sensors with the edge's channel names: what a twin of
    elements is estimated with, and what a diagnosis of any twin compares with samples. A
    frame in space is reduced to the modes of its sensors' band when it is registered."""
    parameters: (
        Annotated[
            dict[str, Annotated[float, Field(gt=1e-9, le=10)]],
            Field(min_length=1, max_length=64),
            Plain,
        ]
        | None
    ) = None
    """Of a twin of elements: what may change, an element's id or a node's and `.mass`, with the
    standard deviation of ln(1 + change) believed beforehand; all stiffnesses by default."""
    nominal: Nominal | None = None
    """None to learn it from the first epochs."""
    learn_epochs: Annotated[int, Field(ge=2, le=1000)] = 20
    frequency_source: Literal["measured", "smoothed"] = "measured"
    mode: Annotated[int, Field(ge=0, le=63)] = 0
    """Which of the structural modes, counted from the lowest."""
    prior_stiffness_sd: Annotated[float, Field(gt=1e-9, le=100)] = 0.3
    prior_mass_sd: Annotated[float, Field(gt=1e-9, le=100)] = 0.3
    """What is believed of ln(1 + change) beforehand, where both may change."""
    damping_coefficient_sd: Annotated[float, Field(ge=0, le=100)] = 0.1
    """How much the damping coefficient may change by itself, where both may change."""
    covariates: Covariates | None = None
    """What of temperature and load is learnt at first, and taken out from then on; learning
    lasts as long as their training then, not `learn_epochs`."""
    assessment: Assessing | None = None
    """Of a twin of elements: members are compared with the reference period, readings
    together, at a stated rate of false alarms; by default each reading names by itself."""
    adopted: Annotated[tuple[Adopted, ...], Field(max_length=16)] = ()
    """What diagnoses have added to `model`, or to `covariates`, the latest last."""
    on_disagreement: DisagreementPolicy | None = None
    """What is done without a person once the model disagrees with raw samples; None for
    nothing."""
    forecast: Forecasting = Forecasting()
    """Thresholds whose time is asked for, and how the future is looked at."""
    costs: CostTable | None = None
    """What failing, repairing and inspecting cost."""
    decision: Deciding | None = None
    """What counts as a failure, and what can be done: what a plan is made of, with `costs`."""
    limit_states: Annotated[tuple[LimitStateSpec, ...], Field(max_length=16)] = ()
    """What counts as a failure, and how probable it may be."""
    alarms: Annotated[tuple[Alarm, ...], Field(max_length=16)] = ()
    alarm_routes: Annotated[tuple[AlarmRoute, ...], Field(max_length=8)] = ()
    """Who is told of events: receivers that the server's settings declare, by name."""
    confirm_readings: Annotated[int, Field(ge=1, le=100)] = 3
    """Readings in a row until an alarm, or a change of validity, is believed."""

    @model_validator(mode="after")
    def _names_each_receiver_once(self) -> Self:
        names = [route.receiver for route in self.alarm_routes]
        if len(set(names)) < len(names):
            raise ValueError(
                f"alarm_routes name {', '.join(names)}, one of them twice. Name each receiver "
                "once, with all severities and kinds that go to it."
            )
        return self

    @model_validator(mode="after")
    def _can_be_told_apart(self) -> Self:
        nominal = self.nominal
        if self.changes == "both" and nominal is not None and not nominal.modal[1] > 0.0:
            raise ValueError(
                "Mass and stiffness are told apart by damping, and the nominal model has none. "
                "Give nominal.damping_ratio, or let only one of them change."
            )
        return self

    @model_validator(mode="after")
    def _can_be_freed_of_covariates(self) -> Self:
        covariates = self.covariates
        if covariates is None:
            return self
        if self.frequency_source == "smoothed":
            raise ValueError(
                "Covariates act on a frequency at once, and a smoothed one is late. Give "
                "frequency_source='measured' with covariates."
            )
        if self.nominal is not None and {*(covariates.reference or ())} != {*covariates.names}:
            raise ValueError(
                "A nominal model with covariates holds at some value of each. Give "
                f"covariates.reference for {', '.join(covariates.names)}, or no nominal model."
            )
        return self

    @model_validator(mode="after")
    def _has_a_model_if_of_elements(self) -> Self:
        of_elements = self.changes == "elements"
        if (self.model is None and of_elements) or (self.parameters and not of_elements):
            raise ValueError(
                f"changes={self.changes!r} was given "
                f"{'without a model' if of_elements else 'with parameters'}. Give a model, and "
                "changes='elements', to estimate many elements; leave `parameters` out for a "
                "twin of one mode."
            )
        if self.assessment is not None and not of_elements:
            raise ValueError(
                f"changes={self.changes!r} was given with an assessment of members. Give a "
                "model and changes='elements', or leave `assessment` out."
            )
        if not of_elements:
            return self._with_alarms_on(_OF_ONE_MODE)
        if self.nominal is not None:
            raise ValueError(
                "A twin of elements was given a nominal frequency. Leave `nominal` out: its "
                "modes are learnt from the first epochs."
            )
        model = self.structure()
        return self._with_alarms_on((*_OF_ONE_MODE[:2], _EACH, *model.free))

    @model_validator(mode="after")
    def _decides_with_costs(self) -> Self:
        if self.decision is not None and self.costs is None:
            raise ValueError(
                "A decision was given without costs. Give `costs` with failure and repair at "
                "least, or leave `decision` out."
            )
        return self

    def _with_alarms_on(self, allowed: tuple[str, ...]) -> Self:
        changes = tuple(name for name in allowed if name not in _OF_ONE_MODE[:2])
        if self.decision is not None:
            single = tuple(name for name in changes if name != _EACH)
            if self.decision.failure.quantity not in single:
                raise ValueError(
                    f"A failure of {self.decision.failure.quantity!r:.60} was given. Allowed: "
                    f"{', '.join(single)}."
                )
        names = [one.name for one in self.limit_states]
        if len(set(names)) < len(names):
            raise ValueError(
                f"Two limit states have one name among {', '.join(names)}. Give each its own."
            )
        for one in self.limit_states:
            single = tuple(name for name in changes if name != _EACH)
            if isinstance(one, ThresholdState) and one.quantity not in single:
                raise ValueError(
                    f"A limit state of {one.quantity!r:.60} was given. Allowed: "
                    f"{', '.join(single)}."
                )
        for threshold in self.forecast.thresholds:
            if threshold.quantity not in changes:
                raise ValueError(
                    f"A threshold of {threshold.quantity!r:.60} was given. Allowed: "
                    f"{', '.join(changes)}."
                )
        for alarm in self.alarms:
            if alarm.quantity not in allowed:
                raise ValueError(
                    f"An alarm on {alarm.quantity!r:.60} was given. Allowed: "
                    f"{', '.join(allowed)}."
                )
        return self

    def structure(self) -> ElementModel:
        """Arrays of the model with its free parameters; for twins of elements only.

        Raises
        ------
        ValueError
            Where model and parameters do not go together; the text says what to do.
        """
        assert self.model is not None
        of_each = None if self.parameters is None else tuple(self.parameters.items())
        return _structure(
            self.model.model_dump_json(exclude={"geometry"}), of_each, self.prior_stiffness_sd
        )

    @property
    def nominal_model(self) -> ModelFile | None:
        """The model before anything was adopted."""
        given = (one.model_before for one in self.adopted if one.clock == "fast")
        return next(given, self.model)

    def watched(self) -> tuple[tuple[str, Alarm], ...]:
        """Each alarm with the quantity it watches; one on `elements` watches each of them."""
        return tuple(
            (name, alarm) for alarm in self.alarms for name in self._each(alarm.quantity)
        )

    @property
    def outlook_horizon(self) -> float | None:
        """How far ahead its future is told, in slow time; None for as long as the past used.

        That of `forecast`, else that of `decision` where it is in slow time.
        """
        if self.forecast.horizon is not None or self.decision is None:
            return self.forecast.horizon
        told = self.costs is not None and self.costs.time_unit == "slow_time"
        return self.decision.horizon if told else None

    def thresholds(self) -> tuple[Limit, ...]:
        """All thresholds: those of the alarms, then those of `forecast`."""
        of_alarms = [
            Limit(name, at, side)
            for name, alarm in self.watched()
            for side, at in [alarm.limit]
            if name not in _OF_ONE_MODE[:2]
        ]
        asked = [
            Limit(name, one.at)
            for one in self.forecast.thresholds
            for name in self._each(one.quantity)
        ]
        return (*of_alarms, *asked)

    def _each(self, quantity: str) -> tuple[str, ...]:
        """Return `quantity`, or each quantity if it stands for all."""
        return self.structure().free if quantity == _EACH else (quantity,)

    @classmethod
    def from_json(cls, text: str) -> "Registration":
        """Read the output of `to_json`."""
        return cls.model_validate_json(text, context=AS_STORED)

    def to_json(self) -> str:
        """Write it as text, all defaults included, so that later defaults change nothing."""
        return self.model_dump_json()

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON-compatible values."""
        content: dict[str, Any] = self.model_dump(mode="json")
        return content


@functools.lru_cache(maxsize=256)
def _structure(
    model: str, parameters: tuple[tuple[str, float], ...] | None, prior_sd: float
) -> ElementModel:
    description = description_of(line_model(model, AS_STORED))
    return model_of(
        description, None if parameters is None else dict(parameters), prior_sd=prior_sd
    )


ID = r"^[a-z0-9][a-z0-9_-]{0,62}\.[a-z0-9][a-z0-9_-]{0,62}$"
"""A twin's id: site and asset, a full stop between them."""


class WrongRegistrationsError(ValueError):
    """A file of registrations that is invalid; the text says where and why."""


def registrations(path: Path | None) -> dict[str, Registration]:
    """Read a TOML or JSON file of twin id → registration; nothing where there is no path."""
    if path is None:
        return {}
    try:
        text = document_text(path)
        content = read_toml(text) if path.suffix == ".toml" else read_json(text)
    except (OSError, ValueError) as error:
        raise WrongRegistrationsError(
            f"{path} cannot be read as registrations: {reason_of(error)} Give a .toml or .json "
            "file of twin id → registration."
        ) from error
    found = {}
    for twin_id, given in content.items() if isinstance(content, dict) else [(content, None)]:
        if not re.fullmatch(ID, str(twin_id)):
            raise WrongRegistrationsError(
                f"{path}: {twin_id!a:.60} is not a valid twin's id. Give "
                "SITE.ASSET in lower case, such "
                'as "lab.beam"; in TOML with quotes: ["lab.beam"].'
            )
        try:
            found[twin_id] = Registration.model_validate(given)
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            where = ".".join(map(str, (twin_id, *fault["loc"])))
            raise WrongRegistrationsError(
                f"{path}: at {where}, {fault['input']!r:.60} was given: {fault['msg']}."
            ) from error
    return found
