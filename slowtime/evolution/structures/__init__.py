"""Frequencies and shapes of many modes in; what stiffness and mass changed, how much, out.

What the data cannot tell is said in words, with what would tell it.
"""

from .experiments import Remedy as Remedy
from .experiments import what_would_tell as what_would_tell
from .fit import Optimum as Optimum
from .fit import Posterior as Posterior
from .fit import estimate as estimate
from .limits import Limit as Limit
from .limits import what_cannot_be_told as what_cannot_be_told
from .measured import MeasuredModes as MeasuredModes
from .naming import Hypothesis as Hypothesis
from .naming import Named as Named
from .naming import name_changes as name_changes
from .parametric import ParametricStructure as ParametricStructure
