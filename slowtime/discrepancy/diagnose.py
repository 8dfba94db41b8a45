"""A campaign in, its diagnosis out: screen, refit, locate, name, refit, judge."""

import dataclasses
from collections.abc import Callable, Mapping

from slowtime.dynamics.effects import Kind, catalogue
from slowtime.dynamics.plant import Plant

from .answer import MANY, UNWHITE, Found, report
from .between import found_holds, held_as
from .diagnosis import Diagnosis, Rival
from .floating import offsets, with_offsets
from .gap import whiteness
from .misled import unmisled
from .pruning import pruned
from .records import Campaign, Trial
from .refit import refit
from .refuted import refuted
from .screen import screen
from .search import EXPLAINED, Search, search
from .undriven import diagnose_undriven
from .watch import Progress, Stop, Watch

EITHER = 0.5
"""Chance of a law that need do nothing of its own: one near it, not known, is as likely."""


def diagnose(
    campaign: Campaign,
    *,
    kinds: Mapping[str, Kind] | None = None,
    quick: bool = False,
    progress: Progress | None = None,
    stop: Stop | None = None,
    late: Callable[[], bool] | None = None,
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
        Once set, `slowtime.discrepancy.watch.Cancelled` is raised.
    late
        Once true, no more laws are tried: what was found by then is the answer.
    """
    tell = Watch(progress, stop, late)
    known = catalogue() if kinds is None else kinds
    tell("screening channels", 0.0)
    screened = [screen(trial, campaign.channels) for trial in campaign.trials]
    trials = tuple(one.trial.trimmed() for one in screened)
    findings = tuple(finding for one in screened for finding in one.findings)
    if campaign.ambient:
        tell("comparing spectra", 0.1)
        return diagnose_undriven(campaign, trials, findings, known)
    tell("refitting the model within its tolerances", 0.05)
    stated = tuple(entry.hold for entry in campaign.description.inputs)
    start = with_offsets(campaign.description, known)
    first = refit(Plant.of(start, kinds=known), trials)
    tell("looking at what inputs do between samples", 0.08)
    holds = found_holds(first, trials, known)
    if holds is not None:
        held = held_as(campaign.description, holds)
        campaign = dataclasses.replace(campaign, description=held)
        start = with_offsets(held, known)
        first = refit(Plant.of(start, kinds=known), trials)
    found = search(first, trials, Search(known, tell, quick, stated))
    if found.holds is not None:
        held = held_as(campaign.description, found.holds)
        campaign = dataclasses.replace(campaign, description=held)
    unmisled(found, campaign)
    _prune(found, found.trials, known)
    _refute(found, len(start.effects), known)
    if len(start.effects) > len(campaign.description.effects):
        told = offsets(found.fits[-1], campaign.description, known)
        # What the model lacks without its offsets, too, is the gap that is shown.
        alone = refit(Plant.of(campaign.description, kinds=known), found.trials)
        found.fits = [alone, *(found.fits if told and not found.answers else found.fits[1:])]
        found.answers += told
    tell("judging by what was not fitted", 0.92)
    return report(campaign, found.trials, findings, found, known)


def _prune(found: Found, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]) -> None:
    """Forget effects that the later ones have made needless, and doubts about them."""
    told = {(a.effect.kind, a.effect.place) for a in found.answers}
    found.fits, found.answers = pruned(found.fits, found.answers, trials, kinds)
    gone = told - {(a.effect.kind, a.effect.place) for a in found.answers}
    if any((rival.effect, rival.place) in gone for rival in found.undecided[:1]):
        found.undecided, found.pair = (), None


def _refute(found: Found, first: int, kinds: Mapping[str, Kind]) -> None:
    """Be sure of no law that does nothing of its own, and take none that is refuted.

    What leaves more than noise is judged by that: of real structures no law is quite true. Of
    patchwork, what is left is too little to be judged by: the more laws, the less it is.
    """
    last = found.fits[-1]
    if not found.answers or found.undecided or found.ended:
        return
    patchwork = len(found.answers) >= MANY and last.chi2_in_band < EXPLAINED
    if whiteness(last) <= UNWHITE and not patchwork:
        return
    doubt = refuted(last, first, found.trials, kinds)
    if doubt is None:
        return
    if not doubt.idle:
        found.refuted = doubt.place
        return
    found.near = True
    for number in doubt.idle:
        unsure = dataclasses.replace(found.answers[number - first], probability=EITHER)
        found.answers[number - first] = unsure
        rival = Rival(unsure.effect.kind, unsure.effect.place, EITHER)
        found.undecided = (*found.undecided, rival)
