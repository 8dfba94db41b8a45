"""Model files in, descriptions out, and back again; and models set in motion."""

from slowtime_services.descriptions import description_of

from .model_reader import (
    ModelFileError,
    read_description,
    read_finite_elements,
    read_model,
)
from .model_writer import model_file_of, model_text, write_model
from .simulation import ambient_model, run_model

__all__ = [
    "ModelFileError",
    "ambient_model",
    "description_of",
    "model_file_of",
    "model_text",
    "read_description",
    "read_finite_elements",
    "read_model",
    "run_model",
    "write_model",
]
