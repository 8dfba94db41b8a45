"""Steps and guards of the search that can be left out, and whether they act."""

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from slowtime.discrepancy.proposers import LATER_PROPOSERS, PROPOSERS, Proposal, Proposer, Round
from slowtime.discrepancy.refinement.after_effect import REFINERS, Refiner
from slowtime.discrepancy.search import SearchOptions

PACKAGE = "slowtime.discrepancy"


@dataclass(frozen=True)
class Guard:
    """A function of the search that a caller can do without.

    Parameters
    ----------
    module, name
        Where it is called, and as what.
    instead
        What stands in its place: the number of the argument that is given back, or a value.
    """

    module: str
    name: str
    instead: Any

    @property
    def label(self) -> str:
        """Name in the table."""
        return f"{self.module}: {self.name.strip('_').replace('_', ' ')}"

    def neutral(self, arguments: tuple[Any, ...]) -> Any:
        """Give what a caller gets that does without it."""
        is_argument = isinstance(self.instead, int) and not isinstance(self.instead, bool)
        return arguments[self.instead] if is_argument else self.instead


GUARDS = (
    Guard("diagnose", "drop_harmful_effects", 0),
    Guard("diagnose", "eliminate_needless", 0),
    Guard("diagnose", "name_limits", 0),
    Guard("diagnose", "refute", 0),
    Guard("diagnose", "converge", 0),
    Guard("diagnose", "converge_stick_slip", 0),
    Guard("diagnose", "hold_natural_values", 0),
    Guard("search.input_holds", "found_holds", None),
    Guard("search.input_holds", "held_otherwise", None),
    Guard("search.input_holds", "held_better", None),
    Guard("search.input_holds", "refit_from_other_stiffnesses", 0),
    Guard("search.loop", "explain_together", None),
    Guard("search.loop", "_suggest_holds", 0),
    Guard("search.loop", "_begin_otherwise", 0),
    Guard("search.loop", "substitute", 0),
    Guard("search.loop", "generalize", 0),
    Guard("search.next_effect", "relearn_force", 0),
    Guard("search.next_effect", "converge", 0),
    Guard("search.next_effect", "is_lost", False),
    Guard("search.next_effect", "biased_accelerometer", None),
    Guard("search.next_effect", "base_motion", None),
    Guard("search.next_effect", "pairs_with_delayed_input", ()),
    Guard("search.next_effect", "begun_with", False),
    Guard("search.next_effect", "release_constants", None),
    Guard("search.next_effect", "sensor_drift", None),
    Guard("search.next_effect", "those_of_beginnings", 1),
    Guard("search.lost_records", "shooting_fits", 2),
    Guard("selection.acceptance", "held_instead", None),
    Guard("selection.acceptance", "held_as_well", None),
    Guard("selection.acceptance", "in_pieces", []),
    Guard("proposers.joint_pairs", "law_pairs", ()),
    Guard("selection.shortlist", "instead_of_constants", []),
    Guard("selection.shortlist", "mirrored_factor", []),
)
"""What the search does besides asking proposers, fitting and comparing evidence."""


@dataclass(frozen=True)
class _Watched:
    """A proposer whose proposals are noted."""

    inner: Proposer
    acts: set[str]

    @property
    def name(self) -> str:
        return self.inner.name

    def __call__(self, given: Round) -> Proposal:
        proposal = self.inner(given)
        if proposal.candidates:
            self.acts.add(label_of(self.inner))
        return proposal


def label_of(step: Proposer | Refiner) -> str:
    """Give the name of a step in the table, unique among all."""
    kind = "refiner" if isinstance(step, Refiner) else "proposer"
    before = ", before the library" if getattr(step, "only", False) else ""
    return f"{kind}: {step.name}{before}"


def every_step() -> list[str]:
    """List what can be left out."""
    steps = [*map(label_of, PROPOSERS), *map(label_of, REFINERS)]
    return [*steps, *(guard.label for guard in GUARDS)]


@contextmanager
def without(left_out: str | None, acts: set[str]) -> Iterator[SearchOptions]:
    """Let diagnoses do without one step; note which of the others act.

    Yields
    ------
    Options of the search, with the proposers and refiners that are left.
    """
    patched: list[tuple[Any, str, Any]] = []

    def put(module: Any, name: str, value: Any) -> None:
        patched.append((module, name, getattr(module, name)))
        setattr(module, name, value)

    try:
        for guard in GUARDS:
            module = importlib.import_module(f"{PACKAGE}.{guard.module}")
            given = getattr(module, guard.name)
            put(module, guard.name, _guarded(guard, given, left_out, acts))
        settings = importlib.import_module(f"{PACKAGE}.search.settings")
        put(settings, "LATER_PROPOSERS", _proposers(LATER_PROPOSERS, left_out, acts))
        yield SearchOptions(
            proposers=_proposers(PROPOSERS, left_out, acts),
            refiners=tuple(
                _refiner(one, acts) for one in REFINERS if label_of(one) != left_out
            ),
        )
    finally:
        for module, name, value in reversed(patched):
            setattr(module, name, value)


def _proposers(
    every: tuple[Proposer, ...], left_out: str | None, acts: set[str]
) -> tuple[Proposer, ...]:
    return tuple(_Watched(one, acts) for one in every if label_of(one) != left_out)


def _refiner(refiner: Refiner, acts: set[str]) -> Refiner:
    def refine(hypothesis: Any, kinds: Mapping[str, Any], monitor: Any) -> Any:
        better = refiner.refine(hypothesis, kinds, monitor)
        if better is not hypothesis:
            acts.add(label_of(refiner))
        return better

    return replace(refiner, refine=refine)


def _guarded(
    guard: Guard, function: Callable[..., Any], left_out: str | None, acts: set[str]
) -> Callable[..., Any]:
    def call(*arguments: Any, **named: Any) -> Any:
        if guard.label == left_out:
            return guard.neutral(arguments)
        found = function(*arguments, **named)
        if isinstance(found, Iterator):
            found = tuple(found)
        neutral = guard.neutral(arguments)
        idle = found is neutral or (
            isinstance(neutral, list | tuple | bool) and found == neutral
        )
        if not idle:
            acts.add(guard.label)
        return found

    return call
