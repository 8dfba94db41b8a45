"""Refits that fall far short of what their law explains along the force, in; better ones, out.

A law whose force explains the records, and whose free run does not, may have settled in a
minimum of its own: it is fitted once more, from where the model stood without it; and where
that does not help, to short pieces of the records first.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.effects import Kind

from .candidates import Candidate, Label, label_of
from .naming import Named, Tick, evidence, misfit, refit_all, rescored
from .records import Trial
from .refit import Fit

FAR_OFF = 5.0
"""Mean square over the noise, in band, that no right law leaves."""
IN_PIECES = 2.0
"""The same that the right law leaves of short pieces."""
FOREMOST = 2
"""Labels of a ranking that are fitted so."""
SHORT_OF = 2.0
"""Times the chi squared along the force that a free run leaves which has gone astray."""


def shot_too(
    before: Fit,
    labels: Sequence[Candidate],
    named: Sequence[Named],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    tick: Tick,
) -> list[Named]:
    """Fit labels to pieces first where their free run went astray; all, the best first.

    Parameters
    ----------
    labels
        Candidates, the foremost of them, each once.
    named
        Those that were refitted, the best first.
    """
    found = list(named)
    if not found or found[0].fit.chi2_in_band <= FAR_OFF:
        return found

    def astray() -> list[Candidate]:
        left = {label_of(one.effect): misfit(one.fit, before.noise, trials) for one in found}
        least = min(left.values())
        return [
            one
            for one in labels
            if left.get(label_of(one.effect), np.inf) > SHORT_OF * one.cost < SHORT_OF * least
        ]

    anew = [
        dataclasses.replace(one, start=None)
        for one in astray()
        if one.start and not one.start.nearby
    ]
    found = joined(found, refit_all(before, anew, trials, kinds, tick), trials, kinds)
    if found[0].fit.chi2_in_band <= FAR_OFF:
        return found
    more = refit_all(before, astray(), trials, kinds, tick, shooting=True)
    return joined(found, more, trials, kinds)


def foremost(*ranked: Sequence[Candidate]) -> list[Candidate]:
    """Give the first of several rankings, each label once."""
    found: dict[Label, Candidate] = {}
    for one in (one for labels in ranked for one in labels[:FOREMOST]):
        found.setdefault(label_of(one.effect), one)
    return list(found.values())


def in_pieces(named: Sequence[Named], kinds: Mapping[str, Kind]) -> list[Named]:
    """Give labels that explain every piece of the records, but no record as a whole.

    Where motion is chaotic no law can do more, be it the right one. None otherwise.
    """
    if not named or named[0].fit.chi2_in_band <= FAR_OFF:
        return []
    found = [
        dataclasses.replace(one, fit=one.shot, score=evidence(one.shot, kinds), shot=None)
        for one in named
        if one.shot is not None
    ]
    found.sort(key=lambda one: -one.score)
    return found if found and found[0].fit.chi2_in_band < IN_PIECES else []


def joined(
    found: Sequence[Named],
    more: Sequence[Named],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[Named]:
    """Judge all by the noise of the one that leaves least; keep the better of each label."""
    every = [*found, *more]
    if not every:
        return []
    least = min(every, key=lambda one: left_by(one.fit))
    judged = [one if one is least else rescored(one, least.fit, trials, kinds) for one in every]
    short = {label_of(one.effect): one.shot for one in more}
    kept: dict[Label, Named] = {}
    for one in sorted(judged, key=lambda one: -one.score):
        label = label_of(one.effect)
        kept.setdefault(label, dataclasses.replace(one, shot=short.get(label)))
    return list(kept.values())


def left_by(fit: Fit) -> float:
    """Sum of the logarithms of the power that each sensor has left in each trial."""
    power = [np.mean(residual**2, axis=0) for residual in fit.residual]
    return float(np.sum(np.log(np.maximum(power, np.finfo(float).tiny))))
