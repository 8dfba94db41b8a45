"""A reliability tree of members and their failure probabilities in; that of the whole out.

A tree is made of gates in series, in parallel and k out of n over members, any of which may
stand in several branches. Members fail independently, or in groups with a stated dependence.
"""

from .bands import ProbabilityBounds, band
from .bounds import any_dependence
from .dependence import CommonCause, Equicorrelated, Group, Independent
from .diagram import TooLargeTreeError
from .probability import Importance, TreeResult, analyse, probability
from .simulation import simulate
from .structure import Gate, Node, fails, k_of_n, members, parallel, series

__all__ = [
    "CommonCause",
    "Equicorrelated",
    "Gate",
    "Group",
    "Importance",
    "Independent",
    "Node",
    "ProbabilityBounds",
    "TooLargeTreeError",
    "TreeResult",
    "analyse",
    "any_dependence",
    "band",
    "fails",
    "k_of_n",
    "members",
    "parallel",
    "probability",
    "series",
    "simulate",
]
