"""The trees that composites form over twins, checked for cycles and size."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from slowtime.reliability.trees import (
    Gate,
    Group,
    Node,
    TooLargeTreeError,
    members,
    probability,
)
from slowtime.reliability.trees.dependence import grouped

from .composite import Composite, GateModel

MOST_PLACES = 4096
"""Places of twins in the tree of a composite, those of composites below it included."""

Composites = Mapping[str, Composite]


class WrongCompositeError(ValueError):
    """A composite that is invalid; the text says what to change."""


def check(
    composite_id: str,
    wanted: Composite,
    composites: Composites,
    is_twin: Callable[[str], bool],
    sees: Callable[[str], bool] = lambda _: True,
) -> None:
    """Refuse a composite that names unknown members, contains itself, or is too large.

    Parameters
    ----------
    sees
        Whether who registers it may see a composite above. One that they may not see is not
        looked at: no refusal tells of it, and it is checked when it is assessed.

    Raises
    ------
    WrongCompositeError
        Which says what to change.
    """
    if is_twin(composite_id):
        raise WrongCompositeError(
            f"{composite_id} is a twin already. Give the composite another id, such as "
            f"{composite_id}-line."
        )
    for one in wanted.members:
        if one != composite_id and one not in composites and not is_twin(one):
            raise WrongCompositeError(
                f"The member {one} is neither a twin nor a composite. Register it first: PUT "
                f"/api/v1/twins/{one} or /api/v1/composites/{one}."
            )
    strange = sorted(one for one in wanted.failing if not is_twin(one))
    if strange:
        raise WrongCompositeError(
            f"`failing` names {', '.join(strange)[:200]}, not a twin. A composite fails as its "
            "own tree says."
        )
    after = {**composites, composite_id: wanted}
    if (cycle := _cycle(composite_id, after)) is not None:
        raise WrongCompositeError(
            f"A composite cannot contain itself: {' → '.join(cycle)}. Take one of them out."
        )
    grown = [composite_id, *filter(sees, above(composite_id, after))]
    for one in grown:
        _check_places(one, after)
    leaves = members(tree_of(composite_id, after)) if wanted.dependence else ()
    for group in wanted.dependence:
        if strange := sorted(set(group.members) - set(leaves)):
            raise WrongCompositeError(
                f"`dependence` names {', '.join(strange)[:200]}, not a twin in the tree of "
                f"{composite_id}. Allowed: {', '.join(leaves)[:500]}."
            )
    for one in grown:
        _check_whole(one, after)


def check_tree(composite_id: str, composites: Composites) -> None:
    """Refuse a composite that has become too large since a member was registered anew.

    Raises
    ------
    WrongCompositeError
        Which says what to change.
    """
    _check_places(composite_id, composites)
    _check_whole(composite_id, composites)


def tree_of(composite_id: str, composites: Composites) -> Node:
    """Tree of a composite over twins: each composite below is its own tree in its place."""

    def grown(gate: GateModel) -> Gate:
        return gate.gate(
            tuple(one_of(i) if isinstance(i, str) else grown(i) for i in gate.inputs)
        )

    def one_of(name: str) -> Node:
        return grown(composites[name].whole_tree) if name in composites else name

    return one_of(composite_id)


def groups_of(composite_id: str, composites: Composites) -> tuple[Group, ...]:
    """Collect groups of dependent twins, also of composites below; equal ones once."""
    names = [composite_id, *below(composite_id, composites)]
    every = [one.group() for name in names for one in composites[name].dependence]
    leaves = set(members(tree_of(composite_id, composites)))
    used = [(group, tuple(n for n in group.members if n in leaves)) for group in every]
    held = [dataclasses.replace(one, members=there) for one, there in used if len(there) > 1]
    return tuple(dict.fromkeys(held))


def below(composite_id: str, composites: Composites) -> list[str]:
    """Name the composites within one, each once."""
    return _reached(composite_id, lambda name: composites[name].members, composites)


def above(member_id: str, composites: Composites) -> list[str]:
    """Name the composites that a twin or a composite is in, at any depth."""
    return _reached(member_id, lambda name: memberships(name, composites), composites)


def memberships(member_id: str, composites: Composites) -> list[str]:
    """Name the composites that have a twin or a composite among their members."""
    return [name for name, one in composites.items() if member_id in one.members]


def twins_of(composite_id: str, composites: Composites) -> list[str]:
    """Name the twins within a composite at any depth, each once."""
    names = [composite_id, *below(composite_id, composites)]
    found = [one for name in names for one in composites[name].members]
    return list(dict.fromkeys(one for one in found if one not in composites))


def _reached(
    start: str, onward: Callable[[str], Iterable[str]], composites: Composites
) -> list[str]:
    found: dict[str, None] = {}
    waiting = [start]
    while waiting:
        for one in onward(waiting.pop()):
            if one in composites and one not in found and one != start:
                found[one] = None
                waiting.append(one)
    return list(found)


def _cycle(composite_id: str, composites: Composites) -> tuple[str, ...] | None:
    """Find a path from a composite down to itself."""
    seen: set[str] = set()
    waiting: list[tuple[str, ...]] = [(composite_id,)]
    while waiting:
        path = waiting.pop()
        for one in composites[path[-1]].members:
            if one == composite_id:
                return (*path, one)
            if one in composites and one not in seen:
                seen.add(one)
                waiting.append((*path, one))
    return None


def _check_places(composite_id: str, composites: Composites) -> None:
    """Refuse a tree of too many places."""
    places = _places(composite_id, composites, {})
    if places > MOST_PLACES:
        raise WrongCompositeError(
            f"The tree of {composite_id} would have {places:,} places. Allowed: "
            f"{MOST_PLACES:,}. Use fewer composites in several branches."
        )


def _check_whole(composite_id: str, composites: Composites) -> None:
    """Refuse a tree that cannot be counted, or in which dependences contradict each other."""
    tree, groups = tree_of(composite_id, composites), groups_of(composite_id, composites)
    try:
        grouped(members(tree), groups)
        probability(tree, {name: np.full(1, 0.5) for name in members(tree)}, groups)
    except TooLargeTreeError as error:
        raise WrongCompositeError(f"{composite_id}: {error}") from error
    except ValueError as error:
        raise WrongCompositeError(f"In {composite_id}: {error}") from error


def _places(composite_id: str, composites: Composites, known: dict[str, int]) -> int:
    """Count places of twins without making the tree, which may be too large to be made."""

    def counted(gate: GateModel) -> int:
        return sum(
            counted(one) if isinstance(one, GateModel) else of_one(one) for one in gate.inputs
        )

    def of_one(name: str) -> int:
        if name not in composites:
            return 1
        if name not in known:
            known[name] = counted(composites[name].whole_tree)
        return known[name]

    return of_one(composite_id)
