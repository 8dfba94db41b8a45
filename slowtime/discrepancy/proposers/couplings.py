"""Proposer: gyroscopic couplings of two coordinates, where no force along one explains all.

A coupling is of rank two, so that no place of a single force shows it. Two pairs are fitted:
that between which a force comes nearest, as of strong couplings, and that of which a small
coupling explains most beside constants and initial states, as of weak ones.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import OpenJoint
from slowtime.dynamics.effects import Effect, Kind, Place
from slowtime.dynamics.plant import Plant

from .protocol import Proposal, Round

MOST_TESTED = 8
"""[pairs] That are tested, those first between which a force comes nearest. Source: a bound on
computing time."""


@dataclasses.dataclass(frozen=True, slots=True)
class Couplings:
    """Proposes couplings of coordinates that nothing joins."""

    name: str = "couplings"

    def __call__(self, given: Round) -> Proposal:
        """Propose those that explain most, where several forces are missing."""
        several = given.localized.groups[0].left >= LIMITS.several_forces_chi2
        if given.number or not several:
            return Proposal(self.name, ())
        sites = list(itertools.islice(_sites(given), MOST_TESTED))
        if not sites or given.is_late("testing couplings", 0.06):
            return Proposal(self.name, ())
        nearest, *others = (_tested(given, *site) for site in sites)
        best = max((nearest, *others), key=lambda one: one.score)
        return Proposal(self.name, tuple(dict.fromkeys((best, nearest))))


def _sites(given: Round) -> Iterator[tuple[Kind, Place]]:
    """List couplings, and open joints between two free coordinates, the likeliest first."""
    description = given.before.plant.description
    free = {
        Place("element", one.id)
        for one in description.elements
        if isinstance(one, OpenJoint) and set(one.between) <= set(description.dofs)
    }
    couplings = [kind for kind in given.kinds.values() if kind.is_coupling]
    for group in given.localized.groups:
        yield from ((kind, one) for one in group.places if one in free for kind in couplings)


def _tested(given: Round, kind: Kind, place: Place) -> Candidate:
    """Give the coupling of one pair that fits best by its first derivative at none."""
    before = given.before
    (strength,) = kind.names
    described = with_effect(before.plant.description, Effect(kind.name, place, {strength: 0.0}))
    plant = Plant.of(described, kinds=given.kinds)
    known = dict(zip(before.plant.parameters, before.values.tolist(), strict=True))
    values = np.array([known.get(name, 0.0) for name in plant.parameters])
    free = [*before.prior.names, plant.parameters[-1]]
    normal = np.diag([*(1 / before.prior.sd**2), 0.0])
    pull = np.array([*((before.prior.mean - before.free) / before.prior.sd**2), 0.0])
    runs = zip(given.trials, before.states, before.residual, strict=True)
    for number, (trial, state, residual) in enumerate(runs):
        _, slopes = plant.sensitivities(
            values, trial.inputs, trial.rate_hz, free, state0=state, start_s=trial.start_s
        )
        weight = trial.used / before.noise.sd(number, trial.rate_hz)
        own, against = _reduced(slopes, residual, weight, len(free))
        normal, pull = normal + own, pull + against
    last = len(free) - 1
    step = np.linalg.lstsq(normal, pull, rcond=None)[0]
    rest = np.linalg.lstsq(normal[:last, :last], pull[:last], rcond=None)[0]
    gain = float(pull @ step - pull[:last] @ rest)
    cost = max(before.cost - gain, 0.0)
    score = -cost / 2 - math.log(before.data) / 2
    effect = Effect(kind.name, place, {strength: float(step[last])})
    return Candidate(effect, cost, score, before.cost)


def _reduced(
    slopes: Float[np.ndarray, "time sensor slope"],
    residual: Float[np.ndarray, "time sensor"],
    weight: Float[np.ndarray, "time sensor"],
    free: int,
) -> tuple[Float[np.ndarray, "free free"], Float[np.ndarray, " free"]]:
    """Project the initial state of a record out of its normal equations."""
    white = (slopes * weight[:, :, None]).reshape(-1, slopes.shape[2])
    left = (residual * weight).ravel()
    state, _ = np.linalg.qr(white[:, free:])
    own = white[:, :free] - state @ (state.T @ white[:, :free])
    return own.T @ own, own.T @ left
