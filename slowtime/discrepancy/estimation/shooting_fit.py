"""Fits by multiple shooting, for laws whose free run goes astray.

A law whose force explains the records, and whose free run does not, may have settled in a
minimum of its own: it is fitted once more, from where the model stood without it; and where
that does not help, to short pieces of the records first.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

from .candidate_fit import Tick, fit_candidates
from .model_evidence import FittedCandidate, evidence, misfit, rescored

SHOT_CANDIDATES = 2
"""[candidates] Of each ranking that are fitted to segments. Source: docs/decisions/0029."""
ASTRAY_RATIO = 2.0
"""[1] Times its chi squared along the force that a free run leaves which has gone astray.
Source: docs/what_decides.md: half and double change no answer."""


def shooting_fits(
    before: Fit,
    labels: Sequence[Candidate],
    named: Sequence[FittedCandidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    tick: Tick,
) -> list[FittedCandidate]:
    """Fit labels to pieces first where their free run went astray; all, the best first."""
    found = list(named)
    if not found or found[0].fit.chi2_in_band <= LIMITS.far_off_chi2:
        return found

    def astray() -> list[Candidate]:
        left = {label_of(one.effect): misfit(one.fit, before.noise, trials) for one in found}
        least = min(left.values())
        return [
            one
            for one in labels
            if left.get(label_of(one.effect), np.inf)
            > ASTRAY_RATIO * one.cost
            < ASTRAY_RATIO * least
        ]

    anew = [
        dataclasses.replace(one, start=None)
        for one in astray()
        if one.start and not one.start.from_segments
    ]
    found = merge_fits(found, fit_candidates(before, anew, trials, kinds, tick), trials, kinds)
    if found[0].fit.chi2_in_band <= LIMITS.far_off_chi2:
        return found
    more = fit_candidates(before, astray(), trials, kinds, tick, shooting=True)
    return merge_fits(found, more, trials, kinds)


def first_of_each(*ranked: Sequence[Candidate]) -> list[Candidate]:
    """Give the first of several rankings, each label once."""
    found: dict[Label, Candidate] = {}
    for one in (one for labels in ranked for one in labels[:SHOT_CANDIDATES]):
        found.setdefault(label_of(one.effect), one)
    return list(found.values())


def in_pieces(
    named: Sequence[FittedCandidate], kinds: Mapping[str, Kind]
) -> list[FittedCandidate]:
    """Give labels that explain every piece of the records, but no record as a whole."""
    # Where motion is chaotic no law can do more, be it the right one.
    if not named or named[0].fit.chi2_in_band <= LIMITS.far_off_chi2:
        return []
    found = [
        dataclasses.replace(one, fit=one.shot, score=evidence(one.shot, kinds), shot=None)
        for one in named
        if one.shot is not None
    ]
    found.sort(key=lambda one: -one.score)
    return found if found and found[0].fit.chi2_in_band < LIMITS.segment_chi2 else []


def merge_fits(
    found: Sequence[FittedCandidate],
    more: Sequence[FittedCandidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[FittedCandidate]:
    """Judge all by the noise of the one that leaves least; keep the better of each label."""
    every = [*found, *more]
    if not every:
        return []
    least = min(every, key=lambda one: unexplained_by(one.fit))
    judged = [one if one is least else rescored(one, least.fit, trials, kinds) for one in every]
    short = {label_of(one.effect): one.shot for one in more}
    kept: dict[Label, FittedCandidate] = {}
    for one in sorted(judged, key=lambda one: -one.score):
        label = label_of(one.effect)
        kept.setdefault(label, dataclasses.replace(one, shot=short.get(label)))
    return list(kept.values())


def unexplained_by(fit: Fit) -> float:
    """Sum of the log mean squares of all residuals [nats]: it needs no model of the noise."""
    power = [np.mean(residual**2, axis=0) for residual in fit.residual]
    return float(np.sum(np.log(np.maximum(power, np.finfo(float).tiny))))
