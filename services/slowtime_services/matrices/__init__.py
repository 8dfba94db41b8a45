"""Matrix files, and a model file that names them, in; sparse models with parameters out."""

from .any_model import read_any_description
from .dof_tables import read_dof_map
from .errors import MatrixFileError
from .matrix_model import (
    MatrixModel,
    matrix_model_of,
    read_matrix_model,
)
from .nastran_output4_writing import write_output4
from .reduced_description import ReducedDescription, describe_reduced
from .reduced_files import read_reduced, write_reduced
from .sparse_files import read_matrix, write_matrix

__all__ = [
    "MatrixFileError",
    "MatrixModel",
    "ReducedDescription",
    "describe_reduced",
    "matrix_model_of",
    "read_any_description",
    "read_dof_map",
    "read_matrix",
    "read_matrix_model",
    "read_reduced",
    "write_matrix",
    "write_output4",
    "write_reduced",
]
