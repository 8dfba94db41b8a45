"""Features of many modes in; changes of the elements and masses of a model out, with suspects.

The first epochs teach what the structure is like: the model is fitted to it, and only what
differs from it later is called a change, so that an error of the model is none.
"""

from .channel_units import told_shape, units_of
from .epochs import EpochEstimate, TrackedEpochs, posterior_of, track_epochs
from .spatial_shapes import spatial_scene
from .suspects import SuspectGroup, size

__all__ = [
    "EpochEstimate",
    "SuspectGroup",
    "TrackedEpochs",
    "posterior_of",
    "size",
    "spatial_scene",
    "told_shape",
    "track_epochs",
    "units_of",
]
