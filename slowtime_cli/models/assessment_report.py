"""Page of an assessment: the members in space, coloured by evidence, and tables."""

from pathlib import Path
from typing import Any

import numpy as np

from slowtime.evolution.assessment import Assessment
from slowtime_services.matrices import MatrixModel
from slowtime_services.reports import Scene, Section, Table, write_page
from slowtime_services.wireframes import scene_of

from .shape_report import updated_shapes

CERTAIN = 0.95
"""Probability [1] from which a member is drawn as certain."""

INTERVAL = 1.96
"""Standard deviations of a 95 % interval [1]."""


def write_assessment(
    path: Path, read: MatrixModel, found: Assessment, tables: tuple[Table, Table]
) -> None:
    """Write an assessment as a page.

    Parameters
    ----------
    path
        File to write.
    read
        The model.
    found
        The assessment.
    tables
        Members, and modes in both states.

    Raises
    ------
    MatrixFileError
        Where the model does not say where its nodes are.
    """
    count = max(len(found.pairs), 1)
    wire, shapes = updated_shapes(read, np.zeros(len(read.matrices.names)), count)
    scene = scene_of(wire, shapes)
    scene["changes"] = changes_of(found, scene["groups"])
    sections = [
        Section("Members in space", (_COLOURS,), [Scene(scene, _OUTLINE)]),
        Section("Modes in both states", (), [tables[1]]),
    ]
    if found.sets:
        sections.insert(1, Section("Members that may have changed", (), [tables[0]]))
    write_page(path, f"Assessment of {read.name}", found.sentence, sections)


def changes_of(found: Assessment, groups: list[str]) -> dict[str, dict[str, Any]]:
    """Change of each drawn member, the expected one: loss times probability.

    Parameters
    ----------
    found
        The assessment.
    groups
        Members that are drawn.

    Returns
    -------
    Name → value and ends of its interval [1], which hold zero unless it is certain.
    """
    changes = {name: {"value": 0.0, "lo": 0.0, "hi": 0.0} for name in groups}
    for one in (one for some in found.sets for one in some.suspects if one.name in changes):
        certain = one.probability >= CERTAIN
        half = INTERVAL * one.sd
        changes[one.name] = {
            "value": -one.loss * one.probability,
            "lo": -min(one.loss + half, 1.0),
            "hi": -(one.loss - half) if certain else 0.0,
        }
    return changes


_COLOURS = (
    "Colour is the loss that is expected: the loss of the member, if it is the changed one, "
    "times its probability."
)

_OUTLINE = (
    "Lines are elements; of matrices, they join nodes that the stiffness couples. Ends of "
    "beams are listed in the table only."
)
