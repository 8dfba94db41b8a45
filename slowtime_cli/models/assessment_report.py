"""Page of an assessment: the members in space, coloured by evidence, and tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.assessment import evidence_changes
from slowtime_services.matrices import MatrixModel
from slowtime_services.reports import Scene, Section, Table, write_page
from slowtime_services.wireframes import scene_of

from .shape_report import updated_shapes


def write_assessment(
    path: Path, read: MatrixModel, found: Mapping[str, Any], tables: tuple[Table, Table]
) -> None:
    """Write an assessment as a page.

    Parameters
    ----------
    path
        File to write.
    read
        The model.
    found
        The assessment as `assessment_entry` makes it.
    tables
        Members, and modes in both states.

    Raises
    ------
    MatrixFileError
        Where the model does not say where its nodes are.
    """
    count = max(len(found["modes"]), 1)
    wire, shapes = updated_shapes(read, np.zeros(len(read.matrices.names)), count)
    scene = scene_of(wire, shapes)
    scene["changes"] = evidence_changes(found["sets"], scene["groups"])
    sections = [
        Section("Members in space", (_COLOURS,), [Scene(scene, _OUTLINE)]),
        Section("Modes in both states", (), [tables[1]]),
    ]
    if found["sets"]:
        sections.insert(1, Section("Members that may have changed", (), [tables[0]]))
    write_page(path, f"Assessment of {read.name}", found["sentence"], sections)


_COLOURS = (
    "Colour is the loss that is expected: the loss of the member, if it is the changed one, "
    "times its probability."
)

_OUTLINE = (
    "Lines are elements; of matrices, they join nodes that the stiffness couples. Ends of "
    "beams are listed in the table only."
)
