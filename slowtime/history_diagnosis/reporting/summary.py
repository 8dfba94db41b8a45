"""Assembly of the report from the selected terms and both models."""

from typing import Literal

import numpy as np

from slowtime.history_diagnosis.data.mode_swaps import ModeSwap
from slowtime.history_diagnosis.forecasting.mixture import MixtureModel
from slowtime.history_diagnosis.laws.terms import solve
from slowtime.history_diagnosis.selection.forward_selection import (
    ModelComparison,
    SelectionResult,
)
from slowtime.history_diagnosis.selection.mode_departures import ModeDeparture
from slowtime.identification.estimates import Measured

from . import curves, sentences
from .parameters import EffectParameter, ReportUnits, effect_parameters
from .report import Alternative, HistoryEffect, HistoryReport, HistoryVerdict

Quantity = Literal["stiffness_change", "frequency_ratio", "frequency_hz"]

_SUBJECTS = {
    "stiffness_change": ("stiffness", "%", 100.0),
    "frequency_ratio": ("frequency", "%", 100.0),
    "frequency_hz": ("frequency", "Hz", 1.0),
}
_DECIDED = 0.8
"""[probability] Of a family, from which it is named. Source: a decision of the interface."""
_LISTED = 0.05
"""[probability] Of a law, from which it is listed as undecided. Source: the same."""
_RIVAL = 0.001
"""[probability] Of a law, from which it is listed as a rival. Source: the same."""
_NOTHING = 0.5
"""[probability] That nothing is missing, below which this is not claimed. Source: the same."""
_WHITE = 0.01
"""[p-value] From which prediction errors count as uncorrelated. Source: the 1 % level."""
_SWAP_PROBABILITY = 0.99
"""[probability] Told for a swapped mode; its least log-odds give 0.999. Source: judgement."""


def summarize(
    found: SelectionResult,
    nominal: MixtureModel,
    augmented: MixtureModel,
    quantity: Quantity,
    time_unit: str,
    swap: ModeSwap | None,
    departed: ModeDeparture | None,
) -> HistoryReport:
    """Return the report of a diagnosis.

    Parameters
    ----------
    swap, departed
        Faults of sensors, if there are any.
    """
    subject, unit, factor = _SUBJECTS[quantity]
    units = ReportUnits(unit, factor, time_unit)
    past, mask = augmented.readings.past, augmented.readings.mask
    laws = [
        _effect(comparison, augmented, place, subject, units)
        for place, comparison in enumerate(found.comparisons)
    ]
    effects = (*laws, *_sensor_faults(augmented, swap, departed, units))
    undecided = _undecided(found)
    verdict = _verdict(effects, undecided)
    best = augmented.members[0]
    posterior, _ = solve(augmented.readings, best.terms, best.process)
    noise_factor = float(np.sqrt(posterior.noise_variance))
    p_value = curves.ljung_box_p_value(augmented)
    followed = {
        law.name: past.covariates[law.covariate].name
        for comparison in (*found.comparisons, found.last)
        for law in comparison.by_name()
        if law.covariate is not None
    }
    span = f"{past.span:.3g} {time_unit}"
    experiment = sentences.suggest_experiment(list(undecided), followed, span)
    used = {covariate.name for covariate in past.covariates}
    return HistoryReport(
        verdict=verdict,
        sentence=_sentence(verdict, effects, undecided, subject),
        effects=effects,
        undecided=undecided,
        experiment=experiment if undecided else "",
        nothing_probability=found.last.nothing.probability,
        gap=curves.scatter_gap(nominal, augmented),
        residual_white=p_value > _WHITE,
        white_p_value=p_value,
        wander_sd=past.scale * best.process.sd * noise_factor,
        wander_length=past.span * best.process.length if best.process.sd > 0.0 else 0.0,
        noise_factor=noise_factor,
        outliers=tuple(augmented.past.time[~mask].tolist()),
        swapped=() if swap is None else tuple(augmented.past.time[swap.which].tolist()),
        ignored=tuple(c.name for c in augmented.past.covariates if c.name not in used),
        plot_series=curves.plot_series(nominal, augmented),
        nominal=nominal,
        augmented=augmented,
    )


