"""Diagnosis of records of imposed motion: the law of one element from its measured force."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.screening import Finding, screen
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Gap,
    GapStep,
    NamedEffect,
    Number,
    Rival,
    Spectra,
    Surface,
    Traces,
    Verdict,
    When,
)
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import percent, sentence_of, unit_at
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.selection.probabilities import doubts_about, fault_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

from .experiment import deciding_experiment
from .records import ForceRecord, ImposedRig, force_record, rig_of
from .regression import ForceFit, ForceRegression
from .selection import MEMORY, Comparison, ForceModel, compare, group_of
from .standstill import without_standstills

SLIDING = 0.95
"""[share of the friction of sliding] Force of a law from which the element counts as sliding.
Source: a decision."""
MIN_WHITE = 0.5
"""[share of the samples] That are independent in a white residual. Source: a decision: half are
left by a correlation of a third from one sample to the next."""
MAX_REST = 0.3
"""[share of the scatter of the force] That a law which is named leaves at most. Source: laws of
published dampers leave 11 to 25 % of their measured forces."""
IMPOSED = "Motion was imposed and force measured: errors are relative to the measured force."
JUDGED = {True: "the held-out record", False: "the last third of the records"}
NO_HOLDOUT = "No record was held out: the error is that of the last third of each record."


MAX_WORSE = 3.0
"""[1] Error of the force on held-out records over that of cross-validation, up to which a law
holds. Source: a decision: friction of two days differs by less."""
HELD = 0.1
"""[share of the scatter of the force] Error on held-out records below which a law holds in any
case. Source: good laws of published dampers leave as much."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """The models compared, their probabilities, and the chosen one with its predecessors.

    Parameters
    ----------
    models, shares
        All that were compared, and their probabilities.
    steps
        Fits without a law, with the first, and so on.
    errors
        Of each step on the records judged, over the scatter of the force.
    rest
        What the last step leaves in cross-validation, over the scatter of the force.
    """

    regression: ForceRegression
    models: tuple[ForceModel, ...]
    shares: tuple[float, ...]
    steps: tuple[ForceFit, ...]
    errors: tuple[float, ...]
    rest: float
    count: float

    @property
    def last(self) -> ForceFit:
        """Fit of the chosen model."""
        return self.steps[-1]

    @property
    def holds(self) -> bool:
        """Whether its error on the records judged is near that on those learnt from."""
        return self.errors[-1] <= max(HELD, MAX_WORSE * self.rest)


def diagnose_imposed_motion(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
    monitor: Monitor,
) -> Diagnosis:
    """Name the law of an element from the force that an imposed motion took.

    Parameters
    ----------
    campaign
        Model of one spring, and records of its motion and force.
    kinds
        Catalogue of effects by name.

    Returns
    -------
    The diagnosis; errors are those of the force.
    """
    rig = rig_of(campaign.description)
    assert rig is not None
    held_out = tuple(screen(trial).trial for trial in campaign.holdout)
    learn = trials if held_out else tuple(_head(trial) for trial in trials)
    tests = held_out or tuple(_tail(trial) for trial in trials)
    records = [force_record(rig, trial) for trial in learn]
    judged = [force_record(rig, trial) for trial in tests]
    findings = without_standstills(findings, [force_record(rig, trial) for trial in trials])
    regression = ForceRegression(rig, campaign.description.tolerance, records, kinds)
    comparison = compare(regression, campaign.description, kinds, monitor)
    found = _chosen(regression, comparison, judged, kinds)
    return _answer(campaign, rig, found, judged, findings, kinds)


def _head(trial: Trial) -> Trial:
    return trial.part(0, len(trial.outputs) * 2 // 3)


def _tail(trial: Trial) -> Trial:
    return trial.part(len(trial.outputs) * 2 // 3, len(trial.outputs))


def _chosen(
    regression: ForceRegression,
    comparison: Comparison,
    judged: Sequence[ForceRecord],
    kinds: Mapping[str, Kind],
) -> _Found:
    """Choose the likeliest model; its error on held-out records tempers all probabilities."""
    models = comparison.models
    scatter = float(np.std(np.concatenate([one.force for one in judged])))
    spread = float(np.std(regression.force[regression.used]))

    def error(fit: ForceFit) -> float:
        left = [one.force - regression.predict(fit, one) for one in judged]
        return _rms(left) / scatter

    shares = comparison.shares(1.0, kinds)
    best = int(np.argmax(shares))
    rest = models[best].rms / spread
    worse = error(models[best].fit) / max(rest, np.finfo(float).tiny)
    shares = comparison.shares(max(worse, 1.0) ** 2, kinds)
    steps = [models[0].fit]
    for count in range(1, len(models[best].names)):
        parts = [i for i, one in enumerate(models)
                 if one.names < models[best].names and len(one.names) == count]  # fmt: skip
        steps.append(models[max(parts, key=lambda i: comparison.scores[i])].fit)
    if best:
        steps.append(models[best].fit)
    return _Found(
        regression, models, tuple(shares), tuple(steps),
        tuple(error(one) for one in steps), rest, comparison.count,
    )  # fmt: skip


def _answer(
    campaign: Campaign,
    rig: ImposedRig,
    found: _Found,
    judged: Sequence[ForceRecord],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    given, last, regression = campaign.description, found.last, found.regression
    effects = [_named(found, number, given, kinds) for number in range(len(last.effects))]
    faults = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    moved = _moved(regression, last)
    verdict, rivals = _verdict(effects, found, moved)
    answers = [*(effects if verdict != "unknown_effect" else ()), *faults]
    refitted = _described(given, rig, found.steps[0])
    augmented = _described(given, rig, last)
    for effect in last.effects:
        augmented = with_effect(augmented, effect)
    white = found.count > MIN_WHITE * np.count_nonzero(regression.used)
    return Diagnosis(
        verdict=verdict,
        sentence=_sentence(verdict, effects, rivals, kinds, rig, moved)
        + _closing(bool(campaign.holdout), found),
        effects=tuple(answers),
        undecided=rivals,
        experiment=deciding_experiment(
            regression, _fits_of(rivals, found), found.rest, found.count
        ),
        nothing_probability=found.shares[0],
        moved=moved,
        where=(),
        when=When((), (), ""),
        findings=findings,
        gap=_gap(campaign, found, judged),
        chi2_per_datum=1.0,
        residual_white=bool(white),
        white_p_value=float(white),
        nominal=given,
        refitted=refitted,
        augmented=augmented,
        traces=_traces(regression, found.steps, judged),
        spectra=_no_spectra(len(given.sensors)),
        surface=_surface(regression, found.steps),
        notes=_notes(campaign, found, kinds),
    )


def _moved(regression: ForceRegression, fit: ForceFit) -> dict[str, Number]:
    """Give the constants of the spring that left their tolerance."""
    spring, pulls = regression.rig.spring.id, regression.constants.pulls(fit.constants)
    names = {f"stiffness {spring}": "N/m", f"damping {spring}": "N s/m"}
    return {
        name: Number(float(fit.constants[i]), float(fit.constants_sd[i]), unit)
        for i, (name, unit) in enumerate(names.items())
        if abs(pulls[i]) > LIMITS.moved_tolerances
    }


def _fits_of(rivals: Sequence[Rival], found: _Found) -> list[ForceFit]:
    """Return the likeliest model with each of the rivals."""
    ranked = sorted(range(len(found.models)), key=lambda i: -found.shares[i])
    fits = []
    for rival in rivals:
        with_it = [i for i in ranked if rival.effect in found.models[i].names]
        fits += [found.models[i].fit for i in with_it[:1]]
    return fits


def _gap(campaign: Campaign, found: _Found, judged: Sequence[ForceRecord]) -> Gap:
    scatter = float(np.std(np.concatenate([one.force for one in judged])))
    errors, regression = found.errors, found.regression
    return Gap(
        nominal=_rms(regression.as_given(judged)) / scatter,
        refitted_nominal=errors[0],
        steps=tuple(
            GapStep(effect.kind, regression.place, error)
            for effect, error in zip(found.last.effects, errors[1:], strict=True)
        ),
        augmented=errors[-1],
        noise_floor=min(found.rest, errors[-1]),
        on="holdout" if campaign.holdout else "tail",
        worst=errors[-1],
    )


def _notes(campaign: Campaign, found: _Found, kinds: Mapping[str, Kind]) -> tuple[str, ...]:
    """Tell how the records were used, and offsets and levels that people look for."""
    regression, last = found.regression, found.last
    notes = [IMPOSED, *(() if campaign.holdout else (NO_HOLDOUT,))]
    skipped = 1 - float(np.mean(regression.used))
    if skipped > 0:
        notes.append(
            f"{percent(skipped)} of the samples were not fitted, because the element stands "
            "still or reverses there, or because its force depends on motion before the record."
        )
    notes.append(f"Constant force: {last.constants[2]:.4g} (N, or N m).")
    if last.centre_sd > 0:
        notes.append(
            f"Elongation at the middle of the law: {last.centre:.3g} ± {last.centre_sd:.2g} "
            "(m, or rad)."
        )
    if any(kinds[one.kind].family in MEMORY for one in last.effects):
        notes += _plateaus(regression, last)
    return tuple(notes)


def _plateaus(regression: ForceRegression, fit: ForceFit) -> list[str]:
    """Tell the measured level of the force of sliding in both directions, slow and fast."""
    k, _, b = fit.constants
    v = regression.linear[:, 1]
    beyond = regression.force - k * regression.linear[:, 0] - b
    slid = np.abs(regression.laws_along(fit)) > SLIDING * _size(fit)
    slid &= regression.used
    top, told = float(np.abs(v).max()), []
    for words, near in (("slower", np.abs(v) < 0.5 * top), ("faster", np.abs(v) >= 0.5 * top)):
        up, down = (beyond[slid & near & (way * v > 0)] for way in (1, -1))
        if len(up) and len(down):
            told.append(
                f"{np.median(up):+.4g} and {np.median(down):+.4g} at {words} than half of the "
                "highest speed"
            )
    if not told:
        return []
    return [
        "Force while sliding (N, or N m), in positive and in negative direction: "
        + "; ".join(told)
        + "."
    ]


def _size(fit: ForceFit) -> float:
    """Greatest force that a friction law carries [N]; infinite where it has no such number."""
    return max(
        (one.parameters.get("friction_n", math.inf) for one in fit.effects), default=math.inf
    )


def _closing(held_out: bool, found: _Found) -> str:
    on, errors = JUDGED[held_out], found.errors
    worse = (
        ""
        if found.holds
        else f" That is {errors[-1] / found.rest:.2g} times the error on the fitted samples: "
        "the law does not hold on the validation samples."
    )
    return (
        f" The error of the force on {on} is {percent(errors[-1])}; without a law "
        f"{percent(errors[0])}.{worse}"
    )


def _rms(series: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(series)) ** 2)))


def _named(
    found: _Found, number: int, given: Description, kinds: Mapping[str, Kind]
) -> NamedEffect:
    """Name one law with its numbers, its probability in all models, and what may be instead."""
    last, place = found.last, found.regression.place
    effect, kind = last.effects[number], kinds[last.effects[number].kind]
    numbers = {
        name: Number(
            value,
            last.sds[number].get(name, 0.0),
            unit_at(given, effect.place, kind.parameter(name).unit),
        )
        for name, value in effect.parameters.items()
    }
    instead: dict[str, float] = {}
    probability = 0.0
    for model, share in zip(found.models, found.shares, strict=True):
        if effect.kind in model.names:
            probability += share
        elif others := sorted(
            model.names - {one.kind for one in last.effects},
            key=lambda name: group_of(kinds[name]) != group_of(kind),
        ):
            instead[others[0]] = instead.get(others[0], 0.0) + share
    rivals = tuple(
        Rival(name, place, share)
        for name, share in sorted(instead.items(), key=lambda one: -one[1])
        if share > LIMITS.told_probability
    )
    return NamedEffect(
        effect=effect, family=kind.family, numbers=numbers,
        probability=min(probability, 1.0), rivals=rivals,
        sentence=sentence_of(kind, place, numbers),
    )  # fmt: skip


def _verdict(
    effects: Sequence[NamedEffect], found: _Found, moved: Mapping[str, Number]
) -> tuple[Verdict, tuple[Rival, ...]]:
    if found.rest > MAX_REST or not found.holds:
        return "unknown_effect", ()
    if not effects:
        return "parameters_only" if moved else "nothing_missing", ()
    for effect in sorted(effects, key=lambda one: one.probability):
        if rivals := doubts_about(effect):
            return "undecided", rivals
    return "missing_effect", ()


def _sentence(
    verdict: Verdict,
    effects: Sequence[NamedEffect],
    rivals: Sequence[Rival],
    kinds: Mapping[str, Kind],
    rig: ImposedRig,
    moved: Mapping[str, Number],
) -> str:
    if verdict == "undecided":
        names = " or ".join(kinds[one.effect].words for one in rivals)
        return (
            f"The force in {rig.spring.id} follows one of several laws, which these records "
            f"cannot tell apart: {names}."
        )
    if verdict == "unknown_effect":
        near = f" The nearest is {effects[0].sentence}" if effects else ""
        return (
            f"The force in {rig.spring.id} follows none of the laws in slowtime's "
            f"catalogue.{near}"
        )
    told = ", ".join(f"{name} = {number.text}" for name, number in moved.items())
    if verdict == "parameters_only":
        return f"No effect is missing, but constants are outside their tolerances: {told}."
    if verdict == "nothing_missing":
        return (
            f"Nothing is missing: the force in {rig.spring.id} is that of its spring and its "
            "damper."
        )
    named = " ".join(one.sentence for one in effects)
    return f"{named} Constants are outside their tolerances: {told}." if moved else named


def _described(given: Description, rig: ImposedRig, fit: ForceFit) -> Description:
    stiffness, damping, _ = fit.constants.tolist()
    return with_values(
        given,
        {("stiffness", rig.spring.id): stiffness, ("damping", rig.spring.id): damping},
    )


def _surface(regression: ForceRegression, steps: Sequence[ForceFit]) -> Surface:
    """Force beyond the spring and the damper against the motion, and the laws found."""
    k, c, b = steps[-1].constants
    e, v = regression.linear[:, 0], regression.linear[:, 1]
    rest = regression.force - k * e - c * v - b
    law = rest - steps[-1].left if len(steps) > 1 else None
    stride = max(len(e) // 5000, 1)
    return Surface(
        place=regression.place, e=e[::stride], v=v[::stride], force=rest[::stride],
        law=None if law is None else law[::stride],
    )  # fmt: skip


def _traces(
    regression: ForceRegression, steps: Sequence[ForceFit], judged: Sequence[ForceRecord]
) -> tuple[Traces, ...]:
    """Collect the measured force of each record, and that of each model."""
    given = regression.as_given(judged)
    return tuple(
        Traces(
            times_s=one.motion.times,
            measured=one.force[:, None],
            nominal=(one.force - left)[:, None],
            refitted=regression.predict(steps[0], one)[:, None],
            augmented=regression.predict(steps[-1], one)[:, None],
            of_force=True,
        )
        for one, left in zip(judged, given, strict=True)
    )


def _no_spectra(sensors: int) -> Spectra:
    nothing = np.zeros((0, sensors))
    return Spectra(np.zeros(0), nothing, nothing, nothing, nothing)
