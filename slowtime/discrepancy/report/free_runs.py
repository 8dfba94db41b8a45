"""Outcome of a search by free runs: what is left, the gap on what was not fitted, pictures."""

from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Gap,
    GapStep,
    NamedEffect,
    Surface,
    Suspect,
    When,
)
from slowtime.discrepancy.estimation.input_hold import saying_holds
from slowtime.discrepancy.experiment_design.proposal import propose_experiment
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization, characterise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.force_surface import AUTO, SurfaceDemand
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import spectra_of, traces_of
from slowtime.dynamics.effects import Kind, force_along

from .assembly import assemble
from .evaluation import Evaluation, described, evaluate
from .final_model import KeptModel, kept_model, moved_constants, requoted_judgement
from .judgement import judge, unknown_sentence
from .likeness import likenesses
from .notes import notes_of
from .outcome import NEVER, CampaignOutcome, gap_of
from .surface_cuts import measured_force


def report(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    found: Hypothesis,
    kinds: Mapping[str, Kind],
    monitor: Monitor | None = None,
    *,
    surface: SurfaceDemand = AUTO,
) -> Diagnosis:
    """Judge a hypothesis by free runs on what was not fitted, and report it.

    Where a monitor is given, and the effect is unknown, a force surface closes the gap.
    """
    given = campaign.description
    evaluation = evaluate(campaign, trials, found, kinds)
    judged = judge(found, evaluation, kinds)
    kept = kept_model(judged, evaluation, trials, kinds, monitor, surface)
    judged = requoted_judgement(judged, kept, kinds)
    found, unknown = judged.found, judged.unknown
    closed = kept.closed
    like = [] if closed is None else likenesses(closed.fit, closed.place, found, kinds)
    last, located = kept.fit if unknown else found.last, found.localized
    assert located is not None
    doubted = bool(found.pair) and not unknown
    white_p_value = chi2_p_value(last)
    outcome = CampaignOutcome(
        effects=judged.effects,
        undecided=found.undecided,
        unknown=unknown_sentence(found, evaluation, kinds) if unknown else "",
        constants_suffice=found.constants_suffice,
        near_unknown=found.near_unknown,
        moved=moved_constants(kept, given),
        experiment=propose_experiment(found.pair or (), trials, kinds) if doubted else None,
        nothing_probability=(
            white_p_value if unknown and not found.effects else _nothing(found, located)
        ),
        where=_suspects(located),
        when=_when(located, given.unit_of_coordinate) if found.effects else NEVER,
        gap=_gap(() if unknown else found.effects, evaluation, kept),
        chi2_per_datum=last.chi2_per_datum,
        residual_white=white_p_value > LIMITS.white_p_value,
        white_p_value=white_p_value,
        refitted=described(found.first),
        augmented=given if kept.useless else saying_holds(described(kept.fit)),
        traces=traces_of(
            evaluation.tests, evaluation.nominal.runs, evaluation.steps[0].runs,
            kept.result.runs,
        ),
        spectra=spectra_of(
            evaluation.tests, evaluation.steps[0].runs, kept.result.runs, evaluation.noise
        ),
        surface=_surface(found, kinds, unknown=unknown) if found.effects or unknown else None,
        notes=notes_of(given, judged, kept, evaluation, kinds, like),
        exhausted=judged.found.exhausted,
        measured_force=None if closed is None else measured_force(closed, like, found, kinds),
    )  # fmt: skip
    return assemble(given, outcome, findings, kinds)


def _nothing(found: Hypothesis, located: Localization) -> float:
    if found.effects:
        return float(np.exp(-max(located.groups[0].score, 0.0)))
    return 1.0 - min(0.5, max(0.0, 1e-3 - located.p_value))


def _suspects(located: Localization) -> tuple[Suspect, ...]:
    return tuple(
        Suspect(place, g.score, g.p_value, g.share)
        for g in located.groups
        for place in g.places
    )


def _when(located: Localization, coordinate: str) -> When:
    seen = characterise(located, located.best)
    motion = "an elongation" if located.best.kind == "element" else "a displacement"
    return When(
        seen.times_s, seen.bands_hz, seen.amplitude(motion, coordinate), linear=seen.linear,
        steady=seen.steady,
    )  # fmt: skip


def _gap(effects: Sequence[NamedEffect], evaluation: Evaluation, kept: KeptModel) -> Gap:
    closed = kept.closed
    further = [] if closed is None else [
        GapStep(closed.fit.plant.effects[-1].kind, closed.place, closed.error)
    ]  # fmt: skip
    return gap_of(
        effects, evaluation.errors, nominal=float(evaluation.nominal.error.mean()),
        floor=evaluation.floor, held_out=evaluation.held_out,
        kept=float(kept.result.error.mean()), worst=float(kept.result.error.max()),
        further=further,
    )  # fmt: skip


def _surface(found: Hypothesis, kinds: Mapping[str, Kind], *, unknown: bool) -> Surface | None:
    """Force at the place of the first effect, or of none, as recovered before any was in."""
    located, refuted = found.localized, found.refuted_at
    assert located is not None
    answers = () if unknown else found.effects
    place = answers[0].effect.place if answers else refuted or located.best_structural
    if place.kind not in ("element", "node"):
        return None
    latents = [located.latent(place, i) for i in range(len(located.trials))]
    law = None
    if answers:
        kind, parameters = kinds[answers[0].effect.kind], answers[0].effect.parameters
        law = np.concatenate([force_along(kind, parameters, x.motion) for x in latents])
    stride = max(sum(len(x.force) for x in latents) // 5000, 1)
    return Surface(
        place=place,
        e=np.concatenate([x.motion.e for x in latents])[::stride],
        v=np.concatenate([x.motion.v for x in latents])[::stride],
        force=np.concatenate([x.force for x in latents])[::stride],
        law=None if law is None else law[::stride],
    )
