"""Samples in, natural frequencies and damping ratios with their standard deviations out."""

from .ambient.estimation import identify_ambient
from .estimates import Identified, Measured
from .free_decay.estimation import identify_free_decay
from .single_mode.bounds import ambient_bound, ambient_law, free_decay_bound
from .single_mode.estimation import all_modes, first_mode
from .single_mode.sliding_windows import Epoch, Tracker, TrackerState, identify_windows
from .single_mode.spectral_peak import peak

__all__ = [
    "Epoch",
    "Identified",
    "Measured",
    "Tracker",
    "TrackerState",
    "all_modes",
    "ambient_bound",
    "ambient_law",
    "first_mode",
    "free_decay_bound",
    "identify_ambient",
    "identify_free_decay",
    "identify_windows",
    "peak",
]
