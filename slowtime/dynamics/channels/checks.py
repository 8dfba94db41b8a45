"""Checks of channels, supports and initial states against nodes and elements."""

from collections.abc import Collection, Iterable, Sequence

from slowtime.dynamics.elements import BASE, Element, Node, Spring
from slowtime.dynamics.units import UnitOfCoordinate, unit_factor

from .declarations import (
    BASE_KINDS,
    DISPLACED,
    IMPOSED_KINDS,
    DescriptionError,
    Input,
    Sensor,
    Start,
    Support,
    Where,
)


def check_supports(supports: Sequence[Support], nodes: Sequence[Node]) -> None:
    """Refuse supports with the name of another support, of a node, or of the base."""
    check_unique("supports", [support.id for support in supports], "id")
    taken = {node.id for node in nodes} | {BASE}
    for i, support in enumerate(supports):
        if support.id in taken:
            raise DescriptionError(
                ("supports", i, "id"),
                f"{support.id!r} is the name of a node or of the base. Rename the support; if "
                f"it only moves with the base, attach its elements to {BASE!r} instead.",
            )


def check_inputs(
    inputs: Sequence[Input],
    nodes: Sequence[Node],
    supports: Sequence[Support],
    coordinate: UnitOfCoordinate,
) -> None:
    """Refuse inputs at places that do not exist, that contradict each other, or in wrong units.

    Raises `DescriptionError`, naming what was given and what is allowed.
    """
    check_unique("inputs", [entry.channel for entry in inputs], "channel")
    moved: dict[str, str] = {}
    still = [one.id for one in supports if one.still]
    for i, entry in enumerate(inputs):
        where = ("inputs", i)
        _check_node(where, entry, nodes, supports)
        try:
            unit_factor(entry.unit, entry.quantity, coordinate)
        except ValueError as error:
            raise DescriptionError((*where, "unit"), str(error)) from None
        steps = entry.hold == "zero" or (
            entry.hold == "first" and entry.quantity == "displacement"
        )
        if entry.quantity in DISPLACED and steps:
            raise DescriptionError(
                (*where, "hold"),
                f"Input {entry.channel!r} is a {entry.quantity} with hold {entry.hold}: its "
                "acceleration would be unbounded at each sample. Leave `hold` out, or set "
                "band_limited.",
            )
        if entry.kind in IMPOSED_KINDS:
            assert entry.node is not None
            if entry.node in still:
                raise DescriptionError(
                    ("inputs", i, "node"),
                    f"Support {entry.node!r} stands still, but input {entry.channel!r} moves "
                    "it. Leave out `still`, or the input.",
                )
            if entry.node in moved:
                raise DescriptionError(
                    (*where, "node"),
                    f"{entry.node!r} is moved by {moved[entry.node]!r} and by "
                    f"{entry.channel!r}. Keep the more accurate one of them.",
                )
            moved[entry.node] = entry.channel
    for i, entry in enumerate(inputs):
        if entry.kind == "force" and entry.node in moved:
            raise DescriptionError(
                ("inputs", i, "node"),
                f"The motion of node {entry.node!r} is imposed by {moved[entry.node]!r}, so "
                f"that a force on it has no effect. Declare {entry.channel!r} as a sensor: "
                f"quantity: force, node: {entry.node}.",
            )


def _check_node(
    where: Where, entry: Input, nodes: Sequence[Node], supports: Sequence[Support]
) -> None:
    if (entry.node is None) != (entry.kind in BASE_KINDS):
        raise DescriptionError(
            where if entry.node is None else (*where, "node"),
            f"Input {entry.channel!r}: {_rule(entry)}",
        )
    if entry.node is None:
        return
    if entry.kind == "force":
        check_known((*where, "node"), entry.node, [node.id for node in nodes])
        return
    driven = [node.id for node in nodes if node.kind == "point"]
    if entry.node not in {*driven, *(support.id for support in supports)}:
        there = ", ".join([*(support.id for support in supports), *driven])
        raise DescriptionError(
            (*where, "node"),
            f"Input {entry.channel!r}: no support and no point node is called {entry.node!r}. "
            f"There are: {there}. Use one of them, or add it under `supports`.",
        )


