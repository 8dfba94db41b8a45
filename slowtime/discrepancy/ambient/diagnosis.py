"""Diagnosis of a campaign without measured inputs, by its spectra."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import scipy.stats

from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.screening import Finding, screen
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Experiment,
    Gap,
    GapStep,
    NamedEffect,
    Number,
    Rival,
    Suspect,
    Verdict,
    When,
)
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import sentence_of, unit_at
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.selection.probabilities import (
    doubts_about,
    fault_of,
    probabilities,
    verdict_of,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import spectra_of, traces_of
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.plant import Plant
from slowtime.signals.spectra import detrended, transform

from .holdout import error_of_chance, fit_unseen, spectral_error
from .hypotheses import Compared, compare_effects
from .spectra import AmbientFit, fit_spectra, spectral_problem
from .time_variation import with_time_variation

TOLD_BANDS = 4
"""[bands] That a sentence names at most. Source: judgement; more cannot be taken in."""

QUIET_PERCENT = 10.0
"""[percent of the lines] That count as noise in pictures. Source: a decision."""
EXPLAINED = 0.5
"""[share of the deviance beyond noise] That a law has to explain to be named, where the spectra
still differ from it. Source: a decision: statistical linearisation leaves the rest of a strong
law."""

NAMING = ("missing_effect", "sensor_fault")
"""Verdicts that name what is missing."""

MEASURE_INPUT = Experiment(
    "Measure what drives the structure, a force or the motion of its base, and name it among "
    "the inputs of the model file: then the model can be simulated, and more effects told "
    "apart. Frequencies and damping need no input: slowtime identify."
)
ASSUMED = (
    "No input was measured. Spectra were compared, under random forces that are independent "
    "on every mass and have a smooth spectrum; a law acts on them by the equivalent stiffness "
    "and damping of its element at the level of each record (statistical linearisation). "
    "Errors are those of spectra: the root of the deviance for each degree of freedom beyond "
    "that of noise."
)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What was compared, and what of it is named.

    Parameters
    ----------
    named
        The most probable effect; None where none is probable enough.
    explained
        Share of the deviance beyond noise that its place explains.
    unseen, predicted
        Fits of the records judged on, without an effect and with the one that is named.
    """

    compared: Compared
    unseen: AmbientFit
    named: NamedEffect | None
    explained: float
    predicted: AmbientFit | None = None

    @property
    def is_refuted(self) -> bool:
        """Whether spectra that were not fitted differ more from the effect than from none."""
        if self.predicted is None:
            return False
        # Likelihood would count the error of a number of the law against its name.
        worse = self.predicted.deviance - self.unseen.deviance
        return worse > 2 * LIMITS.least_log_evidence

    @property
    def best(self) -> AmbientFit:
        """The fit that the answer rests on."""
        believed = self.named is not None and not self.is_refuted
        return self.compared.candidates[0].fit if believed else self.compared.bare

    @property
    def rivals(self) -> tuple[Rival, ...]:
        """What the answer may be; empty where it is decided."""
        return doubts_about(self.named) if self.named else ()

    @property
    def model_holds(self) -> bool:
        """Whether all spectra agree with the model without an effect."""
        least = min(self.compared.bare.p_value, self.unseen.p_value)
        return least >= LIMITS.false_alarm_p_value

    @property
    def failed_bands(self) -> tuple[tuple[float, float], ...]:
        """Bands in which the model without an effect fails."""
        return self.compared.bare.failed_bands() or self.unseen.failed_bands()

    @property
    def is_adequate(self) -> bool:
        """Whether the spectra agree with the answer, or nearly so."""
        agrees = self.best.p_value >= LIMITS.false_alarm_p_value
        return agrees or self.explained >= EXPLAINED


def diagnose_ambient(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
    monitor: Monitor | None = None,
) -> Diagnosis:
    """Name what ambient spectra lack, by how an element changes with the level of the records.

    Without measured inputs there is no free run: errors are those of spectra, each record with
    forces of its own.

    Parameters
    ----------
    kinds
        Catalogue of effects by name.
    """
    held_out = tuple(screen(trial).trial for trial in campaign.holdout)
    learnt = trials if held_out else tuple(_part(trial, 0.0, 2 / 3) for trial in trials)
    tests = held_out or tuple(_part(trial, 2 / 3, 1.0) for trial in trials)
    plant = Plant.of(campaign.description, kinds=kinds)
    problem = spectral_problem(plant, learnt)
    bare = fit_spectra(problem)
    compared = compare_effects(problem, bare, kinds, monitor or Monitor())
    if compared.candidates and compared.candidates[0].gain >= LIMITS.least_log_evidence:
        every = with_time_variation(compared.candidates, plant, learnt, kinds)
        compared = dataclasses.replace(compared, candidates=every)
    unseen = fit_unseen(plant, tests, bare.values, bare.sd, None, kinds)
    found = _chosen(compared, unseen, campaign.description, kinds)
    if found.named is not None:
        predicted = fit_unseen(
            plant, tests, found.best.values, found.best.sd, found.named.effect, kinds
        )
        found = dataclasses.replace(found, predicted=predicted)
    return _answer(campaign, plant, found, tests, findings, kinds)


