"""Probabilities of several laws at one place, which may stand for a single unknown one.

Enough laws follow any motion, and two curves of one elongation any third. Such a model may
foretell as well as the right one; what it names is what was at hand.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Kind,
    Law,
    Motion,
    Place,
    Unmeasured,
    force_along,
)

MANY_LAWS = 3
"""[laws] From which they may fit any motion together. Source: docs/decisions/0020."""
PATCHWORK_PROBABILITY = 0.8
"""[probability] That the right laws are among such. Source: docs/decisions/0020."""

Variable = Literal["elongation", "speed"]
STRAIGHT: Mapping[str, Variable] = {
    "stiffness_loss": "elongation",
    "viscous_damping": "speed",
}
"""Kinds that change a constant of an element, and what their force is straight in."""
_GRID = np.array([-1.0, -0.3, 0.2, 1.0])


def temper_many_laws(
    answers: Sequence[NamedEffect], count: int, kinds: Mapping[str, Kind], *, alike: bool
) -> list[NamedEffect]:
    """Give the answers, less sure where they may be patchwork for a law that is unknown.

    `count` includes effects that are not told. `alike` says whether a force on the structure
    would do to the sensors what the foremost does.
    """
    pieced = {*pieces_of_one(answers, kinds), *_beside_constants(answers, kinds)}
    # What no law follows, at the base, may be what the laws that were named lack; or, where
    # sensors cannot tell the base from an element, what a law there does that is unknown.
    shaken = (alike or len(answers) > 1) and any(_shakes(a, kinds) for a in answers)
    many = count >= MANY_LAWS or shaken
    return [
        dataclasses.replace(answer, probability=PATCHWORK_PROBABILITY * answer.probability)
        if many or answer.effect.place in pieced
        else answer
        for answer in answers
    ]


def _shakes(answer: NamedEffect, kinds: Mapping[str, Kind]) -> bool:
    kind = kinds[answer.effect.kind]
    return isinstance(kind.action, Unmeasured) and kind.where == "base"


def _beside_constants(answers: Sequence[NamedEffect], kinds: Mapping[str, Kind]) -> set[Place]:
    """Elements at which one law is a curve over what a constant that is off is straight in."""
    # Both may be one curve between them: damping that grows with speed by a power below two.
    labels = {(answer.effect.kind, answer.effect.place) for answer in answers}
    return {
        answer.effect.place
        for answer in answers
        for constant, variable in STRAIGHT.items()
        if (constant, answer.effect.place) in labels
        and variable_of(answer.effect, kinds) == variable
    }


def pieces_of_one(
    answers: Sequence[NamedEffect], kinds: Mapping[str, Kind]
) -> dict[Place, Variable]:
    """Elements at which two laws are curves over one and the same variable."""
    found: dict[Place, Variable] = {}
    for one, other in itertools.combinations(answers, 2):
        variable = variable_of(one.effect, kinds)
        same = variable == variable_of(other.effect, kinds)
        if variable is not None and same and one.effect.place == other.effect.place:
            found[one.effect.place] = variable
    return found


def variable_of(effect: Effect, kinds: Mapping[str, Kind]) -> Variable | None:
    """Say of what a law is a curve; None where it remembers, takes both, or changes in time."""
    kind = kinds[effect.kind]
    action = kind.action
    timed = kind.quadrature is not None or (isinstance(action, Law) and bool(action.switches))
    if timed or not isinstance(action, Law | Friction):
        return None
    if isinstance(action, Law) and action.rates:
        return None
    lengths = [effect.parameters[p.name] for p in kind.parameters if p.unit == "m"]
    scale = 2 * max(map(abs, lengths), default=1.0)
    e, v, t = np.meshgrid(scale * _GRID, _GRID, 1 + _GRID, indexing="ij")
    motion = Motion(e=e.ravel(), v=v.ravel(), a=np.zeros(e.size), times=t.ravel())
    force = force_along(kind, effect.parameters, motion).reshape(e.shape)
    if np.all(force == force[:, :1, :1]):
        return "elongation"
    return "speed" if np.all(force == force[:1, :, :1]) else None
