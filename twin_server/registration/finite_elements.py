"""Finite-element models in registrations: frames are reduced, matrices in files refused."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from slowtime.dynamics.description import DescriptionError
from slowtime_schemas.files.model_v2 import FiniteElementFile, is_finite_elements
from slowtime_services.models import model_file_of

MOST_NODES = 500
"""Nodes of a frame that a registration may hold: 3000 degrees of freedom are reduced in about a
second, for which the request waits."""


def self_contained(value: Any) -> Any:
    """Turn a frame in space into its reduced model; leave other models as they are.

    Parameters
    ----------
    value
        Model of a registration, as it was sent or stored.

    Returns
    -------
    A model of nodes and elements.

    Raises
    ------
    ValueError
        Where it names matrices in files, or is no frame that can be reduced.
    """
    if not isinstance(value, dict) or not is_finite_elements(value):
        return value
    if value.get("matrices") is not None:
        raise ValueError(
            "The model names matrices in files, which the server cannot read. Reduce it where "
            "they are, and send what that writes: slowtime model reduce MODEL --band-hz F "
            "--out REDUCED.json."
        )
    from slowtime_services.matrices import describe_reduced, matrix_model_of
    from slowtime_services.wireframes import geometry_of, with_geometry

    file = FiniteElementFile.model_validate(value)
    assert file.frame is not None
    rows = [one.channel for one in file.sensors if one.row is not None]
    if rows:
        raise ValueError(
            f"Sensors {', '.join(rows)} name rows of files, which the server cannot read. "
            "Leave them out, or reduce the model where the files are."
        )
    if len(file.frame.nodes) > MOST_NODES:
        raise ValueError(
            f"The frame has {len(file.frame.nodes)} nodes. Allowed in a registration are "
            f"{MOST_NODES}; reduce it before: slowtime model reduce MODEL --band-hz F --out "
            "REDUCED.json."
        )
    try:
        model = matrix_model_of(file, Path())
        reduced = describe_reduced(model)
        return with_geometry(model_file_of(reduced.description), geometry_of(model, reduced))
    except (DescriptionError, ValidationError) as error:
        raise ValueError(str(error)) from error