def _rule(entry: Input) -> str:
    if entry.kind in BASE_KINDS:
        return (
            f"a {entry.kind} moves the base, which is not a node. Leave `node` out, or declare "
            f"an imposed_{_motion(entry)} of a support."
        )
    if entry.kind == "force":
        return "a force acts on a node. Name it as `node`, or declare a base_acceleration."
    return (
        f"an {entry.kind} moves a support or a node. Name it as `node`, or declare a "
        f"base_{_motion(entry)}."
    )


def _motion(entry: Input) -> str:
    return entry.kind.partition("_")[2]


def check_sensors(
    sensors: Sequence[Sensor],
    nodes: Sequence[Node],
    elements: Sequence[Element],
    moved: Collection[str],
    coordinate: UnitOfCoordinate,
) -> None:
    """Refuse sensors of what does not exist, or in wrong units.

    `moved` are the names of supports and of driven nodes. Raises `DescriptionError`.
    """
    for i, sensor in enumerate(sensors):
        where = ("sensors", i)
        if sensor.quantity == "force":
            _check_force(where, sensor, elements, moved)
        elif sensor.element is not None:
            raise DescriptionError(
                (*where, "element"),
                f"Sensor {sensor.channel!r}: only a force is measured in an element. Name the "
                f"`node` whose {sensor.quantity} it measures.",
            )
        elif not sensor.node:
            raise DescriptionError(
                where,
                f"Sensor {sensor.channel!r} measures the {sensor.quantity} of no node. Add "
                "`node`.",
            )
        else:
            known = {node.id for node in nodes} | {*moved, BASE}
            check_known((*where, "node"), sensor.node, known)
        try:
            unit_factor(sensor.unit, sensor.quantity, coordinate)
        except ValueError as error:
            raise DescriptionError((*where, "unit"), str(error)) from None
    check_unique("sensors", [sensor.channel for sensor in sensors], "channel")


def _check_force(
    where: Where, sensor: Sensor, elements: Sequence[Element], moved: Collection[str]
) -> None:
    if bool(sensor.node) == (sensor.element is not None):
        raise DescriptionError(
            where,
            f"Sensor {sensor.channel!r} measures a force: either in an `element`, or on a "
            "`node` that is held or driven from outside. Name one of them.",
        )
    if sensor.element is not None:
        springs = [element.id for element in elements if isinstance(element, Spring)]
        if sensor.element not in springs:
            raise DescriptionError(
                (*where, "element"),
                f"Sensor {sensor.channel!r}: no spring element is called {sensor.element!r}. "
                f"There are: {', '.join(springs) or 'none'}.",
            )
    elif sensor.node not in {*moved, BASE}:
        raise DescriptionError(
            (*where, "node"),
            f"Sensor {sensor.channel!r}: nothing holds or drives {sensor.node!r}, so that no "
            f"reaction acts there. Allowed: {', '.join([BASE, *moved])}; or name an `element`. "
            "A force that is applied is an input.",
        )


def check_start(start: Sequence[Start], names: Collection[str]) -> None:
    """Refuse initial states of nodes that do not move freely, and two of one node."""
    check_unique("initial", [one.node for one in start], "node")
    for i, one in enumerate(start):
        if one.node not in names:
            raise DescriptionError(
                ("initial", i, "node"),
                f"No node that moves freely is called {one.node!r}. There are: "
                f"{', '.join(names) or 'none'}.",
            )


def check_unique(group: str, names: list[str], key: str) -> None:
    """Refuse a name that is used twice in a group."""
    for i, name in enumerate(names):
        if name in names[:i]:
            raise DescriptionError(
                (group, i, key), f"{name!r} is used twice among the {group}. Rename one."
            )


def check_known(where: Where, node: str, known: Iterable[str]) -> None:
    """Refuse a node that does not exist."""
    if node not in known:
        raise DescriptionError(
            where,
            f"No node is called {node!r}. There are: {', '.join(sorted({*known, BASE}))}.",
        )
