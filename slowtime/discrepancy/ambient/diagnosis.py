"""Diagnosis of a campaign without measured inputs, by its spectra."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.special import chdtrc

from slowtime.discrepancy.calibration.augmentation import with_effect
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Experiment,
    NamedEffect,
    Number,
    Rival,
    Suspect,
    When,
)
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import numbers_of_effect
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.report.assembly import assemble
from slowtime.discrepancy.report.outcome import CampaignOutcome, ErrorMeasure, gap_of
from slowtime.discrepancy.selection.probabilities import (
    doubts_about,
    name_best,
    probabilities,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import (
    learnt_and_unseen,
    spectra_of,
    traces_of,
)
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.plant import Plant
from slowtime.signals.spectra import detrended, transform

from .holdout import error_of_chance, fit_unseen, spectral_error
from .hypotheses import Compared, compare_effects
from .spectra import AmbientFit, fit_spectra, spectral_problem
from .time_variation import with_time_variation

TOLD_BANDS = 4
"""[bands] That a sentence names at most. Source: more cannot be taken in."""

QUIET_PERCENT = 10.0
"""[percent of the lines] That count as noise in pictures. Source: a decision."""
EXPLAINED = 0.5
"""[share of the deviance beyond noise] That a law has to explain to be named, where the spectra
still differ from it. Source: a decision: statistical linearisation leaves the rest of a strong
law."""

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
SPECTRA = ErrorMeasure(
    " of the spectra", "{:.2g}".format, "as chance alone makes", "chance makes"
)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Likeliest:
    """What was compared, and the likeliest effect.

    Parameters
    ----------
    likeliest
        None where no effect brings enough evidence.
    explained
        Share of the deviance beyond noise that its place explains.
    unseen, predicted
        Fits of the records judged on, without an effect and with the likeliest.
    """

    compared: Compared
    likeliest: NamedEffect | None
    explained: float
    unseen: AmbientFit
    predicted: AmbientFit

    @property
    def is_refuted(self) -> bool:
        """Whether spectra that were not fitted differ more from the effect than from none."""
        # Likelihood would count the error of a number of the law against its name.
        worse = self.predicted.deviance - self.unseen.deviance
        return worse > 2 * LIMITS.least_log_evidence

    @property
    def best(self) -> AmbientFit:
        """The fit that the answer rests on."""
        believed = self.likeliest is not None and not self.is_refuted
        return self.compared.candidates[0].fit if believed else self.compared.bare

    @property
    def agrees(self) -> bool:
        """Whether the spectra agree with that fit."""
        return self.best.p_value >= LIMITS.false_alarm_p_value

    @property
    def named(self) -> NamedEffect | None:
        """The likeliest effect, where the spectra agree with it, or nearly so."""
        adequate = self.agrees or self.explained >= EXPLAINED
        believed = adequate and (self.rivals or not self.is_refuted)
        return self.likeliest if believed else None

    @property
    def rivals(self) -> tuple[Rival, ...]:
        """What the likeliest effect may be; empty where it is decided."""
        return doubts_about(self.likeliest) if self.likeliest else ()

    @property
    def p_value(self) -> float:
        """Of the spectra in the model without an effect, fitted or not, the least."""
        return min(self.compared.bare.p_value, self.unseen.p_value)

    @property
    def unknown(self) -> str:
        """What differs where nothing is named; empty where the spectra are the model's."""
        if self.named is not None or self.p_value >= LIMITS.false_alarm_p_value:
            return ""
        near = f" The nearest effect is: {self.likeliest.sentence}" if self.likeliest else ""
        bands = _bands_text(self.failed_bands)
        return f"The spectra differ from those of the model{bands}.{near}"

    @property
    def failed_bands(self) -> tuple[tuple[float, float], ...]:
        """Bands in which the model without an effect fails."""
        return self.compared.bare.failed_bands() or self.unseen.failed_bands()


def diagnose_ambient(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
    monitor: Monitor | None = None,
) -> Diagnosis:
    """Name what ambient spectra lack: how an element changes with the level of the records."""
    # Without measured inputs there is no free run: errors are those of spectra, each record
    # with forces of its own.
    learnt, tests = learnt_and_unseen(trials, campaign.holdout)
    plant = Plant.of(campaign.description, kinds=kinds)
    problem = spectral_problem(plant, learnt)
    bare = fit_spectra(problem)
    compared = compare_effects(problem, bare, kinds, monitor or Monitor())
    if _shows_effect(compared):
        every = with_time_variation(compared.candidates, plant, learnt, kinds)
        compared = dataclasses.replace(compared, candidates=every)
    outcome = _outcome(campaign, plant, _judged(compared, plant, tests, kinds), tests, kinds)
    return assemble(campaign.description, outcome, findings, kinds)


def _shows_effect(compared: Compared) -> bool:
    candidates = compared.candidates
    return bool(candidates) and candidates[0].gain >= LIMITS.least_log_evidence


