"""Reports with the mode shapes of a finite-element model in space."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.reduction import AdaptiveModel
from slowtime.identification.mode_shapes.criteria import mac_matrix
from slowtime_schemas.files.modes import ModesFile
from slowtime_services.documents.bounds import RESULT
from slowtime_services.documents.document_files import read_checked_json
from slowtime_services.matrices import MatrixModel
from slowtime_services.reports import Chart, Scene, Section, Table, write_page
from slowtime_services.wireframes import (
    MeasuredShapes,
    ModelShapes,
    Wireframe,
    scene_of,
    wireframe_of,
)


def reduced_shapes(
    read: MatrixModel, reduced: AdaptiveModel, count: int
) -> tuple[Wireframe, ModelShapes]:
    """Wireframe of a model, and its lowest modes as built by the reduced model.

    Parameters
    ----------
    read
        The full model.
    reduced
        What `reduce_modal` made of it.
    count
        Number of modes.

    Returns
    -------
    Nodes and lines, and displacements of the nodes.

    Raises
    ------
    MatrixFileError
        Where the model does not say where its nodes are.
    """
    modes = reduced.modes(np.zeros(len(reduced.names)), count)
    wire = wireframe_of(read)
    assert read.matrices.dofs is not None
    rows = wire.motion_rows(read.matrices.dofs)
    own = rows if reduced.expansion is None else rows @ reduced.expansion
    moved = np.asarray((own @ reduced.basis) @ modes.shapes)
    return wire, ModelShapes(modes.frequency_hz, _by_node(moved, wire))


def updated_shapes(
    read: MatrixModel, theta: Float[np.ndarray, " parameter"], count: int
) -> tuple[Wireframe, ModelShapes]:
    """Wireframe of a model, and its lowest modes at values of the parameters.

    Parameters
    ----------
    read
        The full model.
    theta
        Logarithms of the factors on its parameters [1].
    count
        Number of modes, rigid motions left out.

    Returns
    -------
    Nodes and lines, and displacements of the nodes.

    Raises
    ------
    MatrixFileError
        Where the model does not say where its nodes are.
    """
    wire = wireframe_of(read)
    assert read.matrices.dofs is not None
    stiffness, mass = read.matrices.at(np.expm1(theta))
    # Up to six motions of a structure that nothing holds come before the elastic modes.
    modes = lowest_modes(stiffness, mass, min(count + 6, read.matrices.size))
    bent = np.flatnonzero(modes.eigenvalue > RIGID * modes.eigenvalue[-1])[:count]
    rows = wire.motion_rows(read.matrices.dofs)
    own = rows if read.matrices.expansion is None else rows @ read.matrices.expansion
    moved = np.asarray(own @ modes.shapes[:, bent])
    return wire, ModelShapes(modes.frequency_hz[bent], _by_node(moved, wire))


RIGID = 1e-9
"""Eigenvalue over the highest used [1] of a motion that strains nothing, as in updating."""


def _by_node(
    moved: Float[np.ndarray, "motion mode"], wire: Wireframe
) -> Float[np.ndarray, "mode node 3"]:
    return moved.T.reshape(moved.shape[1], len(wire.names), 3)


def measured_of(path: Path, pairs: list[int]) -> MeasuredShapes:
    """Structural modes of a modes file.

    Parameters
    ----------
    path
        What `slowtime identify --method modes --out` wrote.
    pairs
        Of each structural mode, which mode of the model it is.

    Returns
    -------
    The modes, NaN in shapes that the file does not have.
    """
    file = read_checked_json(path, ModesFile, RESULT)
    modes = [mode for mode in file.modes or () if mode.kind == "structural"]
    shapes = np.full((len(modes), len(file.channels)), np.nan, dtype=complex)
    for row, mode in enumerate(modes):
        if mode.shape is not None:
            shapes[row] = np.array(mode.shape.re) + 1j * np.array(mode.shape.im)
    return MeasuredShapes(
        channels=tuple(file.channels),
        frequency_hz=np.array([mode.frequency_hz.value for mode in modes]),
        frequency_sd_hz=np.array([mode.frequency_hz.sd for mode in modes]),
        shapes=shapes,
        model_mode=tuple(pairs),
    )


def write_shapes(path: Path, title: str, wire: Wireframe, shapes: ModelShapes) -> None:
    """Write the modes of a model as a page.

    Parameters
    ----------
    path
        File to write.
    title
        Name of the model.
    wire, shapes
        Wireframe and modes.
    """
    frequencies = shapes.frequency_hz.tolist()
    table = Table(
        ("mode", "frequency [Hz]"),
        [(f"{j + 1}", f"{f:.6g}") for j, f in enumerate(frequencies)],
    )
    scene = Scene(scene_of(wire, shapes), _OUTLINE)
    sections = [Section("Shapes in space", (), [scene]), Section("Frequencies", (), [table])]
    lead = f"The {len(frequencies)} lowest modes, at the parameters as built."
    write_page(path, f"Modes of {title}", lead, sections)


def write_updated(
    path: Path,
    title: str,
    tables: list[Table],
    parts: tuple[Wireframe, ModelShapes, MeasuredShapes],
    notes: list[str],
) -> None:
    """Write an updated model as a page: tables, shapes measured over model, MAC.

    Parameters
    ----------
    path
        File to write.
    title
        Name of the model.
    tables
        Parameters and frequencies.
    parts
        Wireframe, modes of the updated model, measured modes.
    notes
        Sentences on what the modes do not determine or explain.
    """
    wire, shapes, measured = parts
    sections = [
        Section("Parameters", notes, tables[:1]),
        Section("Shapes in space, measured over updated model", (), [
            Scene(scene_of(wire, shapes, measured), _OUTLINE)
        ]),
        Section("Frequencies", (), tables[1:]),
    ]  # fmt: skip
    chart = mac_chart(wire, shapes, measured)
    if chart is not None:
        sections.insert(2, Section("Modal assurance criterion", (), [chart]))
    lead = f"{len(measured.frequency_hz)} measured modes beside those of the updated model."
    write_page(path, f"Updated model of {title}", lead, sections)


_OUTLINE = (
    "Lines are elements; of matrices, they join nodes that the stiffness couples. Of large "
    "models, nodes of sensors and others far from each other are drawn."
)


def mac_chart(wire: Wireframe, shapes: ModelShapes, measured: MeasuredShapes) -> Chart | None:
    """Return the MAC of every measured mode with every mode of the model.

    Parameters
    ----------
    wire
        With the sensors.
    shapes
        Modes of the model.
    measured
        Measured modes.

    Returns
    -------
    A chart; None with fewer than two sensors, or without shapes.
    """
    marks = [one for one in wire.sensors if one.channel in measured.channels]
    columns = [measured.channels.index(one.channel) for one in marks]
    rows = np.flatnonzero(np.isfinite(measured.shapes).all(axis=1))
    if len(marks) < 2 or not rows.size:
        return None
    seen = np.array([shapes.displacements[:, one.node] @ np.array(one.along) for one in marks])
    values = mac_matrix(measured.shapes[rows][:, columns].T, seen.astype(complex))
    named = [f"{f:.4g} Hz" for f in shapes.frequency_hz.tolist()]
    trace = {
        "type": "heatmap", "z": np.round(values, 4).tolist(), "x": named,
        "y": [f"{f:.4g} Hz" for f in measured.frequency_hz[rows].tolist()],
        "zmin": 0.0, "zmax": 1.0, "colorscale": "Blues", "reversescale": True,
        "texttemplate": "%{z:.2f}",
    }  # fmt: skip
    axes = {
        "xaxis": {"title": {"text": "model"}, "type": "category"},
        "yaxis": {"title": {"text": "measured"}, "type": "category"},
    }
    return Chart([trace], axes, "MAC of measured shapes and shapes of the updated model.")
