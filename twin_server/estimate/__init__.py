"""Second stage of the twin: features in order in; states with intervals and notices out."""

from .checkpoint import Checkpoint, Twin
from .estimator import Estimated, estimate
from .foresight import Foresight, foresee
from .notices import Notice

__all__ = ["Checkpoint", "Estimated", "Foresight", "Notice", "Twin", "estimate", "foresee"]