def _part(trial: Trial, begin: float, end: float) -> Trial:
    count = len(trial.outputs)
    return trial.part(round(begin * count), round(end * count))


def _chosen(
    compared: Compared, unseen: AmbientFit, given: Description, kinds: Mapping[str, Kind]
) -> _Found:
    """Name the most probable effect, where it brings enough evidence."""
    candidates, bare = compared.candidates, compared.bare
    if not candidates or candidates[0].gain < LIMITS.least_log_evidence:
        return _Found(compared, unseen, None, 0.0)
    best = candidates[0]
    beyond = max(bare.deviance - bare.degrees, 1e-12)
    explained = (bare.deviance - best.fit.deviance) / beyond
    shares = probabilities([*(one.gain for one in candidates), 0.0], best.fit.misfit)
    kind = kinds[best.effect.kind]
    numbers = {
        name: Number(
            value,
            best.sds.get(name, 0.0),
            unit_at(given, best.effect.place, kind.parameter(name).unit),
        )
        for name, value in best.effect.parameters.items()
    }
    named = NamedEffect(
        effect=best.effect,
        family=kind.family,
        numbers=numbers,
        probability=shares[0],
        rivals=tuple(
            Rival(one.effect.kind, one.effect.place, share)
            for one, share in zip(candidates[1:], shares[1:-1], strict=True)
            if share > LIMITS.told_probability
        ),
        sentence=sentence_of(kind, best.effect.place, numbers),
    )
    return _Found(compared, unseen, named, float(min(explained, 1.0)))


