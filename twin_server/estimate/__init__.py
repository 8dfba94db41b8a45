"""Second stage of the twin: features in order in; states with intervals and notices out."""

from .checkpoint import Checkpoint, Twin
from .covariates.words import normal_of
from .estimator import Estimated, estimate
from .foresight import Foresight, foresee, past_of, past_of_elements
from .notices import Notice

__all__ = [
    "Checkpoint",
    "Estimated",
    "Foresight",
    "Notice",
    "Twin",
    "estimate",
    "foresee",
    "normal_of",
    "past_of",
    "past_of_elements",
]
