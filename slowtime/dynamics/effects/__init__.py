"""What linear elements lack, by name: laws of force, hidden masses, faulty sensors and inputs.

In come a kind of effect, its place and parameters; out come its force along a known motion, and
the compiled laws that `slowtime.dynamics.plant` integrates. A kind of one's own is one `Kind`.
"""

from .effect import Effect, Place, is_of_beam, read_effects
from .effect_catalogue import catalogue, general_kinds, simple_kinds
from .force_evaluation import force_along
from .kind import (
    Friction,
    Hidden,
    InputChange,
    Kind,
    Law,
    Motion,
    Parameter,
    SensorChange,
    Unmeasured,
    always,
)

__all__ = [
    "Effect",
    "Friction",
    "Hidden",
    "InputChange",
    "Kind",
    "Law",
    "Motion",
    "Parameter",
    "Place",
    "SensorChange",
    "Unmeasured",
    "always",
    "catalogue",
    "force_along",
    "general_kinds",
    "is_of_beam",
    "read_effects",
    "simple_kinds",
]
