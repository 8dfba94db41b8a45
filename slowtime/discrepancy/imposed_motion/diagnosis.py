"""Diagnosis of records of imposed motion: the law of one element from its measured force."""

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.candidates.library_fit import Label
from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    NamedEffect,
    Number,
    Rival,
    Spectra,
    Surface,
    Traces,
)
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import numbers_of_effect, percent
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.report.assembly import assemble
from slowtime.discrepancy.report.outcome import CampaignOutcome, ErrorMeasure, gap_of
from slowtime.discrepancy.selection.probabilities import first_doubts, name_in_combination
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import learnt_and_unseen
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

from .experiment import deciding_experiment
from .records import ForceRecord, ImposedRig, force_record, rig_of
from .regression import ForceFit, ForceRegression
from .selection import MEMORY, ForceModel, LawComparison, compare, group_of
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
MAX_WORSE = 3.0
"""[1] Error of the force on held-out records over that of cross-validation, up to which a law
holds. Source: a decision: friction of two days differs by less."""
HELD = 0.1
"""[share of the scatter of the force] Error on held-out records below which a law holds in any
case. Source: good laws of published dampers leave as much."""
IMPOSED = "Motion was imposed and force measured: errors are relative to the measured force."
NO_HOLDOUT = "No record was held out: the error is that of the last third of each record."
FORCES = ErrorMeasure(
    " of the force", reached="as in cross-validation", alone="cross-validation left"
)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Chosen:
    """The models compared, their probabilities, and the chosen one with its predecessors.

    Parameters
    ----------
    errors
        Of each step on the records judged, over the scatter of the force.
    rest
        What the last step leaves in cross-validation, over the scatter of the force.
    """

    regression: ForceRegression
    judged: Sequence[ForceRecord]
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
    """Name the law of an element from the force that an imposed motion took."""
    given = campaign.description
    rig = rig_of(given)
    assert rig is not None
    learnt, tests = learnt_and_unseen(trials, campaign.holdout)
    records, judged = ([force_record(rig, one) for one in part] for part in (learnt, tests))
    findings = without_standstills(findings, [force_record(rig, trial) for trial in trials])
    regression = ForceRegression(rig, given.tolerance, records, kinds)
    comparison = compare(regression, given, kinds, monitor)
    found = _chosen(regression, comparison, judged, kinds)
    return assemble(given, _outcome(campaign, found, kinds), findings, kinds)


def _chosen(
    regression: ForceRegression,
    comparison: LawComparison,
    judged: Sequence[ForceRecord],
    kinds: Mapping[str, Kind],
) -> _Chosen:
    """Choose the likeliest model; its error on held-out records tempers all probabilities."""
    models = comparison.models
    scatter = _scatter(judged)
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
    return _Chosen(
        regression, judged, models, tuple(shares), tuple(steps),
        tuple(error(one) for one in steps), rest, comparison.count,
    )  # fmt: skip


def _outcome(campaign: Campaign, found: _Chosen, kinds: Mapping[str, Kind]) -> CampaignOutcome:
    given, last, regression = campaign.description, found.last, found.regression
    effects = _named(found, given, kinds)
    unknown = _unknown(found, effects)
    rivals = () if unknown else first_doubts(sorted(effects, key=lambda one: one.probability))
    rig, held_out = regression.rig, bool(campaign.holdout)
    augmented = _described(given, rig, last)
    for effect in last.effects:
        augmented = with_effect(augmented, effect)
    white = found.count > MIN_WHITE * np.count_nonzero(regression.used)
    return CampaignOutcome(
        effects=() if unknown else effects,
        undecided=rivals,
        unknown=unknown,
        moved=_moved(regression, last),
        experiment=deciding_experiment(
            regression, _fits_of(rivals, found), found.rest, found.count
        ),
        nothing_probability=found.shares[0],
        gap=gap_of(
            effects, found.errors, floor=min(found.rest, found.errors[-1]), held_out=held_out,
            nominal=_rms(regression.as_given(found.judged)) / _scatter(found.judged),
        ),
        measure=FORCES,
        chi2_per_datum=1.0,
        residual_white=bool(white),
        white_p_value=float(white),
        refitted=_described(given, rig, found.steps[0]),
        augmented=augmented,
        traces=_traces(found),
        spectra=_no_spectra(len(given.sensors)),
        surface=_surface(regression, found.steps),
        notes=_notes(found, kinds, held_out=held_out),
    )  # fmt: skip


def _named(found: _Chosen, given: Description, kinds: Mapping[str, Kind]) -> list[NamedEffect]:
    """Name each law of the chosen model, with its probability in all models."""
    last, place = found.last, found.regression.place
    own = {effect.kind for effect in last.effects}
    models = [
        ([(name, place) for name in sorted(model.names)], share)
        for model, share in zip(found.models, found.shares, strict=True)
    ]
    effects = []
    for effect, sds in zip(last.effects, last.sds, strict=True):
        kind = kinds[effect.kind]

        def instead(labels: Collection[Label], group: str = group_of(kind)) -> list[Label]:
            others = [one for one in labels if one[0] not in own]
            return sorted(others, key=lambda one: group_of(kinds[one[0]]) != group)[:1]

        numbers = numbers_of_effect(effect, sds, kind, given)
        effects.append(name_in_combination(effect, numbers, models, instead, kinds))
    return effects


def _unknown(found: _Chosen, effects: Sequence[NamedEffect]) -> str:
    """Say what no law explains; nothing where the likeliest holds."""
    if found.rest <= MAX_REST and found.holds:
        return ""
    told = (
        f"The force in {found.regression.rig.spring.id} follows none of the laws in slowtime's "
        "catalogue."
    )
    if effects:
        told += f" The nearest effect is: {effects[0].sentence}"
    if not found.holds:
        told += (
            " The likeliest model does not hold: its error on what was not fitted is "
            f"{found.errors[-1] / found.rest:.2g} times that of cross-validation."
        )
    return told


def _moved(regression: ForceRegression, fit: ForceFit) -> dict[str, Number]:
    """Give the constants of the spring that left their tolerance."""
    spring, pulls = regression.rig.spring.id, regression.constants.pulls(fit.constants)
    names = {f"stiffness {spring}": "N/m", f"damping {spring}": "N s/m"}
    return {
        name: Number(float(fit.constants[i]), float(fit.constants_sd[i]), unit)
        for i, (name, unit) in enumerate(names.items())
        if abs(pulls[i]) > LIMITS.moved_tolerances
    }


def _fits_of(rivals: Sequence[Rival], found: _Chosen) -> list[ForceFit]:
    """Return the likeliest model with each of the rivals."""
    ranked = sorted(range(len(found.models)), key=lambda i: -found.shares[i])
    fits = []
    for rival in rivals:
        with_it = [i for i in ranked if rival.effect in found.models[i].names]
        fits += [found.models[i].fit for i in with_it[:1]]
    return fits


def _notes(found: _Chosen, kinds: Mapping[str, Kind], *, held_out: bool) -> tuple[str, ...]:
    """Tell how the records were used, and offsets and levels that people look for."""
    regression, last = found.regression, found.last
    notes = [IMPOSED, *(() if held_out else (NO_HOLDOUT,))]
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


def _scatter(records: Sequence[ForceRecord]) -> float:
    """Return the standard deviation of the force of records [N]."""
    return float(np.std(np.concatenate([one.force for one in records])))


def _rms(series: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(series)) ** 2)))


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


def _traces(found: _Chosen) -> tuple[Traces, ...]:
    """Collect the measured force of each record, and that of each model."""
    regression, steps, judged = found.regression, found.steps, found.judged
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
