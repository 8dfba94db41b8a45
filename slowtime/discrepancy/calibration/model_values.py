"""Descriptions with values of a plant's constants."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from slowtime.dynamics.description import Beam, Description, Matrix, OpenJoint, Spring
from slowtime.dynamics.plant import Name

_SPRING = {"stiffness": "stiffness_n_per_m", "damping": "damping_n_s_per_m"}
_BEAM = {
    "stiffness": "bending_stiffness_n_m2",
    "damping": "damping_s",
    "mass": "mass_kg_per_m",
}
_MATRIX = {
    "stiffness": "stiffness_factor",
    "damping": "damping_factor",
    "mass": "mass_factor",
}
_FIELDS = {Spring: _SPRING, OpenJoint: _SPRING, Beam: _BEAM, Matrix: _MATRIX}


def with_values(description: Description, values: Mapping[Name, float]) -> Description:
    """Copy a description with some of its constants changed, effects included.

    Examples
    --------
    >>> from slowtime.dynamics.description import Node
    >>> one = Description(
    ...     name="one",
    ...     nodes=(Node(id="m", mass_kg=1.0),),
    ...     elements=(Spring(id="j", between=("base", "m"), stiffness_n_per_m=4.0),),
    ... )
    >>> with_values(one, {("stiffness", "j"): 5.0}).elements[0].stiffness_n_per_m
    5.0
    """
    nodes = tuple(
        dataclasses.replace(node, mass_kg=values.get(("mass", node.id), node.mass_kg))
        for node in description.nodes
    )
    elements = []
    for element in description.elements:
        fields = _FIELDS[type(element)]
        changed: dict[str, Any] = {
            field: values[what, element.id]
            for what, field in fields.items()
            if (what, element.id) in values
        }
        elements.append(dataclasses.replace(element, **changed))
    effects = []
    for i, effect in enumerate(description.effects):
        own = {
            name[2]: value for name, value in values.items() if len(name) == 3 and name[1] == i
        }
        effects.append({**effect, **own})
    return dataclasses.replace(
        description, nodes=nodes, elements=tuple(elements), effects=tuple(effects)
    )
