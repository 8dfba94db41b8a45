"""Model files of any kind → descriptions: finite-element models are reduced."""

from collections.abc import Callable, Mapping
from pathlib import Path

from slowtime.dynamics.description import Description, DescriptionError
from slowtime.dynamics.effects import Kind, read_effects
from slowtime_services.models import read_description, read_finite_elements

from .errors import MatrixFileError
from .matrix_model import matrix_model_of
from .reduced_description import describe_reduced


def read_any_description(
    path: Path,
    kinds: Mapping[str, Kind] | None = None,
    *,
    note: Callable[[str], None] | None = None,
) -> Description:
    """Read a model file of either version; reduce it where it holds finite elements.

    Parameters
    ----------
    path
        Model file.
    kinds
        Of effect, by name; the catalogue where not given.
    note
        Told what was reduced and left out.

    Raises
    ------
    ModelFileError, MatrixFileError
        (ValueErrors) naming what is wrong and what to do.
    """
    file = read_finite_elements(path)
    if file is None:
        return read_description(path, kinds)
    model = matrix_model_of(file, path.parent, path.stem)
    try:
        found = describe_reduced(model)
        read_effects(found.description, kinds)
    except DescriptionError as error:
        raise MatrixFileError(f"{path.name}: {error}") from error
    if note is not None:
        note(
            f"{path.name}: {model.matrices.size} degrees of freedom, reduced to "
            f"{found.model.size} coordinates, {found.model.interface} of them motions of "
            "sensors, forces and joints."
        )
        if found.left_out:
            note(f"Strains are left out: {', '.join(found.left_out)}.")
    return found.description
