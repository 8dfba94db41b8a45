"""Candidates for the missing effect; each module proposes them from one kind of evidence.

`PROPOSERS` are asked in order, the cheapest first, until one explains what is missing.
"""

from .delayed_input import SensorClocks
from .general_laws import GeneralLaws
from .library import LibraryShortlist
from .lower_ranked import InitialSegments, NearbyRuns, NextInRank
from .protocol import Proposal, Proposer, Round
from .segments import Segments

PROPOSERS: tuple[Proposer, ...] = (
    SensorClocks(),
    Segments(only=True),
    LibraryShortlist(),
    Segments(),
    NearbyRuns(),
    InitialSegments(),
    NextInRank(),
    GeneralLaws(),
)

__all__ = ["PROPOSERS", "Proposal", "Proposer", "Round"]
