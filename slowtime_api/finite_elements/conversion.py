"""Meshes of finite-element programs → model files."""

import dataclasses
from pathlib import Path
from typing import Any, Literal

from slowtime_api.arguments import existing_file
from slowtime_api.results import Result
from slowtime_schemas.files.finite_elements import FrameModel
from slowtime_schemas.files.model_v2 import FiniteElementFile
from slowtime_services.argument_checks import checked
from slowtime_services.matrices import matrix_model_of
from slowtime_services.matrices.meshes import convert_mesh, frame_text

from .matrix_models import FiniteElementModel


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ConvertedMesh(Result):
    """A mesh of beams, bars, springs, masses and shells as a frame.

    Parameters
    ----------
    name
        Name of the mesh.
    file
        Content of the model file.
    notes
        What was assumed.
    """

    name: str
    file: FiniteElementFile
    notes: tuple[str, ...]

    @property
    def frame(self) -> FrameModel:
        """Nodes, elements, masses and supports."""
        assert self.file.frame is not None
        return self.file.frame

    @property
    def heading(self) -> str:
        """What was converted, in a line."""
        return f"Mesh {self.name!r}"

    def rows(self) -> list[dict[str, Any]]:
        """Return how many parts of each sort there are.

        Returns
        -------
        One dictionary per sort: ``part`` and ``count``.
        """
        parts = ("nodes", "elements", "shells", "masses", "supports", "parameters")
        return [{"part": name, "count": len(getattr(self.frame, name))} for name in parts]

    def model(self) -> FiniteElementModel:
        """Assemble the frame.

        Returns
        -------
        The model; sensors and inputs are added in its file.
        """
        return FiniteElementModel(matrix_model_of(self.file, Path(), self.name))

    @checked
    def save(self, path: str | Path) -> None:
        """Write the model file (YAML).

        Parameters
        ----------
        path
            File to write.
        """
        Path(path).write_text(frame_text(self.file), encoding="utf-8")


@checked
def convert(
    path: str | Path,
    *,
    unit: Literal["m", "mm", "in"] = "m",
    parameters: bool = False,
) -> ConvertedMesh:
    """Convert a mesh of Nastran, Abaqus or CalculiX to a model file with a frame.

    Parameters
    ----------
    path
        Bulk data of Nastran (.bdf, .dat, .nas), or input of Abaqus or CalculiX (.inp).
    unit
        Unit system of the mesh by its unit of length: ``"m"`` (m, N, kg), ``"mm"`` (mm, N,
        tonne) or ``"in"`` (in, lbf, lbf s^2/in).
    parameters
        Whether to define a stiffness parameter for each property or section.

    Returns
    -------
    The frame in SI units, and what was assumed.

    Raises
    ------
    ValueError
        If something in the file may matter and is not understood; the message lists it.
    FileNotFoundError
        If there is no such file.
    """
    mesh = existing_file(path)
    found = convert_mesh(mesh, unit=unit, parameters=parameters)
    return ConvertedMesh(name=mesh.stem, file=found.file, notes=found.notes)
