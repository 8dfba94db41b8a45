"""Simulation of a structure with its effects: sensors' outputs and their derivatives.

The linear part is exact; forces of effects by collocation of fifth order within steps that are
halved where a force has a kink; dry friction sticks, at instants that are located.
"""

from .parameter_names import Name, names_of
from .plant import Plant

__all__ = ["Name", "Plant", "names_of"]
