"""Files of measured frequency responses → matrices of them, with names, units and errors."""

from .measured import FrfCurve, MeasuredResponses
from .reading import read_responses

__all__ = ["FrfCurve", "MeasuredResponses", "read_responses"]
