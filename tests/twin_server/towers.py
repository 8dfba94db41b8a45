"""A braced tower as a model file of version 2, and features of the full model of it."""

from pathlib import Path
from typing import Any

import numpy as np

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime_schemas.files.model_v2 import FiniteElementFile
from slowtime_services.matrices import MatrixModel, matrix_model_of

GROUPS = ("lower legs", "upper legs", "braces")
LOSS = (0.0, -0.1, 0.0)
SITES = tuple(
    (f"{level}.{corner}", way) for level in (1, 2) for corner in (0, 2) for way in "xy"
)


def tower() -> dict[str, Any]:
    """A tower of two storeys on four legs, braced by bars, as a section of a model file."""
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.5), (0.0, 1.5))
    nodes = [
        {"id": f"{level}.{c}", "at": [x, y, 3.0 * level]}
        for level in range(3)
        for c, (x, y) in enumerate(corners)
    ]
    elements = []
    for level in range(2):
        for c in range(4):
            after = (c + 1) % 4
            feet, heads = f"{level}.{c}", f"{level + 1}.{c}"
            given = {"material": "steel", "section": "pipe", "theory": "euler"}
            elements += [
                {"id": f"leg {feet}", "between": [feet, heads], **given,
                 "group": GROUPS[level]},
                {"id": f"girt {heads}", "between": [heads, f"{level + 1}.{after}"], **given},
                {"id": f"brace {feet}", "kind": "bar",
                 "between": [feet, f"{level + 1}.{after}"],
                 "material": "steel", "section": "rod", "group": GROUPS[2]},
            ]  # fmt: skip
    return {
        "slowtime_model": 2,
        "frame": {
            "materials": [{"id": "steel", "young_pa": 2.1e11, "density_kg_m3": 7850.0}],
            "sections": [
                {"id": "pipe", "shape": "tube", "diameter_m": 0.1, "wall_m": 0.004},
                {"id": "rod", "area_m2": 1.2e-4},
            ],
            "nodes": nodes,
            "elements": elements,
            "masses": [{"id": "deck", "node": "2.0", "mass_kg": 150.0}],
            "supports": [{"node": f"0.{c}"} for c in range(4)],
            "parameters": [{"name": name, "groups": [name]} for name in GROUPS],
        },
        "sensors": [
            {"channel": f"{node}{way}", "node": node, "direction": f"u{way}"}
            for node, way in SITES
        ],
        "tolerance": {"stiffness": 0.1, "damping": 0.5, "mass": 0.0},
    }


def full_model() -> MatrixModel:
    """The tower before reduction."""
    return matrix_model_of(FiniteElementFile.model_validate(tower()), Path())


def epoch(made: Any, model: MatrixModel, sequence: int, changes: tuple[float, ...]) -> Any:
    """Features of one epoch of the full model, its stiffness 4 % above that of the file."""
    theta = np.array(changes) * 1.04 + 0.04
    stiffness, mass = model.matrices.at(theta)
    modes = lowest_modes(stiffness, mass, 6)
    seen = model.matrices.rows(model.sensors) @ modes.shapes
    found = [
        made.mode(f, seen[:, j], identity=j + 1)
        for j, f in enumerate(modes.frequency_hz.tolist())
    ]
    return made.message(sequence, found, channels=model.channels)