def _answer(
    campaign: Campaign,
    plant: Plant,
    found: _Found,
    tests: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    given, seen = campaign.description, found.best
    moved = _moved_constants(seen, plant)
    faults = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    verdict, sentence = _verdict(found, moved, kinds)
    if faults and verdict in ("nothing_missing", "parameters_only"):
        verdict, sentence = verdict_of(faults, kinds), " ".join(a.sentence for a in faults)
    named = found.named if verdict in (*NAMING, "undecided") else None
    if found.is_refuted:
        named = None
    gap = _gap(campaign, plant, found, named, tests, kinds)
    refitted = _described(given, found.compared.bare)
    augmented = _described(given, seen)
    if named is not None:
        augmented = with_effect(augmented, named.effect)
        sentence += _closing(gap)
    silence = [np.zeros_like(trial.outputs) for trial in tests]
    noise = white_noise([_quiet(trial) for trial in tests])
    adequate = seen.p_value >= LIMITS.false_alarm_p_value
    return Diagnosis(
        verdict=verdict,
        sentence=f"{sentence} {MEASURE_INPUT.sentence}",
        effects=(*((named,) if named else ()), *faults),
        undecided=found.rivals if verdict == "undecided" else (),
        experiment=MEASURE_INPUT,
        nothing_probability=_nothing(found, verdict),
        moved=moved,
        where=_suspects(found),
        when=When((), _bands(found, verdict), ""),
        findings=findings,
        gap=gap,
        chi2_per_datum=seen.misfit,
        residual_white=adequate,
        white_p_value=seen.p_value,
        nominal=given,
        refitted=refitted,
        augmented=augmented,
        traces=traces_of(tests, silence, silence, silence),
        spectra=spectra_of(tests, silence, silence, noise),
        surface=None,
        notes=(ASSUMED, *_level_notes(found)),
    )


def _bands(found: _Found, verdict: Verdict) -> tuple[tuple[float, float], ...]:
    """Return bands in which the spectra differ from the answer."""
    if verdict == "unknown_effect":
        return found.failed_bands
    agrees = found.best.p_value >= LIMITS.false_alarm_p_value
    return () if agrees else found.best.failed_bands()


def _quiet(trial: Trial) -> list[float]:
    """Return densities below which few lines of each sensor are [unit²/Hz]."""
    _, spectrum = transform(detrended(trial.measured), trial.rate_hz, taper="hann")
    quiet = np.percentile(np.abs(spectrum) ** 2, QUIET_PERCENT, axis=0)
    return [max(float(one), float(np.finfo(float).tiny)) for one in quiet]


def _nothing(found: _Found, verdict: Verdict) -> float:
    """Return the probability that the model lacks nothing."""
    if found.named is not None:
        others = sum(rival.probability for rival in found.named.rivals)
        return float(max(1.0 - found.named.probability - others, 0.0))
    p_value = min(found.compared.bare.p_value, found.unseen.p_value)
    return 0.0 if verdict == "unknown_effect" else float(min(1.0, 0.5 + p_value))


def _described(given: Description, fit: AmbientFit) -> Description:
    values = zip(fit.prior.names, fit.values.tolist(), strict=True)
    return with_values(given, dict(values))


def _gap(
    campaign: Campaign,
    plant: Plant,
    found: _Found,
    named: NamedEffect | None,
    tests: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> Gap:
    """Return spectral errors of the records judged on, whose forces alone are fitted."""
    bare = found.compared.bare
    nothing = np.zeros_like(bare.values)
    as_given = fit_unseen(plant, tests, bare.prior.mean, nothing, None, kinds)
    refitted = found.unseen
    augmented = refitted
    steps: tuple[GapStep, ...] = ()
    if named is not None:
        assert found.predicted is not None
        augmented = found.predicted
        steps = (GapStep(named.effect.kind, named.effect.place, spectral_error(augmented)),)
    return Gap(
        nominal=spectral_error(as_given),
        refitted_nominal=spectral_error(refitted),
        steps=steps,
        augmented=spectral_error(augmented),
        noise_floor=error_of_chance(refitted),
        on="holdout" if campaign.holdout else "tail",
        worst=spectral_error(augmented),
    )


def _closing(gap: Gap) -> str:
    on = "the held-out record" if gap.on == "holdout" else "the last third of the records"
    return (
        f" The error of the spectra of {on} goes from {gap.refitted_nominal:.2g} to "
        f"{gap.augmented:.2g}; chance alone makes {gap.noise_floor:.2g}."
    )


def _suspects(found: _Found) -> tuple[Suspect, ...]:
    """List places by the gain of log likelihood that they promise."""
    ranked = sorted(found.compared.expected.items(), key=lambda one: -one[1])
    most = max((gain for _, gain in ranked), default=0.0)
    return tuple(
        Suspect(
            place=place,
            score=gain,
            p_value=float(scipy.stats.chi2.sf(2 * gain, found.compared.sizes[place])),
            share=found.explained * gain / most if most > 0 and found.named else 0.0,
        )
        for place, gain in ranked
    )


def _level_notes(found: _Found) -> list[str]:
    """Tell how stiffness and damping of the likeliest element change with the level."""
    if not found.compared.equivalents:
        return []
    one = found.compared.equivalents[0]
    count = len(one.motions)
    sds = np.sqrt(np.diag(one.covariance))
    told = [
        f"at {motion.size_m:.2g} m: {Number(one.values[r], sds[r], 'N/m').text} and "
        f"{Number(one.values[count + r], sds[count + r], 'N s/m').text}"
        for r, motion in sorted(enumerate(one.motions), key=lambda pair: pair[1].size_m)
    ]
    return [
        f"Equivalent stiffness and damping of {one.place} beyond those of the model, by root "
        f"mean square elongation: {'; '.join(told)}."
    ]


def _moved_constants(seen: AmbientFit, plant: Plant) -> dict[str, Number]:
    """Constants that left their tolerance, with value, sd and unit."""
    return {
        f"{name[0]} {name[1]}": Number(float(value), float(sd), plant.entries[name].unit)
        for (name, pull), value, sd in zip(
            seen.pulls.items(), seen.values, seen.sd, strict=True
        )
        if abs(pull) > LIMITS.moved_tolerances
    }


def _bands_text(bands: tuple[tuple[float, float], ...]) -> str:
    """Name bands; of many the widest, and the range of all."""
    if not bands:
        return ""
    widest = sorted(sorted(bands, key=lambda one: one[0] - one[1])[:TOLD_BANDS])
    told = " at " + ", ".join(f"{low:.3g} to {high:.3g} Hz" for low, high in widest)
    if len(bands) > TOLD_BANDS:
        more = len(bands) - TOLD_BANDS
        told += f" and {more} more bands between {bands[0][0]:.3g} and {bands[-1][1]:.3g} Hz"
    return told


def _verdict(
    found: _Found, moved: dict[str, Number], kinds: Mapping[str, Kind]
) -> tuple[Verdict, str]:
    named = found.named
    if named is not None and found.is_adequate and (found.rivals or not found.is_refuted):
        if not found.rivals:
            return verdict_of([named], kinds), named.sentence
        told = " or ".join(f"{kinds[one.effect].words} at {one.place}" for one in found.rivals)
        return "undecided", (
            "Something is missing, and spectra without a measured input cannot tell which of "
            f"these: {told}."
        )
    if not found.model_holds:
        near = f" The nearest law known here is: {named.sentence}" if named else ""
        return (
            "unknown_effect",
            f"The spectra differ from those of the model{_bands_text(found.failed_bands)}."
            f"{near}",
        )
    if moved:
        told = ", ".join(f"{name} = {n.text}" for name, n in moved.items())
        return "parameters_only", f"Constants are outside their tolerances: {told}."
    return "nothing_missing", "The spectra are those of the model, within its tolerances."
