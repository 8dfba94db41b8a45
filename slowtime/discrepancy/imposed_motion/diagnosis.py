"""Diagnosis of records of imposed motion: the law of one element from its measured force."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.screening import Finding, screen
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Gap,
    NamedEffect,
    Number,
    Rival,
    Spectra,
    Step,
    Surface,
    Traces,
    Verdict,
    When,
)
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import sentence_of
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.selection.probabilities import fault_of, probabilities
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Description, Tolerance
from slowtime.dynamics.effects import Kind

from .records import ForceRecord, ImposedRig, force_record, rig_of
from .regression import (
    ForceFit,
    ForceRegression,
    applicable_kinds,
    independent_samples,
    log_evidence,
)

TRAINED = 0.7
"""[share of a record] That laws are fitted to before they are ranked by the rest. Source: a
decision."""
MAX_LAWS = 2
"""[laws] That one element may have. Source: a decision; three fit anything."""
MIN_GAIN = 0.1
"""[share of the root mean square] By which a law has to reduce what is left. Source: a
decision: less is within what differentiated motion and a drifting transducer leave."""
MAX_REST = 0.3
"""[share of the scatter of the force] That a law which is named leaves at most. Source: laws of
published dampers leave 11 to 25 % of their measured forces."""
IMPOSED = "Motion was imposed and force measured: the error is that of the force."
JUDGED = {True: "the record it never saw", False: "the last third of the records"}
NO_HOLDOUT = "No record was held out: the error is that of the last third of each record."


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Round:
    """Fits of one more law, the likeliest first, with their probabilities."""

    fits: tuple[ForceFit, ...]
    shares: tuple[float, ...]


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
        Model of one spring, and records with the force as input.
    trials
        Screened records.
    findings
        Faults of channels.
    kinds
        Catalogue of effects by name.
    monitor
        Told the stage.
    """
    rig = rig_of(campaign.description)
    assert rig is not None
    held_out = tuple(screen(trial).trial for trial in campaign.holdout)
    learn = trials if held_out else tuple(_head(trial) for trial in trials)
    tests = held_out or tuple(_tail(trial) for trial in trials)
    regression, steps, last_round = _search(
        rig, campaign.description.tolerance, learn, kinds, monitor
    )
    judged = [force_record(rig, trial) for trial in tests]
    return _answer(campaign, rig, regression, steps, last_round, judged, findings, kinds)


