"""Places that a model has no element for: between points that nothing joins, and to the ground.

What joins two points on the rig, and is forgotten in the model, acts between them as a law acts
in an element. So the search is given an element that states nothing, an open joint, for each
pair of points that nothing joins; those on which nothing is found are taken away again.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence

from slowtime.dynamics.channels import BASE_KINDS, IMPOSED_KINDS, Support
from slowtime.dynamics.description import BASE, Description, Matrix, OpenJoint, Spring

from .diagnosis import Diagnosis
from .localization import NodePair

STILL = "still"
"""Name of a point that stands still while the base moves."""
MOST_JOINTS = 40
"""[open joints] Up to which there is one for each pair. Source: a bound on computing time; each
costs as much as an element, and nine points in a row have 36."""
LIKELY_JOINTS = 16
"""[open joints] Between the likeliest pairs, where there are more. Source: the forgotten spring
of chains of 12 and 24 masses is the first of all; half are for a second one beside it."""


def with_open_joints(
    description: Description,
    likely: Callable[[Description, Sequence[NodePair], int], Sequence[NodePair]] | None = None,
) -> Description:
    """Join pairs of points that nothing joins by elements that state nothing.

    Models with reduced substructures are given back as they are. Where there are more than
    `MOST_JOINTS` pairs, `likely` chooses so many of them; the first are taken without it.
    """
    description = _with_still_neighbour(description)
    every = list(_unjoined(description))
    pairs: Sequence[NodePair] = every[:MOST_JOINTS]
    if likely is not None and len(every) > MOST_JOINTS:
        pairs = likely(description, every, LIKELY_JOINTS)
    taken = {one.id for one in (*description.elements, *description.nodes)}
    joints = [
        OpenJoint(id=_name(pair, taken), between=pair, among=len(every)) for pair in pairs
    ]
    return dataclasses.replace(description, elements=(*description.elements, *joints))


def without_unused_joints(description: Description) -> Description:
    """Keep of the open joints those that have an effect, as elements of the model."""
    used = {effect["element"] for effect in description.effects if "element" in effect}
    elements = tuple(
        Spring(id=one.id, between=one.between) if isinstance(one, OpenJoint) else one
        for one in description.elements
        if not isinstance(one, OpenJoint) or one.id in used
    )
    ends = {end for one in elements for end in one.between}
    supports = (one for one in description.supports if not one.still or one.id in ends)
    return dataclasses.replace(description, elements=elements, supports=tuple(supports))


def strip_joints(answer: Diagnosis) -> Diagnosis:
    """Give a diagnosis whose models have no open joints that nothing sits on."""
    places = (
        *(one.effect.place for one in answer.effects),
        *(r.place for r in answer.undecided),
    )
    named = {place.id for place in places if place.kind == "element"}
    # Joints that are named are told, whether the model gains them or they are rivals.
    told = tuple(
        f"{one.id} stands for what joins {' and '.join(one.between)}, which no element of the "
        "model as given does."
        for one in answer.nominal.elements
        if isinstance(one, OpenJoint) and one.id in named
    )
    return dataclasses.replace(
        answer,
        notes=(*told, *answer.notes),
        nominal=without_unused_joints(answer.nominal),
        refitted=without_unused_joints(answer.refitted),
        augmented=without_unused_joints(answer.augmented),
    )


def _with_still_neighbour(description: Description) -> Description:
    """Add a point that stands still, where the base moves and there is none."""
    shaken = any(entry.kind in BASE_KINDS for entry in description.inputs)
    if not shaken or any(one.still for one in description.supports):
        return description
    name, taken = STILL, {*description.moved, *(node.id for node in description.nodes)}
    while name in taken:
        name += "'"
    supports = (*description.supports, Support(id=name, still=True))
    return dataclasses.replace(description, supports=supports)


def _name(pair: tuple[str, str], taken: set[str]) -> str:
    """Name an open joint by its ends, and add the name to those that are taken."""
    name = "-".join(pair)
    while name in taken:
        name += "'"
    taken.add(name)
    return name


def _unjoined(description: Description) -> Iterator[tuple[str, str]]:
    """Give pairs of points that nothing joins, those with the ground first."""
    if any(isinstance(element, Matrix) for element in description.elements):
        return
    # Points that inputs move, and those that stand still, are places of their own; other
    # supports are the ground.
    driven = {entry.node for entry in description.inputs if entry.kind in IMPOSED_KINDS}
    driven |= {one.id for one in description.supports if one.still}
    grounded = {one.id for one in description.supports} - driven
    free = [node.id for node in description.nodes if node.id in description.dofs]
    moved = [name for name in description.moved if name in driven]
    joined = {
        frozenset(BASE if end in grounded else end for end in element.between)
        for element in description.elements
    }
    for pair in itertools.combinations([BASE, *moved, *free], 2):
        if frozenset(pair) not in joined and pair[1] not in driven:
            yield pair
