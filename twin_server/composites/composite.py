"""The registration of a composite: its members, their gates and their dependence."""

from typing import Annotated, Any, Self, TypeAlias

from pydantic import ConfigDict, Field, model_validator

from slowtime.reliability.trees import (
    CommonCause,
    Equicorrelated,
    Gate,
    Group,
    k_of_n,
    parallel,
    series,
)
from slowtime_schemas.answers.composites import CompositeKind
from slowtime_schemas.quantities import AS_STORED, Immutable, Plain
from twin_server.registration.thresholds import Positive, Quantity
from twin_server.registration.twin import ID

MOST_MEMBERS = 256
"""Members of one composite."""

MOST_DEPTH = 16
"""Gates within gates."""

Id = Annotated[str, Field(pattern=ID), Plain]
Rho = Annotated[float, Field(ge=0, le=0.999)]
Share = Annotated[float, Field(ge=0, le=1)]


class GateModel(Immutable):
    """A gate: `series`, `parallel`, or `k` with `of`, over members and other gates."""

    series: Annotated[
        tuple["Input", ...] | None, Field(description="Fails as soon as one input fails.")
    ] = None
    parallel: Annotated[
        tuple["Input", ...] | None, Field(description="Fails once all inputs have failed.")
    ] = None
    k: Annotated[
        int | None, Field(ge=1, description="Works while at least so many of `of` work.")
    ] = None
    of: tuple["Input", ...] | None = None

    @model_validator(mode="after")
    def _is_one_gate(self) -> Self:
        given = [name for name in ("series", "parallel", "of") if getattr(self, name)]
        if len(given) != 1 or (self.k is not None) != (given == ["of"]):
            raise ValueError(
                "A gate is one of {'series': [...]}, {'parallel': [...]} and "
                "{'k': 2, 'of': [...]}, each with at least one input. Give one of them."
            )
        if self.of is not None and self.k is not None and self.k > len(self.of):
            raise ValueError(
                f"k={self.k} of {len(self.of)} inputs are asked to work. Allowed: 1 to "
                f"{len(self.of)}."
            )
        return self

    @property
    def inputs(self) -> "tuple[str | GateModel, ...]":
        """Members and gates below."""
        return self.series or self.parallel or self.of or ()

    def gate(self, inputs: tuple[str | Gate, ...]) -> Gate:
        """Make the gate of other inputs, as many as it has."""
        if self.series is not None:
            return series(*inputs)
        if self.parallel is not None:
            return parallel(*inputs)
        assert self.k is not None
        return k_of_n(self.k, *inputs)


Input: TypeAlias = Id | GateModel
GateModel.model_rebuild()


class Dependence(Immutable):
    """Twins that do not fail independently: by a common cause, or equally correlated."""

    members: Annotated[tuple[Id, ...], Field(min_length=2, max_length=MOST_MEMBERS)]
    beta: Annotated[
        Share | None,
        Field(description="Share of failures that one event causes in all at once."),
    ] = None
    rho: Annotated[
        Rho | None,
        Field(description="Correlation of the members' standard normal safety margins."),
    ] = None

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> Self:
        if (self.beta is None) == (self.rho is None):
            raise ValueError(
                "A dependence has either beta (common cause) or rho (correlation). Give one."
            )
        if len(set(self.members)) < len(self.members):
            raise ValueError("A dependence names a member twice. Name each once.")
        return self

    def group(self) -> Group:
        """Make the group of the arithmetic."""
        if self.beta is not None:
            return CommonCause(self.members, self.beta)
        assert self.rho is not None
        return Equicorrelated(self.members, self.rho)


class Failing(Immutable):
    """The value of a change from which on a twin counts as failed."""

    quantity: Quantity
    at: Annotated[float, Field(ge=-1.0, le=1e6, examples=[-0.2])]


EXAMPLE: dict[str, Any] = {
    "name": "North yard",
    "kind": "site",
    "members": ["north.pump1", "north.pump2", "north.frame"],
    "tree": {"series": ["north.frame", {"parallel": ["north.pump1", "north.pump2"]}]},
    "dependence": [{"members": ["north.pump1", "north.pump2"], "beta": 0.1}],
    "failing": {"north.frame": {"quantity": "stiffness_change", "at": -0.3}},
    "horizon": 365.0,
    "alike": ["north.pump1", "north.pump2"],
}


class Composite(Immutable):
    """A twin made of twins: a site, a line of like assets, a structure of parts.

    Examples
    --------
    >>> Composite(members=("lab.a", "lab.b")).whole_tree.series
    ('lab.a', 'lab.b')
    """

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    name: Annotated[str, Field(max_length=100), Plain] = ""
    kind: CompositeKind = "site"
    members: Annotated[tuple[Id, ...], Field(min_length=1, max_length=MOST_MEMBERS)]
    """Twins, and other composites, by their ids."""
    tree: GateModel | None = None
    """How the failure of members makes the composite fail; by default a series of all of
    them: it fails as soon as one does. A member may stand in several branches, or in none."""
    dependence: Annotated[tuple[Dependence, ...], Field(max_length=64)] = ()
    """Twins below that depend on each other; all others fail independently."""
    failing: dict[Id, Failing] = Field(default_factory=dict, max_length=MOST_MEMBERS)
    """When a member that is a twin counts as failed; by default at the thresholds of its own
    registration."""
    horizon: Annotated[
        Positive | None,
        Field(description="How far ahead, in slow time; by default as the members' forecasts."),
    ] = None
    alike: Annotated[tuple[Id, ...] | None, Field(max_length=MOST_MEMBERS)] = None
    """Members whose drift rates are pooled; by default all twins of a `line`, else none."""

    @model_validator(mode="after")
    def _names_its_members(self) -> Self:
        if len(set(self.members)) < len(self.members):
            raise ValueError(
                "`members` names one twice. Name each once; it may stand in several branches "
                "of `tree`."
            )
        elsewhere = {
            "tree": set(_leaves(self.tree, 0)) if self.tree is not None else set(),
            "failing": set(self.failing),
            "alike": set(self.alike or ()),
        }
        for where, names in elsewhere.items():
            if strange := sorted(names - set(self.members)):
                raise ValueError(
                    f"`{where}` names {', '.join(strange)[:200]}, not among the members. "
                    f"Allowed: {', '.join(self.members)[:500]}."
                )
        return self

    @property
    def whole_tree(self) -> GateModel:
        """The tree, or the series of all members where none was given."""
        return self.tree or GateModel(series=self.members)

    @classmethod
    def from_json(cls, text: str) -> "Composite":
        """Read the output of `to_json`."""
        return cls.model_validate_json(text, context=AS_STORED)

    def to_json(self) -> str:
        """Write it as text, all defaults included, so that later defaults change nothing."""
        return self.model_dump_json()

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON-compatible values, without gates' empty fields."""
        content: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        return content


def _leaves(tree: GateModel, depth: int) -> list[str]:
    if depth > MOST_DEPTH:
        raise ValueError(f"Gates are nested more than {MOST_DEPTH} deep. Nest them less.")
    found = []
    for one in tree.inputs:
        found += [one] if isinstance(one, str) else _leaves(one, depth + 1)
    return found
