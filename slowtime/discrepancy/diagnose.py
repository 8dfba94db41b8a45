"""A campaign in, its diagnosis out: screen, refit, locate, name, refit, judge."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from slowtime.dynamics.effects import Effect, Kind, Law, catalogue
from slowtime.dynamics.plant import Plant

from .answer import UNWHITE, Found, report
from .candidates import candidates
from .diagnosis import Diagnosis
from .diagnosis import Named as Answer
from .further import AT_MOST, further
from .gap import whiteness
from .locate import locate
from .naming import KEPT, carrying, chosen, refit_all
from .outrun import within
from .pruning import pruned
from .records import Campaign, Trial
from .refit import Fit, refit
from .screen import screen
from .undriven import diagnose_undriven
from .verdict import (
    DECIDED,
    FALSE_ALARM,
    LEAST_GAIN,
    answer_of,
    base_answer,
    moved_of,
    probabilities,
    rivals_within,
)
from .wandering import wandering

SILENT = 0.01
"""Chance of so large a chi squared above which nothing more is looked for after the first."""
MOST, LATER, TWICE = 3, 3, 2
"""Effects that are looked for, one after the other; labels refitted for the later ones, and
where what is left is left at a place that has an effect already."""

Progress = Callable[[str, float], None]


@runtime_checkable
class Stop(Protocol):
    """What tells that somebody wants it to end, such as `threading.Event`."""

    def is_set(self) -> bool:
        """Whether to end."""
        ...


class Cancelled(Exception):
    """Somebody asked the diagnosis to stop."""


@dataclasses.dataclass(slots=True, eq=False)
class _Watch:
    """Tells how far it has come, and stops where asked to."""

    progress: Progress | None
    stop: Stop | None
    far: float = 0.0

    def __call__(self, stage: str, share: float) -> None:
        if self.stop is not None and self.stop.is_set():
            raise Cancelled(f"The diagnosis was stopped: {stage}.")
        self.far = max(self.far, share)
        if self.progress is not None:
            self.progress(stage, self.far)


def diagnose(
    campaign: Campaign,
    *,
    kinds: Mapping[str, Kind] | None = None,
    quick: bool = False,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> Diagnosis:
    """Say what a model lacks, where, how much, and how sure that is.

    Parameters
    ----------
    campaign
        Model and records.
    kinds
        Effects that may be named; the catalogue where not given.
    quick
        Fewer rivals are refitted, and one effect is looked for.
    progress
        Told the stage in words and the share done.
    stop
        Once set, `Cancelled` is raised.
    """
    tell = _Watch(progress, stop)
    known = catalogue() if kinds is None else kinds
    tell("screening channels", 0.0)
    screened = [screen(trial, campaign.channels) for trial in campaign.trials]
    trials = tuple(one.trial for one in screened)
    findings = tuple(finding for one in screened for finding in one.findings)
    if campaign.ambient:
        tell("comparing spectra", 0.1)
        return diagnose_undriven(campaign, trials, findings, known)
    tell("refitting the model within its tolerances", 0.05)
    found = Found([refit(Plant.of(campaign.description, kinds=known), trials)], trials)
    for number in range(1 if quick else MOST):
        if not _next(found, known, 3 if quick else KEPT, number, tell):
            break
    else:
        tell("looking at what is left", 0.9)
        found.left = locate(found.fits[-1], found.trials)
    _prune(found, found.trials, known)
    tell("judging by what was not fitted", 0.92)
    return report(campaign, found.trials, findings, found, known)


def _next(
    found: Found,
    kinds: Mapping[str, Kind],
    most: int,
    number: int,
    tell: _Watch,
) -> bool:
    """Look for one more effect; False where there is none."""
    share = 0.1 + 0.27 * number
    before = found.fits[-1]
    pulled = bool(moved_of(before))
    if found.answers and not pulled and whiteness(before) > SILENT:
        return False
    tell("locating what is left", share)
    located = locate(before, found.trials)
    found.located, found.left = found.located or located, located
    if located.p_value > FALSE_ALARM and not pulled:
        return False
    tell("trying effects", share + 0.05)
    tried = candidates(before, located, kinds)
    shaken = base_answer(located, tried, kinds, first=number == 0)
    if shaken is not None:
        found.answers.append(shaken)
        found.fits.append(carrying(before, shaken.effect, kinds))
        found.left = None
        return False
    # Twice at one place: what no single law explains there is more likely a law unknown.
    again = any(a.effect.place in located.groups[0].places for a in found.answers)
    tried = [one for one in tried if not _bends_twice(one.effect, found.answers, kinds)]
    labels = chosen(tried, (TWICE if again else LATER) if number else most)
    channels = tuple(s.channel for s in before.plant.description.sensors)
    trials = within(found.trials, channels, (one.effect for one in labels), kinds)

    def tick(effect: Effect, i: int) -> None:
        tell(f"refitting {effect.kind} at {effect.place}", share + 0.08 + 0.18 * i / most)

    named = refit_all(before, labels, trials, kinds, tick)
    if not named or whiteness(named[0].fit) < UNWHITE:
        drift = wandering(located, kinds)
        if drift is not None:
            found.answers.append(drift)
            # Its course is no law's: a free run is better off without.
            still = dict.fromkeys(drift.effect.parameters, 0.0)
            silent = dataclasses.replace(drift.effect, parameters=still)
            found.fits.append(carrying(before, silent, kinds))
            found.left = None
            return False
    more = AT_MOST if number == 0 and most == KEPT else 0
    named = further(before, tried, named, trials, kinds, tick, more)
    if not named:
        return False
    best = named[0]
    bar = refit(
        before.plant, trials, noise=best.fit.noise, values=before.values,
        states=before.states, horizons=(1.0,),
    )  # fmt: skip
    numbers = sum(name[0] == "effect" for name in bar.prior.names)
    nothing = -bar.cost / 2 - numbers / 2 * np.log(bar.data)
    if best.score - nothing < LEAST_GAIN:
        return False
    if pulled and _retuned(bar) > best.score:
        return False
    twice = again and best.effect.place.kind != "sensor"
    if twice and whiteness(best.fit) < UNWHITE:
        return False
    found.fits.append(best.fit)
    found.trials = within(found.trials, channels, (best.effect,), kinds)
    found.answers.append(answer_of(named, kinds))
    shares = probabilities([n.score for n in named], best.fit.chi2_in_band)
    if shares[0] < DECIDED and not found.undecided:
        found.undecided = rivals_within(named, shares)
        found.pair = named[0], named[1]
    return True


def _bends_twice(effect: Effect, answers: Sequence[Answer], kinds: Mapping[str, Kind]) -> bool:
    """Whether an effect is of the family of one found at its place: a curve in pieces."""
    kind = kinds[effect.kind]
    switched = isinstance(kind.action, Law) and bool(kind.action.switches)
    if kind.quadrature is not None or switched:
        return False
    return any(
        answer.effect.place == effect.place and answer.family == kind.family
        for answer in answers
    )


def _prune(found: Found, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]) -> None:
    """Forget effects that the later ones have made needless, and doubts about them."""
    told = {(a.effect.kind, a.effect.place) for a in found.answers}
    found.fits, found.answers = pruned(found.fits, found.answers, trials, kinds)
    gone = told - {(a.effect.kind, a.effect.place) for a in found.answers}
    if any((rival.effect, rival.place) in gone for rival in found.undecided[:1]):
        found.undecided, found.pair = (), None


def _retuned(fit: Fit) -> float:
    """Log evidence of constants whose tolerance was stated five times too small."""
    pulls = np.array([p for name, p in fit.pulls.items() if name[0] != "effect"])
    wide = 5.0
    relief = pulls**2 / 2 * (1 - wide**-2) - np.log(wide)
    return float(-fit.cost / 2 + relief.sum())
