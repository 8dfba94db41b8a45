"""Design variables, random inputs and limit states in; the best design, verified, out.

The objective weighs mean and standard deviation (eq. 4.18); each limit state has a probability
of failure that is accepted.
"""

from .additions import AddedStructure, Addition
from .emulation import optimise_emulated
from .objective import Moments, RobustObjective
from .optimisation import Effort, optimise
from .problem import Constraint, DesignProblem, Function, Variable
from .responses import HarmonicLoad, NoiseLoad, RecordedLoad, Response, Responses
from .result import Design, Evaluated, Verified

__all__ = [
    "AddedStructure",
    "Addition",
    "Constraint",
    "Design",
    "DesignProblem",
    "Effort",
    "Evaluated",
    "Function",
    "HarmonicLoad",
    "Moments",
    "NoiseLoad",
    "RecordedLoad",
    "Response",
    "Responses",
    "RobustObjective",
    "Variable",
    "Verified",
    "optimise",
    "optimise_emulated",
]
