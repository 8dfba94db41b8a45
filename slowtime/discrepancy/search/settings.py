"""What is searched for, and how long."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.estimation.input_hold import Hold
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import LATER_PROPOSERS, PROPOSERS, QUICK_PROPOSERS, Proposer
from slowtime.discrepancy.refinement.after_effect import REFINERS, Refiner
from slowtime.discrepancy.refinement.force_surface import AUTO, SurfaceDemand
from slowtime.dynamics.effects import Kind

MAX_EFFECTS = 3
"""[effects] That are looked for, one after the other. Source: a decision of scope; records that
lack more than three effects are a model to be rebuilt."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SearchOptions:
    """How thoroughly effects are searched for, and by which steps.

    Parameters
    ----------
    quick
        One effect is searched for, among few candidates; `proposers` are not asked.
    proposers
        Asked in order for candidates of the first effect; one of your own is put among them.
        None is asked about ambient records and imposed motion, which have other candidates.
    surface
        Shape of the force surface that is fitted where no law explains the records.
    """

    quick: bool = False
    proposers: tuple[Proposer, ...] = PROPOSERS
    later_proposers: tuple[Proposer, ...] = LATER_PROPOSERS
    refiners: tuple[Refiner, ...] = REFINERS
    surface: SurfaceDemand = AUTO

    @property
    def most(self) -> int:
        """Number of effects that are searched for."""
        return 1 if self.quick else MAX_EFFECTS


DEFAULT_OPTIONS = SearchOptions()


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SearchSettings:
    """What is searched for, by which steps, and who is told.

    Parameters
    ----------
    stated
        What the model says of its inputs between samples; as it stands where not given.
    asked
        Holds of the inputs under which the search was made before.
    decays
        Whether the records are free decays, in which displacement sensors have offsets.
    """

    kinds: Mapping[str, Kind]
    monitor: Monitor
    options: SearchOptions = DEFAULT_OPTIONS
    stated: tuple[Hold, ...] | None = None
    asked: tuple[tuple[Hold, ...] | None, ...] = ()
    decays: bool = False

    def asks_all(self, number: int) -> bool:
        """Whether all proposers are asked: for the first effect, unless the search is quick."""
        return number == 0 and not self.options.quick

    def proposers_of(self, number: int) -> tuple[Proposer, ...]:
        """Give those that are asked for an effect after so many."""
        if self.asks_all(number):
            return self.options.proposers
        return QUICK_PROPOSERS if self.options.quick else self.options.later_proposers