def _judged(
    compared: Compared, plant: Plant, tests: tuple[Trial, ...], kinds: Mapping[str, Kind]
) -> _Likeliest:
    """Find the likeliest effect, and predict the records judged on without it and with it."""
    candidates, bare = compared.candidates, compared.bare
    unseen = fit_unseen(plant, tests, bare.values, bare.sd, None, kinds)
    if not _shows_effect(compared):
        return _Likeliest(compared, None, 0.0, unseen, unseen)
    best = candidates[0]
    beyond = max(bare.deviance - bare.degrees, 1e-12)
    explained = (bare.deviance - best.fit.deviance) / beyond
    shares = probabilities([*(one.gain for one in candidates), 0.0], best.fit.misfit)
    effect, given = best.effect, plant.description
    numbers = numbers_of_effect(effect, best.sds, kinds[effect.kind], given)
    others = [
        Rival(one.effect.kind, one.effect.place, share)
        for one, share in zip(candidates[1:], shares[1:-1], strict=True)
    ]
    likeliest = name_best(effect, numbers, shares[0], others, kinds)
    found = _Likeliest(compared, likeliest, float(min(explained, 1.0)), unseen, unseen)
    fit = found.best
    predicted = fit_unseen(plant, tests, fit.values, fit.sd, effect, kinds)
    return dataclasses.replace(found, predicted=predicted)


def _outcome(
    campaign: Campaign,
    plant: Plant,
    found: _Likeliest,
    tests: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> CampaignOutcome:
    given, seen, bare = campaign.description, found.best, found.compared.bare
    named = None if found.is_refuted else found.named
    effects = [named] if named else []
    augmented = _described(given, seen)
    for one in effects:
        augmented = with_effect(augmented, one.effect)
    nothing = np.zeros_like(bare.values)
    as_given = fit_unseen(plant, tests, bare.prior.mean, nothing, None, kinds)
    errors = [found.unseen, *(found.predicted for _ in effects)]
    silence = [np.zeros_like(trial.outputs) for trial in tests]
    noise = white_noise([_quiet(trial) for trial in tests])
    return CampaignOutcome(
        effects=effects,
        undecided=found.rivals if found.named else (),
        unknown=found.unknown,
        moved=_moved_constants(seen, plant),
        experiment=MEASURE_INPUT,
        nothing_probability=_nothing(found),
        where=_suspects(found),
        when=When((), _bands(found), ""),
        gap=gap_of(
            effects, [spectral_error(fit) for fit in errors], nominal=spectral_error(as_given),
            floor=error_of_chance(found.unseen), held_out=bool(campaign.holdout),
        ),
        measure=SPECTRA,
        chi2_per_datum=seen.misfit,
        residual_white=found.agrees,
        white_p_value=seen.p_value,
        refitted=_described(given, bare),
        augmented=augmented,
        traces=traces_of(tests, silence, silence, silence),
        spectra=spectra_of(tests, silence, silence, noise),
        notes=(ASSUMED, *_level_notes(found)),
    )  # fmt: skip


def _bands(found: _Likeliest) -> tuple[tuple[float, float], ...]:
    """Return bands in which the spectra differ from the answer."""
    if found.unknown:
        return found.failed_bands
    return () if found.agrees else found.best.failed_bands()


def _quiet(trial: Trial) -> list[float]:
    """Return densities below which few lines of each sensor are [unit²/Hz]."""
    _, spectrum = transform(detrended(trial.measured), trial.rate_hz, taper="hann")
    quiet = np.percentile(np.abs(spectrum) ** 2, QUIET_PERCENT, axis=0)
    return [max(float(one), float(np.finfo(float).tiny)) for one in quiet]


def _nothing(found: _Likeliest) -> float:
    """Return the probability that the model lacks nothing."""
    if found.likeliest is not None:
        others = sum(rival.probability for rival in found.likeliest.rivals)
        return float(max(1.0 - found.likeliest.probability - others, 0.0))
    return 0.0 if found.unknown else float(min(1.0, 0.5 + found.p_value))


def _described(given: Description, fit: AmbientFit) -> Description:
    values = zip(fit.prior.names, fit.values.tolist(), strict=True)
    return with_values(given, dict(values))


def _suspects(found: _Likeliest) -> tuple[Suspect, ...]:
    """List places by the gain of log likelihood that they promise."""
    ranked = sorted(found.compared.expected.items(), key=lambda one: -one[1])
    most = max((gain for _, gain in ranked), default=0.0)
    return tuple(
        Suspect(
            place=place,
            score=gain,
            p_value=float(chdtrc(found.compared.sizes[place], 2 * max(gain, 0.0))),
            share=found.explained * gain / most if most > 0 and found.likeliest else 0.0,
        )
        for place, gain in ranked
    )


def _level_notes(found: _Likeliest) -> list[str]:
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
