"""Candidates for the missing effect; each module proposes them from one kind of evidence.

`PROPOSERS` are asked in order, the cheapest first. Each decides itself, by what was fitted
before it in the round, whether it has anything to add; the budget or a pair of effects may end
the round.
"""

from .couplings import Couplings
from .delayed_input import SensorClocks
from .free_run_scan import FreeRunScan
from .general_laws import GeneralLaws
from .library import LibraryShortlist
from .lower_ranked import InitialSegments, NearbyRuns, NextInRank
from .protocol import Proposal, Proposer, Round
from .segments import Segments

PROPOSERS: tuple[Proposer, ...] = (
    SensorClocks(),
    Couplings(),
    Segments(only=True),
    LibraryShortlist(),
    Segments(),
    NearbyRuns(),
    InitialSegments(),
    NextInRank(),
    GeneralLaws(),
    FreeRunScan(),
)
QUICK_PROPOSERS: tuple[Proposer, ...] = (LibraryShortlist(),)
"""Asked in a quick search."""
LATER_PROPOSERS: tuple[Proposer, ...] = (LibraryShortlist(), GeneralLaws(), FreeRunScan())
"""Asked for each later effect."""

__all__ = [
    "LATER_PROPOSERS",
    "PROPOSERS",
    "QUICK_PROPOSERS",
    "Proposal",
    "Proposer",
    "Round",
]
