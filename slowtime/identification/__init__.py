"""Samples in, natural frequencies and damping ratios with their standard deviations out."""

from .ambient import identify_ambient as identify_ambient
from .bounds import ambient_bound as ambient_bound
from .bounds import ambient_law as ambient_law
from .bounds import free_decay_bound as free_decay_bound
from .first import all_modes as all_modes
from .first import first_mode as first_mode
from .free_decay import identify_free_decay as identify_free_decay
from .identified import Identified as Identified
from .identified import Measured as Measured
from .peak import peak as peak
from .windows import Epoch as Epoch
from .windows import Tracker as Tracker
from .windows import TrackerState as TrackerState
from .windows import identify_windows as identify_windows
