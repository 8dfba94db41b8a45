"""Reduced models in files: written once, then updated without the full matrices."""

import dataclasses
import json
import zipfile
from pathlib import Path

import numpy as np
from scipy import sparse

from slowtime.finite_elements.degrees_of_freedom import DofMap
from slowtime.finite_elements.reduction import AdaptiveModel, ReductionError
from slowtime.finite_elements.reduction.adaptive_model import FactoredParts
from slowtime_services.documents.json_documents import read_json
from slowtime_services.files.binary.expansion import refuse_expansion
from slowtime_services.reasons import reason_of

from .bounds import refuse_empty_rows
from .errors import MatrixFileError

FORMAT = "slowtime reduced model 1"
_ARRAYS = ("candidates", "stiffness", "mass", "fixed", "responses", "mass_responses")
_PARTS = ("stiffness_parts", "mass_parts")


def write_reduced(path: Path, model: AdaptiveModel) -> None:
    """Write a reduced model as a NumPy archive.

    Parameters
    ----------
    path
        File that ends in .npz.
    """
    if path.suffix.lower() != ".npz":
        raise MatrixFileError(f"{path.name} does not end in .npz. Give a name that does.")
    heading = {
        "format": FORMAT,
        "names": model.names,
        "error": None if model.error is None else dataclasses.asdict(model.error),
        "nodes": None if model.dofs is None else model.dofs.node_names,
        "counts": {name: getattr(model, name).count for name in _PARTS},
    }
    arrays = {name: getattr(model, name) for name in _ARRAYS}
    for name in _PARTS:
        part = getattr(model, name)
        for key in ("columns", "sign", "owner"):
            arrays[f"{name}.{key}"] = getattr(part, key)
    if model.dofs is not None:
        for key in ("coordinates", "node", "direction"):
            arrays[f"dofs.{key}"] = getattr(model.dofs, key)
    if model.expansion is not None:
        for key in ("data", "indices", "indptr", "shape"):
            arrays[f"expansion.{key}"] = np.asarray(getattr(model.expansion, key))
    np.savez_compressed(path, heading=np.array(json.dumps(heading)), **arrays)


def read_reduced(path: Path) -> AdaptiveModel:
    """Read a reduced model.

    Parameters
    ----------
    path
        File that `write_reduced` wrote.

    Returns
    -------
    The model.

    Raises
    ------
    MatrixFileError
        Where it is another file.
    """
    try:
        with zipfile.ZipFile(path) as archive_directory:
            refuse_expansion(path, sum(m.file_size for m in archive_directory.infolist()))
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        heading = read_json(str(arrays.pop("heading")))
        if heading["format"] != FORMAT:
            raise MatrixFileError(f"{path.name} is of format {heading['format']!r}.")
        parts = {
            name: FactoredParts(
                arrays[f"{name}.columns"],
                arrays[f"{name}.sign"],
                arrays[f"{name}.owner"],
                heading["counts"][name],
            )
            for name in _PARTS
        }
        return AdaptiveModel(
            names=tuple(heading["names"]),
            **{name: arrays[name] for name in _ARRAYS},
            stiffness_parts=parts["stiffness_parts"],
            mass_parts=parts["mass_parts"],
            dofs=_dofs(arrays, heading["nodes"]),
            expansion=_expansion(arrays),
            error=None if heading["error"] is None else ReductionError(**heading["error"]),
        )
    except (OSError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise MatrixFileError(
            f"{path.name} is not a valid reduced model: {reason_of(error)} Give a file that "
            "`slowtime model reduce --out` wrote."
        ) from error


def _dofs(arrays: dict[str, np.ndarray], nodes: list[str] | None) -> DofMap | None:
    if nodes is None:
        return None
    keys = ("coordinates", "node", "direction")
    return DofMap(node_names=tuple(nodes), **{key: arrays[f"dofs.{key}"] for key in keys})


def _expansion(arrays: dict[str, np.ndarray]) -> sparse.csr_array | None:
    if "expansion.data" not in arrays:
        return None
    data, indices, starts = (
        arrays[f"expansion.{key}"] for key in ("data", "indices", "indptr")
    )
    shape = tuple(arrays["expansion.shape"].tolist())
    refuse_empty_rows("The expansion", shape, len(data))
    return sparse.csr_array((data, indices, starts), shape=shape)