def _effect(
    comparison: ModelComparison,
    augmented: MixtureModel,
    place: int,
    subject: str,
    units: ReportUnits,
) -> HistoryEffect:
    """Describe one selected term: its numbers, its rivals, its sentence."""
    law = augmented.members[0].terms[place].law
    covariates = augmented.readings.past.covariates
    followed = None if law.covariate is None else covariates[law.covariate]
    numbers = effect_parameters(augmented.readings, augmented.members, place, units)
    ranked = comparison.by_name()
    own = (law.name, law.covariate)
    rivals = [
        Alternative(
            other.name,
            None if other.covariate is None else covariates[other.covariate].name,
            other.probability,
        )
        for other in ranked
        if other.key != own and other.probability > _RIVAL
    ]
    return HistoryEffect(
        law.name,
        law.family,
        None if followed is None else followed.name,
        numbers,
        sum(other.probability for other in ranked if other.key == own),
        tuple(rivals),
        sentences.effect_sentence(law.name, subject, numbers, followed),
        curves.effect_curve(augmented, place),
    )


def _sensor_faults(
    augmented: MixtureModel,
    swap: ModeSwap | None,
    departed: ModeDeparture | None,
    units: ReportUnits,
) -> list[HistoryEffect]:
    """Describe a swapped mode, and a mode that departed from the others."""
    found = []
    if swap is not None:
        size = units.factor * augmented.readings.past.scale
        offset = EffectParameter(
            "offset", Measured(size * swap.offset, size * swap.sd), units.value
        )
        share = EffectParameter("share", Measured(100.0 * float(swap.which.mean()), 0.0), "%")
        sentence = (
            f"{_parameter_text(share)} of the readings lie at {_parameter_text(offset)} "
            "from the others: another mode is read in the place of this one"
        )
        found.append(_fault("mode_swap", (offset, share), _SWAP_PROBABILITY, sentence))
    if departed is not None:
        change = Measured(units.factor * departed.offset, 0.0)
        numbers = (
            EffectParameter("mode", Measured(float(departed.mode), 0.0), "1"),
            EffectParameter("change", change, units.value),
            EffectParameter("time", Measured(departed.time, 0.0), units.time),
        )
        sentence = (
            f"mode {departed.mode} alone changes by {_parameter_text(numbers[1])} at "
            f"{_parameter_text(numbers[2])}, the others do not: look at its sensor or tracking"
        )
        found.append(_fault("sensor_change", numbers, departed.probability, sentence))
    return found


def _fault(
    name: str, numbers: tuple[EffectParameter, ...], probability: float, sentence: str
) -> HistoryEffect:
    return HistoryEffect(name, "sensor", None, numbers, probability, (), sentence, None)


def _parameter_text(number: EffectParameter) -> str:
    return sentences.format_measured(number.measured, number.unit)


def _undecided(found: SelectionResult) -> tuple[str, ...]:
    """Names that are not told apart, where no family is sure or something may be missing."""
    for comparison in found.comparisons:
        families: dict[tuple[str, int | None], float] = {}
        ranked = comparison.by_name()
        for law in ranked:
            assert law.best.law is not None
            key = law.best.law.family, law.covariate
            families[key] = families.get(key, 0.0) + law.probability
        if max(families.values()) < _DECIDED:
            return tuple(dict.fromkeys(r.name for r in ranked if r.probability > _LISTED))
    if not found.comparisons and found.last.nothing.probability < _NOTHING:
        near = [law.name for law in found.last.by_name() if law.probability > _LISTED]
        return ("nothing_missing", *dict.fromkeys(near))
    return ()


def _verdict(effects: tuple[HistoryEffect, ...], undecided: tuple[str, ...]) -> HistoryVerdict:
    if undecided:
        return "undecided"
    if not effects:
        return "nothing_missing"
    if all(effect.family == "sensor" for effect in effects):
        return "sensor_fault"
    if any(effect.effect.endswith("_curved") for effect in effects):
        return "unknown_effect"
    return "missing_effect"


def _sentence(
    verdict: HistoryVerdict,
    effects: tuple[HistoryEffect, ...],
    undecided: tuple[str, ...],
    subject: str,
) -> str:
    told = "; ".join(effect.sentence for effect in effects)
    if verdict == "nothing_missing":
        return f"Nothing is missing: {subject} only wanders as the twin expects."
    if verdict == "undecided":
        names = " or ".join(name.replace("_", " ") for name in undecided)
        return f"It cannot be decided: {names}." + (f" The likeliest: {told}." if told else "")
    return f"{told[0].upper()}{told[1:]}."