def _head(trial: Trial) -> Trial:
    return trial.part(0, len(trial.outputs) * 2 // 3)


def _tail(trial: Trial) -> Trial:
    return trial.part(len(trial.outputs) * 2 // 3, len(trial.outputs))


def _search(
    rig: ImposedRig,
    tolerance: Tolerance | None,
    learn: Sequence[Trial],
    kinds: Mapping[str, Kind],
    monitor: Monitor,
) -> tuple[ForceRegression, list[ForceFit], list[_Round]]:
    """Add law after law, as long as one foretells what it was not fitted to better.

    Laws are fitted to the first part of each record and ranked by the rest; the best is then
    fitted to all of it.
    """
    cuts = [int(TRAINED * len(trial.outputs)) for trial in learn]
    heads = [force_record(rig, t.part(0, cut)) for t, cut in zip(learn, cuts, strict=True)]
    rests = [
        force_record(rig, t.part(cut, len(t.outputs)))
        for t, cut in zip(learn, cuts, strict=True)
    ]
    trained = ForceRegression(rig, tolerance, heads, kinds)
    whole = ForceRegression(rig, tolerance, [force_record(rig, t) for t in learn], kinds)
    steps, before = [whole.bare()], trained.bare()
    rounds: list[_Round] = []
    for number in range(MAX_LAWS):
        monitor(f"fitting laws to the force, {number + 1}", 0.1 + 0.4 * number)
        found = [
            one
            for kind in applicable_kinds(kinds)
            if (one := trained.with_one_more(before, kind)) is not None
            and not trained.is_at_bound(one)
        ]
        if not found:
            break
        residuals = [_residuals(trained, one, rests) for one in found]
        left = [_rms(one) for one in residuals]
        # The first parts count, too: they would do for the rest what that does for them.
        count = independent_samples(residuals[int(np.argmin(left))]) / (1 - TRAINED)
        scores = [log_evidence(one, rms, count) for one, rms in zip(found, left, strict=True)]
        order, shares = _ranked(found, scores, kinds)
        best = found[order[0]]
        known = _rms(_residuals(trained, before, rests))
        gain = scores[order[0]] - log_evidence(before, known, count)
        if gain < LIMITS.least_log_evidence or left[order[0]] > (1 - MIN_GAIN) * known:
            break
        refitted = whole.fit_from(best)
        if refitted is None:
            break
        rounds.append(_Round(tuple(found[i] for i in order), tuple(shares)))
        steps.append(refitted)
        before = best
    return whole, steps, rounds


def _ranked(
    found: Sequence[ForceFit], scores: Sequence[float], kinds: Mapping[str, Kind]
) -> tuple[list[int], list[float]]:
    """Rank fits by probability; of nested laws that explain as much, the simplest comes first.

    It takes the share of the law that contains it, as that is then the same law.
    """
    shares = probabilities(scores, 1.0)
    order = sorted(range(len(found)), key=lambda i: -scores[i])
    best = order[0]
    contained = kinds[found[best].effects[-1].kind].contains
    simpler = [
        i
        for i in order[1:]
        if found[i].effects[-1].kind in contained
        and scores[i] > scores[best] - LIMITS.least_log_evidence
    ]
    if simpler:
        first = min(simpler, key=lambda i: (found[i].numbers, -scores[i]))
        shares[first] += shares[best]
        shares[best] = 0.0
        order.remove(first)
        order.insert(0, first)
    order = [order[0], *sorted(order[1:], key=lambda i: -shares[i])]
    return order, [shares[i] for i in order]


def _residuals(
    regression: ForceRegression, fit: ForceFit, records: Sequence[ForceRecord]
) -> list[np.ndarray]:
    return [one.force - regression.predict(fit, one) for one in records]


def _answer(
    campaign: Campaign,
    rig: ImposedRig,
    regression: ForceRegression,
    steps: Sequence[ForceFit],
    rounds: Sequence[_Round],
    judged: Sequence[ForceRecord],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    given, last = campaign.description, steps[-1]
    scatter = float(np.std(np.concatenate([one.force for one in judged])))
    errors = [_rms(_residuals(regression, fit, judged)) / scatter for fit in steps]
    nominal = _rms(regression.as_given(judged)) / scatter
    effects = [
        _named(regression, steps[-1], number, one, kinds) for number, one in enumerate(rounds)
    ]
    faults = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    rest = last.rms / float(np.std(regression.force))
    verdict, rivals = _verdict(effects, rounds, rest)
    answers = [*(effects if verdict != "unknown_effect" else ()), *faults]
    refitted = _described(given, rig, steps[0])
    augmented = _described(given, rig, last)
    for effect in last.effects:
        augmented = with_effect(augmented, effect)
    correlation = max(
        abs(float(one[1:] @ one[:-1])) / max(float(one @ one), np.finfo(float).tiny)
        for one in last.residuals
    )
    return Diagnosis(
        verdict=verdict,
        sentence=_sentence(verdict, effects, rivals, kinds, rig)
        + _closing(bool(campaign.holdout), errors),
        effects=tuple(answers),
        undecided=rivals,
        experiment=None,
        nothing_probability=0.0 if rounds else 1.0,
        moved={},
        where=(),
        when=When((), (), ""),
        findings=findings,
        gap=Gap(
            nominal=nominal,
            refitted_nominal=errors[0],
            steps=tuple(
                Step(effect.kind, regression.place, error)
                for effect, error in zip(last.effects, errors[1:], strict=True)
            ),
            augmented=errors[-1],
            noise_floor=min(rest, errors[-1]),
            on="holdout" if campaign.holdout else "tail",
            worst=errors[-1],
        ),
        chi2_per_datum=1.0,
        residual_white=correlation < 0.1,
        white_p_value=1.0 if correlation < 0.1 else 0.0,
        nominal=given,
        refitted=refitted,
        augmented=augmented,
        traces=_traces(regression, steps, judged),
        spectra=_no_spectra(len(given.sensors)),
        surface=_surface(regression, steps),
        notes=(IMPOSED, *(() if campaign.holdout else (NO_HOLDOUT,))),
    )


def _closing(held_out: bool, errors: Sequence[float]) -> str:
    on = JUDGED[held_out]
    return (
        f" The error of the force on {on} is {_percent(errors[-1])}; without a law "
        f"{_percent(errors[0])}."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _rms(series: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(series)) ** 2)))


def _named(
    regression: ForceRegression,
    last: ForceFit,
    number: int,
    found: _Round,
    kinds: Mapping[str, Kind],
) -> NamedEffect:
    """Name one law with the numbers that it has in the last fit."""
    effect, kind = last.effects[number], kinds[last.effects[number].kind]
    numbers = {
        name: Number(value, last.sds[number].get(name, 0.0), kind.parameter(name).unit)
        for name, value in effect.parameters.items()
    }
    rivals = tuple(
        Rival(fit.effects[-1].kind, regression.place, share)
        for fit, share in zip(found.fits[1:], found.shares[1:], strict=True)
        if share > LIMITS.told_probability
    )
    return NamedEffect(
        effect=effect, family=kind.family, numbers=numbers, probability=found.shares[0],
        rivals=rivals, sentence=sentence_of(kind, regression.place, numbers),
    )  # fmt: skip


def _verdict(
    effects: Sequence[NamedEffect], rounds: Sequence[_Round], rest: float
) -> tuple[Verdict, tuple[Rival, ...]]:
    if rest > MAX_REST:
        return "unknown_effect", ()
    if not effects:
        return "nothing_missing", ()
    for effect, found in zip(effects, rounds, strict=True):
        if found.shares[0] < LIMITS.decided_probability:
            own = Rival(effect.effect.kind, effect.effect.place, found.shares[0])
            together, rivals = found.shares[0], [own]
            for rival in effect.rivals:
                if together >= LIMITS.undecided_mass:
                    break
                rivals.append(rival)
                together += rival.probability
            return "undecided", tuple(rivals)
    return "missing_effect", ()


def _sentence(
    verdict: Verdict,
    effects: Sequence[NamedEffect],
    rivals: Sequence[Rival],
    kinds: Mapping[str, Kind],
    rig: ImposedRig,
) -> str:
    if verdict == "undecided":
        names = " or ".join(kinds[one.effect].words for one in rivals)
        return (
            f"The force in {rig.spring.id} follows a law that these records cannot decide: "
            f"{names}."
        )
    if verdict == "unknown_effect":
        near = f" The nearest is {effects[0].sentence}" if effects else ""
        return f"The force in {rig.spring.id} follows none of the laws known here.{near}"
    if verdict == "nothing_missing":
        return f"The force in {rig.spring.id} is that of its spring and its damper."
    return " ".join(one.sentence for one in effects)


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
    law = rest - np.concatenate(steps[-1].residuals) if len(steps) > 1 else None
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
