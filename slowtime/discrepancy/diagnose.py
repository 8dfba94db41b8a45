"""A campaign in, its diagnosis out: screen, refit, locate, name, refit, judge."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.quoting import requote_all
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Hidden, InputChange, Kind, SensorChange, catalogue
from slowtime.dynamics.plant import Plant

from .ambient.diagnosis import diagnose_ambient
from .calibration import Fit, refit
from .calibration.augmentation import carry_effect, described_effects
from .calibration.tolerances import refit_within_tolerances
from .data.screening import screen_records
from .diagnosis import Diagnosis
from .estimation.candidate_fit import FittedCandidate, evidence, rescored
from .estimation.input_hold import (
    Hold,
    describe_holds,
    found_holds,
    held_better,
    held_otherwise,
    with_holds,
)
from .estimation.shooting_fit import unexplained_by
from .progress import Monitor, Progress, Stop
from .proposers.missing_link import best_link, link_instead_of
from .records import Campaign, Trial
from .refinement.campaign_span import span_campaign
from .refinement.convergence import converge, converge_stick_slip
from .refinement.elimination import eliminate
from .refinement.harmful_effects import drop_harmful_effects
from .refinement.input_offsets import offsets, with_offsets
from .report.assembly import BY_ONE, report
from .search import Search, reheld, search
from .selection.doubts import doubt
from .selection.many_laws import MANY
from .selection.probabilities import doubts_about
from .state import Found
from .validation.free_force_test import refuted_by_free_force

QUICK = (
    "It was to be quick: few laws were tried, of one effect. Without --quick more are, before "
    "any is called unknown."
)


def diagnose(
    campaign: Campaign,
    *,
    kinds: Mapping[str, Kind] | None = None,
    quick: bool = False,
    progress: Progress | None = None,
    stop: Stop | None = None,
    late: Callable[[], bool] | None = None,
    over: Callable[[], bool] | None = None,
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
        Once set, `slowtime.discrepancy.progress.Cancelled` is raised.
    late
        Once true, no more laws are tried than those that come near the best along the force.
    over
        Once true, none are: what was found by then is the answer. With `late`, where not given.
    """
    tell = Monitor(progress, stop, late, over)
    known = catalogue() if kinds is None else kinds
    tell("screening channels", 0.0)
    screened = screen_records(campaign.trials, campaign.channels)
    trials = tuple(one.trial.trimmed() for one in screened)
    findings = tuple(finding for one in screened for finding in one.findings)
    if campaign.ambient:
        tell("comparing spectra", 0.1)
        return diagnose_ambient(campaign, trials, findings, known)
    tell("refitting the model within its tolerances", 0.05)
    stated = tuple(entry.hold for entry in campaign.description.inputs)
    campaign, found = _searched(campaign, trials, known, tell, quick=quick)
    start = with_offsets(campaign.description, known)
    drop_harmful_effects(found, campaign)
    _prune(found, found.trials, known)
    _link(found, len(start.effects), known, tell)
    _refute(found, len(start.effects), known)
    if not tell.is_late:
        campaign = _held_at_last(campaign, found, stated, known)
        converge(found, len(start.effects), known)
        converge_stick_slip(found, len(start.effects), known, tell)
    span_campaign(found, len(start.effects), campaign, known)
    if len(start.effects) > len(campaign.description.effects):
        told = offsets(found.fits[-1], campaign.description, known)
        # What the model lacks without its offsets, too, is the gap that is shown.
        alone = refit(Plant.of(campaign.description, kinds=known), found.trials)
        found.fits = [alone, *(found.fits if told and not found.answers else found.fits[1:])]
        found.answers += told
    tell("judging by what was not fitted", 0.92)
    answer = report(campaign, found.trials, findings, found, known)
    if quick and answer.verdict == "unknown_effect":
        return dataclasses.replace(answer, notes=(*answer.notes, QUICK))
    return answer


def _searched(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    tell: Monitor,
    *,
    quick: bool,
) -> tuple[Campaign, Found]:
    """Search, and once more where the effects that were found show that a hold was mistaken.

    Gives the campaign with what its inputs do between samples, too.
    """
    stated = tuple(entry.hold for entry in campaign.description.inputs)

    def fitted() -> Fit:
        start = with_offsets(campaign.description, kinds)
        return refit(Plant.of(start, kinds=kinds), trials)

    def held(holds: Sequence[Hold]) -> Campaign:
        return dataclasses.replace(
            campaign, description=describe_holds(campaign.description, holds)
        )

    first = fitted()
    tell("looking at what inputs do between samples", 0.08)
    holds = found_holds(first, trials, kinds)
    if holds is not None:
        campaign = held(holds)
        first = fitted()
    tried: list[tuple[Hold, ...] | None] = [holds]
    kept: tuple[Campaign, Found] | None = None
    while True:
        found = search(first, trials, Search(kinds, tell, quick, stated, tuple(tried)))
        if found.holds is not None:
            return held(found.holds), found
        if kept is not None and found.hurried and not _leaves_less(found, kept[1]):
            return kept  # there was no time to come as far under this hold
        if found.ended or not (found.answers or found.otherwise) or tell.is_over:
            return campaign, found
        tell("looking at what inputs do between samples", 0.88)
        last = found.fits[-1]
        holds = found.otherwise or held_otherwise(last, found.trials, kinds, stated)
        if holds is None or holds in tried:
            return campaign, found
        tried.append(holds)
        kept = campaign, found
        campaign = held(holds)
        first = fitted()
        if found.otherwise is not None:
            kept = campaign, reheld(found, holds, kinds)


