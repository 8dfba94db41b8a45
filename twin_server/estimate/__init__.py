"""Second stage of the twin: features in order in; states with intervals and notices out."""

from .checkpoint import Checkpoint
from .estimator import Estimated, Twin, estimate
from .foresight import Foresight, foresee
from .watching import Notice

__all__ = ["Checkpoint", "Estimated", "Foresight", "Notice", "Twin", "estimate", "foresee"]
