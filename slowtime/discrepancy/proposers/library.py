"""Proposer: the shortlist of the library's laws along the recovered force and motion."""

import dataclasses

from .protocol import Proposal, Round


@dataclasses.dataclass(frozen=True, slots=True)
class LibraryShortlist:
    """Proposes the laws that explain most of the recovered force, unless others stand in."""

    name: str = "library"

    def __call__(self, given: Round) -> Proposal:
        """Propose the shortlist; nothing where an earlier proposal takes its place."""
        return Proposal(self.name, () if given.has_substitute else given.shortlist)
