"""Features of many modes in; changes of the elements and masses of a model out, with suspects.

The first epochs teach what the structure is like: the model is fitted to it, and only what
differs from it later is called a change, so that an error of the model is none.
"""

from .channel_units import told_shape, units_of
from .epochs import Found, Reading, follow, posterior_of
from .suspects import Suspect, size

__all__ = [
    "Found",
    "Reading",
    "Suspect",
    "follow",
    "posterior_of",
    "size",
    "told_shape",
    "units_of",
]
