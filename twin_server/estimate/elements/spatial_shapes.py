"""Measured modes over those of the current model, on a wireframe in space."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from slowtime.evolution.structures import ParametricStructure
from slowtime_services.assessment.entries import evidence_changes
from slowtime_services.models import description_of
from slowtime_services.wireframes import (
    MeasuredShapes,
    ModelShapes,
    scene_of,
    stored_motions,
    wireframe_of_geometry,
)
from twin_server.history.details import ASSESSMENT
from twin_server.registration.structure import model_of
from twin_server.registration.twin import Registration

from .memory import ElementMemory

MOST_MODES = 12
"""Modes of the model that are shown beside those that were measured."""

RIGID = 1e-10
"""Eigenvalue over the largest of a motion that strains nothing [1], as in
`ParametricStructure.modes`: `model_mode` counts from the lowest above it."""


def spatial_scene(
    registration: Registration, memory: ElementMemory | None, state: Mapping[str, Any]
) -> dict[str, Any] | None:
    """Mode shapes of a twin on its wireframe.

    Parameters
    ----------
    registration
        With the model.
    memory
        What a twin of elements has learnt; None for others.
    state
        Of an epoch: changes of the elements, suspects, channels and modes.

    Returns
    -------
    Scene of the viewer, with the change of each group and whether each sensor has measured;
    None where the model has no geometry.
    """
    geometry = getattr(registration.model, "geometry", None)
    if registration.model is None or geometry is None:
        return None
    structure, theta = _current(registration, memory, state)
    frequencies, shapes = _modes(structure, theta)
    measured = _measured(state, len(frequencies))
    listed = [] if measured is None else [k for k in measured.model_mode if k is not None]
    count = min(len(frequencies), max([MOST_MODES, *(k + 1 for k in listed)]))
    motions = stored_motions(geometry, structure.dof_names) @ shapes[:, :count]
    displacements = motions.T.reshape(count, len(geometry.nodes), 3)
    changed = [word for said in state.get("suspects", ()) for word in _names(said)]
    scene = scene_of(
        wireframe_of_geometry(geometry),
        ModelShapes(frequencies[:count], displacements),
        measured,
        changed=changed,
    )
    elements, channels = state.get("elements") or {}, state.get("channels") or ()
    estimated = [name for name in scene["groups"] if name in elements]
    assessed = state.get(ASSESSMENT)
    scene["changes"] = (
        {name: elements[name] for name in estimated}
        if assessed is None
        else evidence_changes(assessed["sets"], estimated)
    )
    for sensor in scene["sensors"]:
        sensor["measured"] = sensor["channel"] in channels
    return scene


def _names(suspect: str) -> list[str]:
    """Names of a suspicion such as `legs or braces`."""
    return [name for part in suspect.split(" or ") for name in part.split(" and ")]


def _current(
    registration: Registration, memory: ElementMemory | None, state: Mapping[str, Any]
) -> tuple[ParametricStructure, Float[np.ndarray, " parameter"]]:
    """Give the structure as learnt, and logarithms of the factors on its parameters now."""
    if registration.changes == "elements":
        model = registration.structure()
    else:
        assert registration.model is not None
        model = model_of(description_of(registration.model))
    learnt: Sequence[float] = [0.0] * len(model.whole.names)
    if memory is not None and memory.knows:
        learnt = memory.theta
    structure = model.at(learnt)
    changes = state.get("elements") or {}
    values = [changes[name]["value"] if name in changes else 0.0 for name in structure.names]
    return structure, np.log(np.maximum(1.0 + np.array(values, dtype=float), 1e-3))


def _modes(
    structure: ParametricStructure, theta: Float[np.ndarray, " parameter"]
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, "dof mode"]]:
    """Elastic modes in ascending frequency [Hz]; without slopes, which drawings do not need."""
    mass, stiffness = structure.matrices(theta)
    values, shapes = eigh(stiffness, mass)
    bent = values > RIGID * values[-1]
    return np.sqrt(values[bent]) / (2.0 * np.pi), shapes[:, bent]


def _measured(state: Mapping[str, Any], modes: int) -> MeasuredShapes | None:
    """Structural modes of an epoch that have a shape."""
    channels: Sequence[str] = state.get("channels") or ()
    found = [
        mode
        for mode in state.get("modes") or ()
        if mode.get("shape") and mode.get("kind", "structural") == "structural"
    ]
    if not channels or not found:
        return None
    shapes = [np.array(m["shape"]["re"]) + 1j * np.array(m["shape"]["im"]) for m in found]
    numbers = [mode.get("model_mode") for mode in found]
    return MeasuredShapes(
        channels=tuple(channels),
        frequency_hz=np.array([mode["frequency_hz"]["value"] for mode in found]),
        frequency_sd_hz=np.array([mode["frequency_hz"]["sd"] for mode in found]),
        shapes=np.array(shapes, dtype=complex).reshape(len(found), len(channels)),
        model_mode=tuple(k if k is not None and k < modes else None for k in numbers),
    )