def _held_at_last(
    campaign: Campaign,
    found: Found,
    stated: Sequence[Hold],
    kinds: Mapping[str, Kind],
) -> Campaign:
    """Take the hold that does best with all effects in, though another would pass, too.

    What is left is noise under either; numbers are not the same.
    """
    if found.ended or found.holds is not None or not found.answers:
        return campaign
    if any(len(fit.states) != len(found.trials) for fit in found.fits):
        return campaign
    holds = held_better(found.fits[-1], found.trials, kinds, stated)
    if holds is None:
        return campaign
    found.fits = [with_holds(fit, holds, found.trials, kinds) for fit in found.fits]
    found.answers = requote_all(found.answers, found.fits[-1], kinds)
    return dataclasses.replace(
        campaign, description=describe_holds(campaign.description, holds)
    )


def _leaves_less(found: Found, other: Found) -> bool:
    """Whether an account explains all, or leaves less than another of the same records.

    One that is judged by pieces of them explains these; whole records would not tell.
    """
    if found.fits[-1].chi2_in_band < LIMITS.explained_chi2:
        return True
    if len(found.trials) != len(other.trials):
        return len(found.trials) > len(other.trials)
    return unexplained_by(found.fits[-1]) < unexplained_by(other.fits[-1])


def _prune(found: Found, trials: tuple[Trial, ...], kinds: Mapping[str, Kind]) -> None:
    """Forget effects that the later ones have made needless, and doubts about them."""
    told = {(a.effect.kind, a.effect.place) for a in found.answers}
    places = [answer.effect.place for answer in found.answers]
    if found.ended and places[-1].kind == "sensor" and places.count(places[-1]) == 1:
        # A wandering is in the model as a word only, which explains nothing, and stays; unless
        # another fault of its sensor was named, which a drift may make needless.
        drift, last = found.answers[-1], described_effects(found.fits[-1].plant.description)[-1]
        fits, answers = eliminate(found.fits[:-1], found.answers[:-1], trials, kinds)
        found.fits, found.answers = (
            [*fits, carry_effect(fits[-1], last, kinds)],
            [*answers, drift],
        )
    else:
        found.fits, found.answers = eliminate(found.fits, found.answers, trials, kinds)
    gone = told - {(a.effect.kind, a.effect.place) for a in found.answers}
    if any((rival.effect, rival.place) in gone for rival in found.undecided[:1]):
        left = (doubts_about(answer) for answer in found.answers)
        found.undecided, found.pair = next((rivals for rivals in left if rivals), ()), None


def _link(found: Found, first: int, kinds: Mapping[str, Kind], tell: Monitor) -> None:
    """Take back a hidden oscillator, or that no law is known, where a spring explains it."""
    last = found.fits[-1]
    if found.ended or len(last.states) != len(found.trials):
        return
    for number in range(len(found.answers)):
        latest = number == len(found.answers) - 1 and len(found.fits) == number + 2
        before = found.fits[-2] if latest else None
        link = link_instead_of(last, first + number, before, found.trials, kinds)
        lead = -math.inf if link is None else link.named.score - evidence(last, kinds)
        if lead > LIMITS.least_log_evidence:
            found.link, found.undecided, found.pair = link, (), None
            return
        if lead > -LIMITS.least_log_evidence and not found.undecided:
            doubt(found, number)
    explained = (
        last.chi2_in_band < LIMITS.explained_chi2
        and chi2_p_value(last) > LIMITS.coloured_p_value
    )
    # What acts in proportion, two of them or one on a node, may do what one spring does.
    straight = all(
        isinstance(kinds[answer.effect.kind].action, Hidden | SensorChange | InputChange)
        for answer in found.answers
    )
    on_node = any(answer.effect.place.kind == "node" for answer in found.answers)
    explained = explained and not (straight and (on_node or len(found.answers) > 1))
    if explained or tell.is_late or found.undecided:
        return
    link = best_link(
        refit_within_tolerances(found.fits[0], found.trials), None, found.trials, kinds, tell
    )
    if link is not None and _in_stead(link.named, found, kinds):
        found.link = link


def _in_stead(link: FittedCandidate, found: Found, kinds: Mapping[str, Kind]) -> bool:
    """Whether a spring leaves little of what was missing, and is likelier than the rest."""
    first, last = found.fits[0], found.fits[-1]
    if link.fit.chi2_in_band - 1 > BY_ONE * (first.chi2_in_band - 1):
        return False
    least = min((link.fit, last), key=unexplained_by)
    ahead, behind = (rescored(one, least, found.trials, kinds).score for one in (
        link, FittedCandidate(link.effect, last.plant.description, last, 0.0)
    ))  # fmt: skip
    return ahead - behind > LIMITS.least_log_evidence


def _refute(found: Found, first: int, kinds: Mapping[str, Kind]) -> None:
    """Be sure of no law that does nothing of its own, and take none that is refuted.

    What leaves more than noise is judged by that: of real structures no law is quite true. Of
    patchwork, what is left is too little to be judged by: the more laws, the less it is.
    """
    last = found.fits[-1]
    if not found.answers or found.undecided or found.ended:
        return
    patchwork = len(found.answers) >= MANY and last.chi2_in_band < LIMITS.explained_chi2
    if chi2_p_value(last) <= LIMITS.coloured_p_value and not patchwork:
        return
    against = refuted_by_free_force(last, first, found.trials, kinds)
    if against is None:
        return
    if not against.idle:
        found.refuted = against.place
        return
    for number in against.idle:
        doubt(found, number - first)
