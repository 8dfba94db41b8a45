"""Effects of a description: kind, place and parameter values."""

import dataclasses
import difflib
from collections.abc import Mapping
from typing import Any, Literal

from slowtime.dynamics.description import BASE, Description, DescriptionError, Spring

from .effect_catalogue import catalogue
from .kind import Kind, Where

Path = tuple[str | int, ...]


@dataclasses.dataclass(frozen=True, slots=True)
class Place:
    """Where an effect sits: an element, a node, the base, an input or a sensor, by name.

    Of a history of features it is the covariate that it follows, or time.
    """

    kind: Where | Literal["covariate", "time"]
    id: str

    def __str__(self) -> str:
        return "base" if self.kind == "base" else f"{self.kind} {self.id}"


@dataclasses.dataclass(frozen=True, slots=True)
class Effect:
    """One effect: the name of its kind, its place, its parameters."""

    kind: str
    place: Place
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def entry(self) -> dict[str, Any]:
        """Write as an entry of a model file."""
        place = {} if self.place.kind == "base" else {self.place.kind: self.place.id}
        return {"effect": self.kind} | place | dict(self.parameters)


def read_effects(
    description: Description, kinds: Mapping[str, Kind] | None = None
) -> tuple[Effect, ...]:
    """Read and check the effects of a description.

    Parameters
    ----------
    description
        Structure with its effects.
    kinds
        Those known, by name; the catalogue where not given.

    Returns
    -------
    The effects.

    Raises
    ------
    DescriptionError
        For an effect, a place or a parameter that is not known or not allowed.
    """
    known = catalogue() if kinds is None else kinds
    return tuple(
        _effect(description, ("effects", i), dict(entry), known)
        for i, entry in enumerate(description.effects)
    )


def _effect(
    description: Description, where: Path, entry: dict[str, Any], kinds: Mapping[str, Kind]
) -> Effect:
    name = str(entry.pop("effect", ""))
    if name not in kinds:
        raise DescriptionError(
            (*where, "effect"),
            f"No effect is called {name!r}. {_near(name, kinds)}Known: "
            f"{', '.join(sorted(kinds))}. Others come from files or installed "
            "parts of your own: --effects, or diagnose.effects of a twin server.",
        )
    kind = kinds[name]
    place = _place(description, where, entry, kind)
    parameters = {}
    for key in entry:
        if key not in kind.names:
            raise DescriptionError(
                (*where, key),
                f"{name} has no `{key}`. {_near(key, kind.names)}Allowed: "
                f"{', '.join((*_key(kind), *kind.names))}.",
            )
        parameters[key] = _number(where, key, entry[key])
        fault = kind.parameter(key).refuses(parameters[key])
        if fault:
            raise DescriptionError((*where, key), f"{name}: {fault} {_meaning(kind, key)}")
    for parameter in kind.parameters:
        if parameter.default is None and parameter.name not in parameters:
            raise DescriptionError(
                where, f"{name} needs `{parameter.name}`. {_meaning(kind, parameter.name)}"
            )
    fault = kind.contradiction(parameters)
    if fault:
        raise DescriptionError(where, f"{name}: {fault}")
    return Effect(name, place, parameters)


def is_of_beam(place: Place, description: Description) -> bool:
    """Whether a place is an element or a node of beams, where no effect can sit.

    Parameters
    ----------
    place
        Where an effect would sit.
    description
        The structure; coordinates of a reduced one are nodes of beams.
    """
    if place.kind == "element":
        return any(e.id == place.id and not isinstance(e, Spring) for e in description.elements)
    # A beam's node that is kept from turning moves along one line, as a point does.
    return place.kind == "node" and any(
        n.id == place.id and n.kind == "beam" and n.held != ("rotation",)
        for n in description.nodes
    )


def _place(description: Description, where: Path, entry: dict[str, Any], kind: Kind) -> Place:
    if kind.where == "base":
        return Place("base", str(entry.pop("base", BASE)))
    if kind.where not in entry:
        raise DescriptionError(
            where, f"{kind.name} sits on one {kind.where}. Add `{kind.where}:` and its name."
        )
    name = str(entry.pop(kind.where))
    there = {
        "element": [element.id for element in description.elements],
        "node": [node.id for node in description.nodes],
        "input": [entry.channel for entry in description.inputs],
        "sensor": [sensor.channel for sensor in description.sensors],
    }[kind.where]
    if name not in there:
        raise DescriptionError(
            (*where, kind.where),
            f"{kind.name}: no {kind.where} is called {name!r}. There are: "
            f"{', '.join(there) or 'none'}.",
        )
    if is_of_beam(Place(kind.where, name), description):
        raise DescriptionError(
            (*where, kind.where),
            f"{kind.name}: {kind.where} {name!r} is of a beam. Effects sit on spring elements "
            "and point nodes only; put a spring or a point there.",
        )
    if kind.is_coupling:
        between = next(e.between for e in description.elements if e.id == name)
        if not set(between) <= set(description.dofs):
            raise DescriptionError(
                (*where, kind.where),
                f"{kind.name}: element {name!r} ends at {' and '.join(between)}. Allowed: an "
                "element between two nodes that are free to move.",
            )
    return Place(kind.where, name)


def _number(where: Path, key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DescriptionError((*where, key), f"`{key}` is {value!r}. Give a number.")
    try:
        return float(value)
    except OverflowError:
        raise DescriptionError(
            (*where, key), f"`{key}` is beyond the range of numbers. Give a smaller one."
        ) from None


def _meaning(kind: Kind, name: str) -> str:
    parameter = kind.parameter(name)
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    return f"It is the {parameter.meaning}{unit}."


def _key(kind: Kind) -> tuple[str, ...]:
    return () if kind.where == "base" else (kind.where,)


def _near(name: str, known: Any) -> str:
    near = difflib.get_close_matches(name, list(known), 1)
    return f"Did you mean {near[0]!r}? " if near else ""
