"""Frequency and damping over slow time in, changes of stiffness and mass with intervals out."""

from .change import Change
from .downsampling import extremes
from .reasons import Reason, explain
from .stiffness_mass.joint import JointChange, stiffness_and_mass
from .stiffness_mass.mass import mass_from_frequency
from .stiffness_mass.nominal import NominalOscillator, learn_nominal
from .stiffness_mass.stiffness import stiffness_from_frequency

__all__ = [
    "Change",
    "JointChange",
    "NominalOscillator",
    "Reason",
    "explain",
    "extremes",
    "learn_nominal",
    "mass_from_frequency",
    "stiffness_and_mass",
    "stiffness_from_frequency",
]
