"""Samples in, natural frequencies and damping ratios with their standard deviations out.

A name is imported when it is first used, for options are read where nothing is computed.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .ambient.estimation import identify_ambient
    from .estimates import Identified, Measured
    from .free_decay.estimation import identify_free_decay
    from .single_mode.bounds import ambient_bound, ambient_law, free_decay_bound
    from .single_mode.estimation import all_modes, first_mode
    from .single_mode.sliding_windows import Epoch, Tracker, TrackerState, identify_windows
    from .single_mode.spectral_peak import peak

_MODULE_OF = {
    "identify_ambient": "ambient.estimation",
    "Identified": "estimates",
    "Measured": "estimates",
    "identify_free_decay": "free_decay.estimation",
    "ambient_bound": "single_mode.bounds",
    "ambient_law": "single_mode.bounds",
    "free_decay_bound": "single_mode.bounds",
    "all_modes": "single_mode.estimation",
    "first_mode": "single_mode.estimation",
    "Epoch": "single_mode.sliding_windows",
    "Tracker": "single_mode.sliding_windows",
    "TrackerState": "single_mode.sliding_windows",
    "identify_windows": "single_mode.sliding_windows",
    "peak": "single_mode.spectral_peak",
}

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


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (SPEC 1, lazy loading)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = found
    return found
