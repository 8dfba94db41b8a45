"""The reliability file: random inputs, their dependence, and a limit state as a formula.

What a schema can say is said here; parameters of marginals and the formula are checked where a
file is read, so that the error can name the line.
"""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, StringConstraints, model_validator

from slowtime_schemas.quantities import Frozen, PlainText

from .model import Number, Positive

InputName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,62}$")]
Formula = Annotated[str, StringConstraints(min_length=1, max_length=4000)]
Pair = tuple[InputName, InputName]


class RandomInput(Frozen):
    """One input: the name of its marginal distribution, and that distribution's parameters."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Number]

    marginal: str
    unit: PlainText = ""


class Correlation(Frozen):
    """Correlation of two inputs: exactly one of four kinds."""

    between: Pair
    linear: Number | None = None
    spearman: Number | None = None
    kendall: Number | None = None
    scores: Number | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> "Correlation":
        if len(self.given()) != 1:
            raise ValueError("give exactly one of linear, spearman, kendall, scores")
        return self

    def given(self) -> dict[str, float]:
        """Kind → correlation, of those that were given."""
        kinds = {
            name: getattr(self, name) for name in ("linear", "spearman", "kendall", "scores")
        }
        return {name: value for name, value in kinds.items() if value is not None}


class CopulaOf(Frozen):
    """Copula of a group of inputs, by name."""

    of: tuple[InputName, ...] = Field(min_length=2)
    copula: Literal["clayton", "frank", "gumbel", "student"]
    theta: Number | None = None
    freedom: Positive | None = None
    correlation: Number | None = None
    """Of each pair, of a Student copula."""


class ReliabilityFile(Frozen):
    """A reliability problem as a file."""

    slowtime_reliability: Literal[1]
    name: PlainText = ""
    """Of the structure."""

    failure: PlainText = ""
    """What it means that the limit state is violated, in words: "the column yields"."""

    period: PlainText = ""
    """Time or instant that the probability is of: "50 years", "one crossing"."""

    accepted: float | None = Field(default=None, gt=0, lt=1)
    """Probability of failure that is accepted [1]."""

    inputs: dict[InputName, RandomInput] = Field(min_length=1)
    correlations: tuple[Correlation, ...] = ()
    copulas: tuple[CopulaOf, ...] = ()
    limit_state: Formula | None = None
    """Failure where it is at most 0."""

    system: Literal["series", "parallel"] | None = None
    parts: dict[InputName, Formula] = Field(default_factory=dict)
    invalid: Literal["error", "fails"] = "error"

    @model_validator(mode="after")
    def _one_limit_state(self) -> "ReliabilityFile":
        if (self.system is None) != (not self.parts):
            raise ValueError("`system` and `parts` belong together: give both or neither")
        if self.system is not None and self.limit_state is not None:
            raise ValueError("`limit_state` and `system` exclude each other: give one")
        return self
