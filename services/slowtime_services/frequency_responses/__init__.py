"""Files of measured frequency responses → matrices of them, with names, units and errors."""

from .measured import Curve, MeasuredResponses
from .reading import read_responses

__all__ = ["Curve", "MeasuredResponses", "read_responses"]
