"""Diagnosis of a campaign without measured inputs, by its spectra."""

from collections.abc import Mapping

import numpy as np

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.data.screening import Finding, screen
from slowtime.discrepancy.diagnosis import Diagnosis, Experiment, Gap, Number, Verdict, When
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.selection.probabilities import fault_of, verdict_of
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_run import (
    evaluation_trials,
    noise_floor_error,
    relative_errors,
    spectra_of,
    traces_of,
)
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.plant import Plant

from .spectra import AmbientFit, fit_ambient_spectra

TOLD_BANDS = 4
"""[bands] That a sentence names at most. Source: judgement; more cannot be taken in."""

MEASURE_INPUT = Experiment(
    "Measure what drives the structure, a force or the motion of its base, and name it among "
    "the inputs of the model file: without it the model cannot be simulated, and no effect can "
    "be named. Frequencies and damping need no input: slowtime identify."
)


def diagnose_ambient(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    """Test whether the spectra of ambient records agree with the model; name no effect.

    Without measured inputs there is no free run: errors are those of zero outputs. Constants
    that left their tolerances, and bands in which the model fails, are reported.

    Parameters
    ----------
    campaign
        Model and records.
    trials
        Screened records.
    findings
        Faults of channels.
    kinds
        Catalogue of effects by name.
    """
    plant = Plant.of(campaign.description, kinds=kinds)
    seen = fit_ambient_spectra(plant, trials)
    tests = evaluation_trials(trials, tuple(screen(trial).trial for trial in campaign.holdout))
    silence = [np.zeros_like(trial.outputs) for trial in tests]
    noise = white_noise([seen.noise_density.tolist()] * len(tests))
    error, worst = relative_errors(tests, silence), float(relative_errors(tests, silence).max())
    whole = float(error.mean())
    values = {name: float(one) for name, one in zip(seen.prior.names, seen.values, strict=True)}
    refitted = with_values(campaign.description, values)
    moved = _moved_constants(seen, plant)
    given = campaign.description
    answers = [a for f in findings if (a := fault_of(f, given, kinds)) is not None]
    missed = seen.p_value < LIMITS.false_alarm_p_value
    verdict, sentence = _verdict(seen, moved, missed)
    if answers and not missed:
        verdict, sentence = verdict_of(answers, kinds), " ".join(a.sentence for a in answers)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence + " " + MEASURE_INPUT.sentence,
        effects=tuple(answers),
        undecided=(),
        experiment=MEASURE_INPUT,
        nothing_probability=0.0 if missed else float(min(1.0, 0.5 + seen.p_value)),
        moved=moved,
        where=(),
        when=When((), seen.failed_bands(), "") if missed else When((), (), ""),
        findings=findings,
        gap=Gap(
            nominal=whole,
            refitted_nominal=whole,
            steps=(),
            augmented=whole,
            noise_floor=noise_floor_error(tests, noise),
            on="holdout" if campaign.holdout else "tail",
            worst=worst,
        ),
        chi2_per_datum=1.0,
        residual_white=not missed,
        white_p_value=seen.p_value,
        nominal=campaign.description,
        refitted=refitted,
        augmented=refitted,
        traces=traces_of(tests, silence, silence, silence),
        spectra=spectra_of(tests, silence, silence, noise),
        surface=None,
        notes=("No input was measured: only spectra were compared, under white forces.",),
    )


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


def _verdict(seen: AmbientFit, moved: dict[str, Number], missed: bool) -> tuple[Verdict, str]:
    if missed:
        return (
            "unknown_effect",
            f"The spectra differ from those of the model{_bands_text(seen.failed_bands())}.",
        )
    if moved:
        told = ", ".join(f"{name} = {n.text}" for name, n in moved.items())
        return "parameters_only", f"Constants are outside their tolerances: {told}."
    return "nothing_missing", "The spectra are those of the model, within its tolerances."
