"""What a search knows at any time: fits, answers, and what is left."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.quoting import requote_all
from slowtime.dynamics.effects import Kind, Place

from .calibration import Fit
from .candidates.library_fit import Candidate
from .diagnosis import NamedEffect, Rival
from .estimation.candidate_fit import FittedCandidate
from .estimation.input_hold import Hold
from .localization import Localization
from .records import Trial

Pair = tuple[str, str]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A spring between two nodes that nothing joins in the model.

    Parameters
    ----------
    stiffness, sd
        In the unit of the model's springs.
    """

    between: Pair
    stiffness: float
    sd: float
    unit: str
    named: FittedCandidate

    def __str__(self) -> str:
        first, second = self.between
        return (
            f"a spring of {self.stiffness:.3g} ± {self.sd:.2g} {self.unit} "
            f"between {first} and {second}"
        )


@dataclasses.dataclass(slots=True, eq=False)
class Found:
    """What has been found so far, and the records by which.

    Parameters
    ----------
    fits
        Of the model as given, and after each effect.
    located, left
        What was missing at first, and after the last effect.
    named, tried
        Labels of the first effect: those refitted, and all, the best first.
    ended
        What is left follows no law: nothing more is to be found.
    unheard
        Whether answers before the last were told by the other sensors alone: that of the last
        wanders on no course.
    refuted
        Element at which no law that was named can be what is there.
    near
        Whether what is undecided may be a law near the one named, and not known.
    link
        A spring that the model has not got, and that explains more than what was named.
    both
        An account that begins with two laws at once, and explains all.
    alike
        Laws in the place of the first effect that do what a simpler one does.
    loosened
        Whether the model as given was stuck in a minimum that is not its lowest.
    otherwise
        Another hold of the inputs, under which all that was found so far would explain all.
    """

    fits: list[Fit]
    trials: tuple[Trial, ...]
    located: Localization | None = None
    answers: list[NamedEffect] = dataclasses.field(default_factory=list)
    undecided: tuple[Rival, ...] = ()
    pair: tuple[FittedCandidate, ...] | None = None
    left: Localization | None = None
    retuned: bool = False
    hurried: bool = False
    holds: tuple[Hold, ...] | None = None
    named: tuple[FittedCandidate, ...] = ()
    tried: tuple[Candidate, ...] = ()
    ended: bool = False
    unheard: bool = False
    refuted: Place | None = None
    near: bool = False
    link: Link | None = None
    both: "Found | None" = None
    loosened: bool = False
    alike: tuple[FittedCandidate, ...] = ()
    otherwise: tuple[Hold, ...] | None = None

    def put_last(self, fit: Fit, kinds: Mapping[str, Kind]) -> None:
        """Take another fit of the last model, and read all numbers off it."""
        self.fits[-1] = fit
        self.answers = requote_all(self.answers, fit, kinds)
