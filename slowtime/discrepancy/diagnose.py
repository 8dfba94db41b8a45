"""Diagnosis of a campaign: screen, fit, search, refine, judge, report.

How a campaign is answered follows from its records, in this order:

- free decays (no inputs, motion that dies down): as forced records, without standstill, tones
  and holds;
- ambient (no inputs): spectra are compared (`ambient`);
- one spring whose motion is imposed: its force is a regression (`imposed_motion`);
- forced records, measured motion of the base among them: the loop of `search.loop`, within
  three more: windows (`_searched`), holds of the inputs (`search.input_holds`), and other first
  effects (`search.loop.search`).

Each fills an `Outcome` of its likelihood, from which verdict and report follow alike
(`report.assembly`). Laws that change during the records are effects like others. A history over
slow time, whose readings are frequencies, is diagnosed by `slowtime.history_diagnosis`.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from slowtime.dynamics.description import Description, OpenJoint
from slowtime.dynamics.effects import Kind, catalogue
from slowtime.dynamics.plant import Plant

from .ambient.diagnosis import diagnose_ambient
from .calibration import refit
from .calibration.tolerances import fit_within_tolerances
from .data.screening import screen, screen_records
from .diagnosis import Diagnosis
from .free_decay.damping import describe_damping
from .free_decay.records import is_free_decay, without_standstill, without_tones
from .hypothesis import Hypothesis
from .imposed_motion.diagnosis import diagnose_imposed_motion
from .imposed_motion.records import is_imposed
from .large_models import (
    ReducedModel,
    enlarge,
    fit_constants,
    is_large,
    reasons_against,
    reduce_for,
)
from .localization import NodePair, likely_pairs
from .open_joints import strip_joints, with_open_joints
from .progress import Monitor, Progress, Stop
from .record_windows import record_windows, with_whole_records
from .records import Campaign, Trial
from .refinement.campaign_span import span_campaign
from .refinement.constant_offsets import offsets, with_mean_offsets, with_offsets
from .refinement.convergence import converge, converge_stick_slip
from .refinement.elimination import eliminate_needless
from .refinement.harmful_effects import drop_harmful_effects
from .refinement.limit_laws import name_limits
from .refinement.natural_values import hold_natural_values
from .refinement.relocation import relocate
from .report.free_runs import report
from .search import DEFAULT_OPTIONS, SearchOptions, SearchSettings
from .search.input_holds import search_with_holds, with_best_holds
from .search.loop import grow
from .selection.comparison import explains_all
from .selection.refutation import refute
from .validation.free_run import evaluation_trials
from .wiring import find_rewiring, with_rewiring

QUICK = (
    "With --quick, only a few laws for a single effect were tried. Run again without "
    "--quick before treating an effect as unknown."
)


def diagnose(
    campaign: Campaign,
    *,
    kinds: Mapping[str, Kind] | None = None,
    options: SearchOptions = DEFAULT_OPTIONS,
    progress: Progress | None = None,
    stop: Stop | None = None,
    late: Callable[[], bool] | None = None,
    over: Callable[[], bool] | None = None,
    enough: Stop | None = None,
) -> Diagnosis:
    """Say what a model lacks, where, how much, and how sure that is.

    Parameters
    ----------
    campaign
        Model and records.
    kinds
        Effects that may be named; the catalogue where not given.
    options
        How thoroughly effects are searched for, and by which steps.
    progress
        Told the stage in words and the share done.
    stop
        Once set, `slowtime.discrepancy.progress.Cancelled` is raised.
    late
        Once true, no more laws are tried than those that come near the best along the force.
    over
        Once true, none are: what was found by then is the answer. With `late`, where not given.
    enough
        Once set, what was found by then is the answer, without a force surface. What follows
        the search ends at the limit that `time_limit.limited` sets.
    """
    return _diagnose(campaign, kinds, options, Monitor(progress, stop, late, over, enough))


def _diagnose(
    campaign: Campaign,
    kinds: Mapping[str, Kind] | None,
    options: SearchOptions,
    tell: Monitor,
) -> Diagnosis:
    known = catalogue() if kinds is None else kinds
    tell("screening channels", 0.0)
    unseen = tuple(screen(one).trial for one in campaign.holdout)
    campaign = dataclasses.replace(campaign, holdout=unseen)
    recorded = campaign.trials
    decays = is_free_decay(recorded)
    if decays:
        known = without_tones(known)
        recorded = tuple(without_standstill(trial) for trial in recorded)
    screened = screen_records(recorded, campaign.channels)
    trials = tuple(one.trial.trimmed() for one in screened)
    findings = tuple(finding for one in screened for finding in one.findings)
    if campaign.ambient and not decays:
        tell("comparing spectra", 0.1)
        opened = with_open_joints(campaign.description)
        opened_campaign = dataclasses.replace(campaign, description=opened)
        return strip_joints(diagnose_ambient(opened_campaign, trials, findings, known, tell))
    if is_imposed(campaign.description, trials):
        return diagnose_imposed_motion(campaign, trials, findings, known, tell)
    reduced = None
    if is_large(campaign.description) and not reasons_against(campaign.description):
        reduced = reduce_for(campaign.description, trials, known, tell)
        campaign = dataclasses.replace(campaign, description=reduced.small)
    tell("comparing each channel with each node", 0.03)
    given = campaign.description
    # A reduced model does not have all nodes.
    rewiring = None if decays or reduced else find_rewiring(given, trials, known)
    if rewiring is not None:
        campaign = dataclasses.replace(campaign, description=rewiring.description)
    tell("refitting the model within its tolerances", 0.05)
    stated = tuple(entry.hold for entry in campaign.description.inputs)
    how = SearchSettings(known, tell, options, stated, decays=decays)

    windows = (trials,) if decays else tuple(record_windows(trials, campaign.description))
    described = _with_likely_joints(campaign.description, windows[0], how)
    campaign = dataclasses.replace(campaign, description=described)
    if reduced is None:
        campaign, found = _searched(campaign, windows, how)
    else:
        campaign, found = _searched_reduced(campaign, reduced, windows[-1], how)
    tell("validating on data that were not fitted", 0.92)
    monitor = None if options.quick or tell.is_ended else tell
    answer = report(
        campaign, found.trials, findings, found, known, monitor, surface=options.surface
    )
    answer = strip_joints(answer)
    if rewiring is not None:
        answer = with_rewiring(answer, rewiring, given, evaluation_trials(trials, unseen))
    notes = [*answer.notes, *tell.notes, *(describe_damping(trials) if decays else ())]
    if options.quick and answer.verdict == "unknown_effect":
        notes.append(QUICK)
    answer = dataclasses.replace(answer, notes=tuple(notes))
    return answer if reduced is None else enlarge(answer, reduced, trials[0], known)


def _with_likely_joints(
    description: Description, trials: tuple[Trial, ...], how: SearchSettings
) -> Description:
    """Join points that nothing joins: all pairs, or the likeliest of many."""

    def likely(
        description: Description, pairs: Sequence[NodePair], most: int
    ) -> Sequence[NodePair]:
        how.monitor("ranking pairs of points that no element joins", 0.06)
        plant = Plant.of(
            with_offsets(description, how.kinds, decays=how.decays), kinds=how.kinds
        )
        fit = fit_within_tolerances(plant, trials)
        return pairs[:most] if fit is None else likely_pairs(fit, trials, pairs, most)

    return with_open_joints(description, likely)


def _searched(
    campaign: Campaign, windows: Sequence[tuple[Trial, ...]], how: SearchSettings
) -> tuple[Campaign, Hypothesis]:
    """Search in ever longer windows, until whole records settle what is found."""
    best: tuple[Campaign, Hypothesis] | None = None
    for trials in windows:
        held, found = search_with_holds(campaign, trials, how)
        held, found = _refined(held, found, how)
        if trials is not windows[-1]:
            how.monitor("fitting whole records", 0.9)
            whole = with_whole_records(found, windows[-1], how.kinds)
            if whole is not None:
                return _continued(held, whole, how)
        # An answer for which there was no time is no better than that of shorter windows.
        if best is None or not found.exhausted or explains_all(found):
            best = held, found
        if how.monitor.is_late:
            break
    assert best is not None
    return best


def _searched_reduced(
    campaign: Campaign, reduced: ReducedModel, trials: tuple[Trial, ...], how: SearchSettings
) -> tuple[Campaign, Hypothesis]:
    """Search in a reduced model, whose fits take seconds: few laws, and holds as stated."""
    few = dataclasses.replace(how, options=dataclasses.replace(how.options, quick=True))
    few = dataclasses.replace(few, stated=None)
    plant = Plant.of(campaign.description, kinds=how.kinds)
    found = grow(Hypothesis((fit_constants(reduced, plant, trials),), trials), few)
    # Neighbours explain nearly as much, and a budget that ends leaves the likeliest untried: no
    # place is told that was not compared with the others, whatever that takes.
    joints = [one for one in campaign.description.elements if isinstance(one, OpenJoint)]
    among = {name for one in joints for name in (one.id, *one.between)}
    found = relocate(found, how.kinds, Monitor(), least=1, among=among)
    return _refined(campaign, found, few)


def _continued(
    campaign: Campaign, found: Hypothesis, how: SearchSettings
) -> tuple[Campaign, Hypothesis]:
    """Look in whole records for what is too weak for windows."""
    known = len(found.effects)
    more = grow(found, how, known) if known else found
    return (campaign, found) if len(more.effects) == known else _refined(campaign, more, how)


def _refined(
    campaign: Campaign, found: Hypothesis, how: SearchSettings
) -> tuple[Campaign, Hypothesis]:
    """Drop what does harm or is needless, doubt what is refuted, and fit to the end."""
    kinds, monitor = how.kinds, how.monitor
    stated = how.stated or ()
    own = found.given_effects
    found = drop_harmful_effects(found, campaign)
    if not found.combined:
        found = eliminate_needless(found, found.trials, kinds)
        found = name_limits(found, kinds)
        found = refute(found, own, kinds)
    if not monitor.is_late:
        campaign, found = with_best_holds(campaign, found, stated, how)
        found = converge(found, own, kinds)
        found = converge_stick_slip(found, own, kinds, monitor)
    found = hold_natural_values(found, kinds)
    found = span_campaign(found, own, campaign, kinds)
    return campaign, _without_offsets(campaign, found, own, kinds)


def _without_offsets(
    campaign: Campaign, found: Hypothesis, own: int, kinds: Mapping[str, Kind]
) -> Hypothesis:
    """Name the constants that inputs of a floating structure are off by."""
    if own == len(campaign.description.effects):
        return found
    found = found.with_effects([with_mean_offsets(fit) for fit in found.fits], found.effects)
    named = offsets(found.last, found.trials, campaign.description, kinds)
    # What the model lacks without its offsets, too, is the gap that is shown.
    alone = refit(Plant.of(campaign.description, kinds=kinds), found.trials)
    rest = found.fits if named and not found.effects else found.fits[1:]
    return found.with_effects((alone, *rest), (*found.effects, *named))
