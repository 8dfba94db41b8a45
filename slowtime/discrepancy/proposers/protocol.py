"""What a proposer is asked with, and what it answers."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.library_fit import Candidate, Label
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Kind


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """Candidates to be fitted to the free run, and where they come from.

    Parameters
    ----------
    candidates
        The likeliest first; none where this evidence says nothing. One whose `cost` is far
        above that of those fitted before is passed over: state it on their scale.
    only
        Whether they stand in place of the shortlist of the library.
    begins
        The law that explains how records begin, or their segments, where one does.
    shot
        Those that are worth being fitted to segments of the records, should whole records fail.
    """

    source: str
    candidates: tuple[Candidate, ...]
    only: bool = False
    begins: Label | None = None
    shot: tuple[Candidate, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Round:
    """What is known while one more effect is looked for.

    Parameters
    ----------
    hypothesis
        What was found so far.
    before
        Its last fit, to which candidates are added: its constants are held to their tolerances,
        but where a first search found nothing with them held.
    localized
        Where a force explains what `before` leaves, and the force and motion there.
    tried
        Each kind that contains no simpler one, at each place where a force explains anything,
        along that motion, the best first. Of kinds that contain others see `kinds`.
    shortlist
        Those of them that are fitted where no proposal with `only` stands in their place.
    trials
        Records, cut where a fast clock runs past their end.
    share
        Of the whole diagnosis that is done, to show progress.
    fitted
        Candidates fitted in this round so far, in the order in which they were.
    """

    hypothesis: Hypothesis
    before: Fit
    localized: Localization
    tried: tuple[Candidate, ...]
    shortlist: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    kinds: Mapping[str, Kind]
    monitor: Monitor
    number: int
    base_moves: bool = False
    share: float = 0.0
    fitted: tuple[FittedCandidate, ...] = ()
    proposals: tuple[Proposal, ...] = ()

    def of(self, source: str) -> Proposal | None:
        """Give the last proposal of a proposer, one with candidates before one without."""
        own = [one for one in reversed(self.proposals) if one.source == source]
        return next((one for one in own if one.candidates), own[0] if own else None)

    @property
    def has_substitute(self) -> bool:
        """Whether candidates stand in place of the shortlist of the library."""
        return any(one.only and one.candidates for one in self.proposals)

    @property
    def first_batch(self) -> tuple[Candidate, ...]:
        """Candidates that were fitted first: the shortlist, or what took its place."""
        every = (one.candidates for one in self.proposals if one.candidates)
        return next(every, self.shortlist)

    def best(self) -> Fit | None:
        """Give the fit that leaves least in band, of those of this round."""
        fits = (one.fit for one in self.fitted)
        return min(fits, key=lambda fit: fit.chi2_in_band, default=None)

    def is_late(self, stage: str, further: float) -> bool:
        """Say what is being done; return whether the budget allows the likeliest only."""
        self.monitor(stage, self.share + further)
        return self.monitor.is_late


@runtime_checkable
class Proposer(Protocol):
    """Proposes candidates for the missing effect from one kind of evidence.

    One that raises `numpy.linalg.LinAlgError` or `FloatingPointError` is named in a note of the
    diagnosis, and the others are asked all the same.

    Parameters
    ----------
    name
        Under which its proposal is found in the round.
    """

    @property
    def name(self) -> str:
        """Name under which its proposals are found; two that are one idea share it."""
        ...

    def __call__(self, given: Round) -> Proposal:
        """Propose candidates; asked once a round, with what was fitted before it."""
        ...


def reached_by_shortlist(candidates: Sequence[Candidate]) -> float:
    """Least chi squared that candidates leave along the force [1]; infinite without any."""
    return min((one.cost for one in candidates), default=float("inf"))
