"""Temperature, load and frequencies in; frequencies without them, with errors, and alarms out.

In training the twin learns what is normal; later it takes that out of each frequency before
stiffness and mass are estimated, and watches what is left.
"""

from .condition import Condition as Condition
from .condition import NotLearntError as NotLearntError
from .condition import Removed as Removed
from .condition import Verdict as Verdict
from .condition import conclude as conclude
from .condition import condition_of as condition_of
from .condition import covariates_of as covariates_of
from .stored import StoredNormal as StoredNormal
from .stored import StoredWatch as StoredWatch
from .training import Training as Training
from .training import training_of as training_of
