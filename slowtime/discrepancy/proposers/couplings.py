"""Proposer: gyroscopic couplings of two coordinates, where no force along one explains all.

A coupling is of rank two, so that no place of a single force shows it. Each pair of coordinates
is tested by how the free run changes with a small coupling, beside what constants and initial
states can change.
"""

import dataclasses
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

MOST_FITTED = 2
"""[couplings] That are fitted. Source: a bound on computing time; the score test ranks them."""
LEAST_SHARE = 0.1
"""[share of chi squared] That a small coupling promises to explain, from which it is fitted.
Source: a strong coupling parts two modes, of which a small one shows the beginning alone."""


@dataclasses.dataclass(frozen=True, slots=True)
class Couplings:
    """Proposes couplings of coordinates that nothing joins."""

    name: str = "couplings"

    def __call__(self, given: Round) -> Proposal:
        """Propose those that explain most, where several forces are missing."""
        several = given.localized.groups[0].left >= LIMITS.several_forces_chi2
        if given.number or not several:
            return Proposal(self.name, ())
        found = []
        for kind, place in _sites(given):
            if given.is_late("testing couplings", 0.06):
                break
            found.append(_tested(given, kind, place))
        found.sort(key=lambda one: -one.score)
        least = (1 - LEAST_SHARE) * given.before.cost
        kept = [one for one in found if one.cost < least]
        return Proposal(self.name, tuple(kept[:MOST_FITTED]))


def _sites(given: Round) -> Iterator[tuple[Kind, Place]]:
    """List couplings, and open joints between two coordinates that are free."""
    description = given.before.plant.description
    for kind in given.kinds.values():
        if not kind.is_coupling:
            continue
        for element in description.elements:
            if isinstance(element, OpenJoint) and set(element.between) <= set(description.dofs):
                yield kind, Place("element", element.id)


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
