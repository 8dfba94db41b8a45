"""What is searched for, and how long."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.estimation.input_hold import Hold
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import PROPOSERS, Proposer
from slowtime.discrepancy.refinement.after_effect import REFINERS, Refiner
from slowtime.dynamics.effects import Kind

MAX_EFFECTS = 3
"""[effects] That are looked for, one after the other. Source: a decision of scope; records that
lack more than three effects are a model to be rebuilt."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SearchSettings:
    """What is looked for, and who is told.

    Parameters
    ----------
    quick
        One effect is looked for, among few candidates.
    stated
        What the model says of its inputs between samples; as it stands where not given.
    asked
        Holds under which effects were looked for already.
    proposers
        Asked in order for candidates of the first effect.
    refiners
        Steps taken in order after each effect.
    """

    kinds: Mapping[str, Kind]
    monitor: Monitor
    quick: bool = False
    stated: tuple[Hold, ...] | None = None
    asked: tuple[tuple[Hold, ...] | None, ...] = ()
    proposers: tuple[Proposer, ...] = PROPOSERS
    refiners: tuple[Refiner, ...] = REFINERS

    @property
    def most(self) -> int:
        """Number of effects that are looked for."""
        return 1 if self.quick else MAX_EFFECTS
