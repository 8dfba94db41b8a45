"""Refiners: steps that better a hypothesis after each effect that was added."""

import dataclasses
from collections.abc import Callable, Mapping

from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.dynamics.effects import Kind

from .horizon_continuation import (
    refit_friction_with_growing_horizon,
    refit_with_growing_horizon,
)
from .initial_states import restart_initial_states
from .relocation import relocate

Refine = Callable[[Hypothesis, Mapping[str, Kind], Monitor], Hypothesis]


@dataclasses.dataclass(frozen=True, slots=True)
class Refiner:
    """One step that gives a hypothesis which leaves less, or the hypothesis itself."""

    name: str
    refine: Refine
    while_late: bool = False

    def __call__(
        self, hypothesis: Hypothesis, kinds: Mapping[str, Kind], monitor: Monitor
    ) -> Hypothesis:
        """Take the step, if the budget allows."""
        if monitor.is_late and not self.while_late:
            return hypothesis
        return self.refine(hypothesis, kinds, monitor)


def _restart(hypothesis: Hypothesis, kinds: Mapping[str, Kind], monitor: Monitor) -> Hypothesis:
    return restart_initial_states(hypothesis, kinds)


def _continue_horizon(
    hypothesis: Hypothesis, kinds: Mapping[str, Kind], monitor: Monitor
) -> Hypothesis:
    if len(hypothesis.effects) > 1:
        return refit_with_growing_horizon(hypothesis, kinds)
    return refit_friction_with_growing_horizon(hypothesis, kinds)


REFINERS: tuple[Refiner, ...] = (
    Refiner("initial states", _restart, while_late=True),
    Refiner("growing horizon", _continue_horizon),
    Refiner("relocation", relocate, while_late=True),
)
