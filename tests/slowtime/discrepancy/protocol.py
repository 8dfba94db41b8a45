"""What the search passes from stage to stage, as tests put it together."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import simulated_chi2, with_effect
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.proposers import Proposal, Round
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.dynamics.plant import Plant


def in_budget(*_):
    """Answer whoever asks that there is budget left."""
    return False


def candidate(effect, cost=0.0, *, cost_without=0.0, start=None):
    """Give a law with the chi squared that it leaves along the force."""
    return Candidate(effect, cost, -cost / 2, cost_without, start)


def named_effect(effect, kinds, probability=1.0, rivals=()):
    """Give an effect as a hypothesis has it, without its numbers."""
    family = kinds[effect.kind].family
    return NamedEffect(effect, family, {}, probability, rivals, "as named")


def fitted_candidate(effect, fit, **changed):
    """Give a candidate whose fit leaves what a test says."""
    return FittedCandidate(
        effect, fit.plant.description, dataclasses.replace(fit, **changed), 0.0
    )


def fit_effect(before, effect, trials, kinds):
    """Add one effect to the model of a fit, and fit all to the records."""
    (fitted,) = fit_candidates(before, [candidate(effect)], trials, kinds, in_budget)
    return fitted


def fitted_chain(description, trials, kinds, *effects):
    """Give a hypothesis of effects, each fitted beside those before it."""
    found = Hypothesis((refit(Plant.of(description, kinds=kinds), trials),), trials)
    for effect in effects:
        fitted = fit_effect(found.last, effect, trials, kinds)
        found = found.with_effect(fitted.fit, answer_of([fitted], [1.0], kinds))
    return found


def with_effects_as_given(description, trials, kinds, *effects):
    """Give a hypothesis of effects, each fit begun with the strengths that are given."""
    described, fits = description, []
    for effect in (None, *effects):
        described = described if effect is None else with_effect(described, effect)
        fits.append(refit(Plant.of(described, kinds=kinds), trials))
    return Hypothesis(
        tuple(fits), trials, effects=tuple(named_effect(one, kinds) for one in effects)
    )


def with_last(hypothesis, **changed):
    """Give the hypothesis with something changed in its last fit."""
    last = dataclasses.replace(hypothesis.last, **changed)
    return dataclasses.replace(hypothesis, fits=(*hypothesis.fits[:-1], last))


def round_of(before, trials, kinds, *, tried=(), shortlist=(), **more):
    """Give the round of a model's first effect, whose last fit is the one that is given."""
    known: dict[str, Any] = {
        "hypothesis": Hypothesis((before,), tuple(trials)),
        "monitor": Monitor(),
        "number": 0,
    }
    if "localized" not in more:
        known["localized"] = locate(before, trials)
    return Round(
        before=before, trials=tuple(trials), kinds=kinds, tried=tuple(tried),
        shortlist=tuple(shortlist), **(known | more),
    )  # fmt: skip


def fit_at(fit, trials, values, states=None, **changed):
    """Give a fit with other values or initial states: what it leaves is what their run does."""
    states = fit.states if states is None else states
    runs = tuple(
        fit.plant.simulate(values, t.inputs, t.rate_hz, state0=state, start_s=t.start_s)
        for t, state in zip(trials, states, strict=True)
    )
    left = tuple(
        np.where(t.used, t.measured - run, 0.0) for t, run in zip(trials, runs, strict=True)
    )
    cost = simulated_chi2(fit.plant, values, states, fit.noise, trials)
    known = {"cost": cost, "chi2_in_band": cost / fit.data}
    return dataclasses.replace(
        fit,
        values=values,
        states=tuple(states),
        outputs=runs,
        residual=left,
        **(known | changed),
    )


def scaled(fit, **factors):
    """Give the values of a fit, those of some names so many times as large."""
    values = fit.values.copy()
    for name, factor in factors.items():
        values[[one[-1] == name for one in fit.plant.parameters].index(True)] *= factor
    return values


@dataclasses.dataclass(frozen=True)
class StubProposer:
    """Proposes what a test says, and keeps the rounds it was asked in."""

    name: str
    proposed: Callable[[Round], Proposal] | None = None
    candidates: tuple[Candidate, ...] = ()
    rounds: list[Round] = dataclasses.field(default_factory=list)

    def __call__(self, given: Round) -> Proposal:
        """Propose."""
        self.rounds.append(given)
        if self.proposed is not None:
            return self.proposed(given)
        return Proposal(self.name, self.candidates)
