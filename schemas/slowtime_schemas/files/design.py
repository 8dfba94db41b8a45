"""The design file: what may be chosen, what scatters, what is minimised and what must hold.

Formulas speak of variables, inputs, responses of a model and `cost`; they are checked where a
file is read, so that the error can name the line.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from slowtime_schemas.quantities import Frozen, PlainText

from .model import Number, Positive
from .reliability import CopulaOf, Correlation, Formula, InputName, RandomInput

PartName = Annotated[
    str, StringConstraints(pattern=r"^[^\s.]{1,100}\.(stiffness|damping|mass)$")
]


class DesignVariable(Frozen):
    """A quantity to choose; with a model, what it adds and where."""

    lower: Number
    upper: Number
    start: Number | None = None
    unit_cost: Number = 0.0
    """Cost of one unit of the variable."""

    adds: Literal["stiffness", "damping", "mass"] | None = None
    element: str | None = None
    """Spring beside which stiffness or damping is added."""

    between: tuple[str, str] | None = None
    node: str | None = None
    """Where mass is added."""

    @model_validator(mode="after")
    def _has_a_place(self) -> Self:
        places = [name for name in ("element", "between", "node") if getattr(self, name)]
        wanted = {None: 0, "mass": 1}.get(self.adds, 1)
        if len(places) != wanted or (self.adds == "mass") != ("node" in places):
            raise ValueError(
                "give `node` for mass, `element` or `between` for stiffness and damping, and "
                "none of them for a variable that adds nothing"
            )
        return self


class KanaiTajimi(Frozen):
    """Ground that rings."""

    frequency_hz: Positive
    damping_ratio: Positive


class DesignLoad(Frozen):
    """What shakes the model: noise, a steady vibration or a recording."""

    kind: Literal["noise", "harmonic", "record"]
    on: str = "base"
    """`base` for base acceleration, or the node on which a force acts."""

    psd: Positive | None = None
    """One-sided [(m/s^2)^2/Hz] or [N^2/Hz], of noise."""

    kanai_tajimi: KanaiTajimi | None = None
    low_pass_hz: Positive | None = None
    amplitude: Positive | None = None
    frequency_hz: Positive | None = None
    file: str | None = None
    channel: str | None = None
    rate_hz: Positive | None = None
    intensity: RandomInput | None = None
    """Random factor of the load."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        needed = {
            "noise": ("psd",),
            "harmonic": ("amplitude", "frequency_hz"),
            "record": ("file",),
        }
        own = {
            "noise": {"psd", "kanai_tajimi", "low_pass_hz"},
            "harmonic": {"amplitude", "frequency_hz"},
            "record": {"file", "channel", "rate_hz"},
        }
        given = {name for name in set().union(*own.values()) if getattr(self, name) is not None}
        missing = [name for name in needed[self.kind] if name not in given]
        strange = sorted(given - own[self.kind])
        if missing:
            raise ValueError(f"a load of kind {self.kind} needs {' and '.join(missing)}")
        if strange:
            raise ValueError(f"{', '.join(strange)} does not belong to {self.kind}")
        if self.kanai_tajimi is not None and self.low_pass_hz is not None:
            raise ValueError("give one of kanai_tajimi and low_pass_hz")
        return self


class DesignResponse(Frozen):
    """A number of the response: at a node, between two nodes, or in a spring."""

    quantity: Literal["displacement", "velocity", "acceleration", "force"]
    node: str | None = None
    """Against the base; of an acceleration, in space."""

    between: tuple[str, str] | None = None
    """Second node less the first: a drift."""

    element: str | None = None
    statistic: Literal["rms", "peak", "mean_peak"] = "rms"
    duration_s: Positive | None = None

    @model_validator(mode="after")
    def _has_a_place(self) -> Self:
        places = [name for name in ("node", "between", "element") if getattr(self, name)]
        allowed: dict[str, set[str]] = {
            "force": {"element"},
            "acceleration": {"node"},
            "velocity": {"node", "between"},
            "displacement": {"node", "between"},
        }
        if len(places) != 1 or places[0] not in allowed[self.quantity]:
            raise ValueError(
                f"a response of {self.quantity} needs one of "
                f"{', '.join(sorted(allowed[self.quantity]))}"
            )
        return self


class DesignObjective(Frozen):
    """A formula, and how much its mean counts beside its standard deviation (eq. 4.18)."""

    formula: Formula
    alpha: Annotated[float, Field(ge=0, le=1)] = 1.0


class DesignLimitState(Frozen):
    """A formula that fails where it is at most 0, and how probable that may be."""

    formula: Formula
    probability: Annotated[float, Field(gt=0, le=0.5)]


class DesignFile(Frozen):
    """A design problem as a file."""

    slowtime_design: Literal[1]
    name: PlainText = ""
    model: str | None = None
    """Path of a model file, from this file's folder."""

    load: DesignLoad | None = None
    variables: dict[InputName, DesignVariable] = Field(min_length=1, max_length=20)
    inputs: dict[InputName, RandomInput] = Field(default_factory=dict)
    correlations: tuple[Correlation, ...] = ()
    copulas: tuple[CopulaOf, ...] = ()
    scatter: dict[PartName, RandomInput] | None = None
    """Random factors of parts of the model; by default from its tolerance."""

    responses: dict[InputName, DesignResponse] = Field(default_factory=dict)
    objective: DesignObjective
    limit_states: dict[InputName, DesignLimitState] = Field(default_factory=dict)
    surrogate_runs: Annotated[int, Field(ge=20, le=5000)] | None = None
    """Runs of the model that surrogates of the responses are learnt from; by default 300 under
    a recorded load, and none otherwise."""

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if self.model is None:
            adding = [name for name, one in self.variables.items() if one.adds]
            of_model = [*adding, *self.responses, *(self.scatter or ())]
            if of_model or self.load is not None:
                raise ValueError(
                    f"{', '.join(of_model) or 'load'}: give `model`, of which this speaks"
                )
        elif self.load is None or not self.responses:
            raise ValueError("with a `model`, give its `load` and its `responses`")
        names = [*self.variables, *self.inputs, *self.responses, "cost"]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)}: give each name once; `cost` is taken")
        return self
