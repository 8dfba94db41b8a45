"""Assembly of the report from the selected terms and both models."""

from typing import Literal

import numpy as np

from slowtime.discrepancy.diagnosis import Experiment, NamedEffect, Number, Rival
from slowtime.discrepancy.report.assembly import answered
from slowtime.discrepancy.report.outcome import NOTHING, Outcome
from slowtime.dynamics.effects import Effect, Place
from slowtime.history_diagnosis.data.history import ScaledHistory
from slowtime.history_diagnosis.data.mode_swaps import ModeSwap
from slowtime.history_diagnosis.forecasting.mixture import MixtureModel
from slowtime.history_diagnosis.laws.catalogue import HistoryLaw
from slowtime.history_diagnosis.laws.terms import solve
from slowtime.history_diagnosis.selection.forward_selection import (
    ModelComparison,
    RankedLaw,
    SelectionResult,
)
from slowtime.history_diagnosis.selection.mode_departures import ModeDeparture

from . import curves, sentences
from .parameters import ReportUnits, effect_parameters
from .report import HistoryReport

Quantity = Literal["stiffness_change", "frequency_ratio", "frequency_hz"]

_SUBJECTS = {
    "stiffness_change": ("Stiffness", "%", 100.0),
    "frequency_ratio": ("Frequency", "%", 100.0),
    "frequency_hz": ("Frequency", "Hz", 1.0),
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
"""[probability] Told for a swapped mode; its least log-odds give 0.999. Source:
docs/what_decides.md: half and double change no answer."""


def summarize(
    found: SelectionResult,
    nominal: MixtureModel,
    augmented: MixtureModel,
    quantity: Quantity,
    time_unit: str,
    swap: ModeSwap | None,
    departed: ModeDeparture | None,
) -> HistoryReport:
    """Return the report of a diagnosis."""
    subject, unit, factor = _SUBJECTS[quantity]
    units = ReportUnits(unit, factor, time_unit)
    past, mask = augmented.readings.past, augmented.readings.mask
    laws = [
        _effect(comparison, augmented, place, subject, units)
        for place, comparison in enumerate(found.comparisons)
    ]
    effects = (*laws, *_sensor_faults(augmented, swap, departed, units))
    undecided = _undecided(found, past)
    unknown = any(one.effect.kind.endswith("_curved") for one in laws) and not undecided
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
    names = list(dict.fromkeys(rival.effect for rival in undecided))
    advice = sentences.suggest_experiment(names, followed, f"{past.span:.3g} {time_unit}")
    outcome = Outcome(
        effects=effects,
        undecided=undecided,
        unknown=" ".join(one.sentence for one in effects) if unknown else "",
        nothing=f"Nothing is missing: {subject.lower()} only wanders as the twin expects.",
        nothing_probability=found.last.nothing.probability,
        residual_white=p_value > _WHITE,
        white_p_value=p_value,
        experiment=Experiment(advice) if undecided else None,
    )
    used = {covariate.name for covariate in past.covariates}
    drawn = tuple(curves.effect_curve(augmented, place) for place in range(len(laws)))
    return answered(
        HistoryReport,
        outcome,
        effects,
        _words,
        curves=drawn + (None,) * (len(effects) - len(laws)),
        gap=curves.scatter_gap(nominal, augmented),
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
) -> NamedEffect:
    """Describe one selected term: its numbers, its rivals, its sentence."""
    law, past = augmented.members[0].terms[place].law, augmented.readings.past
    followed = None if law.covariate is None else past.covariates[law.covariate]
    numbers = effect_parameters(augmented.readings, augmented.members, place, units)
    ranked = comparison.by_name()
    own = (law.name, law.covariate)
    others = (one for one in ranked if one.key != own and one.probability > _RIVAL)
    return NamedEffect(
        Effect(law.name, _place(law, past)),
        law.family,
        numbers,
        sum(other.probability for other in ranked if other.key == own),
        tuple(_rival(other, past) for other in others),
        sentences.effect_sentence(law.name, subject, numbers, followed),
    )


def _place(law: HistoryLaw | RankedLaw, past: ScaledHistory) -> Place:
    if law.covariate is not None:
        return Place("covariate", past.covariates[law.covariate].name)
    return Place("sensor" if law.name == "sensor_noise" else "time", "")


def _words(rival: Rival) -> str:
    name, place = rival.effect.replace("_", " "), rival.place
    return f"{name} ({place.id})" if place.kind == "covariate" else name


def _rival(law: RankedLaw, past: ScaledHistory) -> Rival:
    return Rival(law.name, _place(law, past), law.probability)


def _sensor_faults(
    augmented: MixtureModel,
    swap: ModeSwap | None,
    departed: ModeDeparture | None,
    units: ReportUnits,
) -> list[NamedEffect]:
    """Describe a swapped mode, and a mode that departed from the others."""
    found = []
    if swap is not None:
        size = units.factor * augmented.readings.past.scale
        numbers = {
            "offset": Number(size * swap.offset, size * swap.sd, units.value),
            "share": Number(100.0 * float(swap.which.mean()), 0.0, "%"),
        }
        told = {name: sentences.number_text(number) for name, number in numbers.items()}
        sentence = (
            f"{told['share']} of the readings lie at {told['offset']} from the others: another "
            "mode is read in the place of this one."
        )
        found.append(_fault("mode_swap", "", numbers, _SWAP_PROBABILITY, sentence))
    if departed is not None:
        numbers = {
            "mode": Number(float(departed.mode), 0.0, "1"),
            "change": Number(units.factor * departed.offset, 0.0, units.value),
            "time": Number(departed.time, 0.0, units.time),
        }
        told = {name: sentences.number_text(number) for name, number in numbers.items()}
        sentence = (
            f"Mode {departed.mode} alone changes by {told['change']} at {told['time']}, the "
            "others do not: look at its sensor or tracking."
        )
        mode = f"mode {departed.mode}"
        found.append(_fault("sensor_change", mode, numbers, departed.probability, sentence))
    return found


def _fault(
    name: str, sensor: str, numbers: dict[str, Number], probability: float, sentence: str
) -> NamedEffect:
    effect = Effect(name, Place("sensor", sensor))
    return NamedEffect(effect, "sensor", numbers, probability, (), sentence)


def _undecided(found: SelectionResult, past: ScaledHistory) -> tuple[Rival, ...]:
    """Laws that are not told apart, where no family is sure or something may be missing."""
    for comparison in found.comparisons:
        families: dict[tuple[str, int | None], float] = {}
        ranked = comparison.by_name()
        for law in ranked:
            assert law.best.law is not None
            key = law.best.law.family, law.covariate
            families[key] = families.get(key, 0.0) + law.probability
        if max(families.values()) < _DECIDED:
            return tuple(_rival(r, past) for r in ranked if r.probability > _LISTED)
    nothing = found.last.nothing.probability
    if not found.comparisons and nothing < _NOTHING:
        near = [law for law in found.last.by_name() if law.probability > _LISTED]
        none = Rival(NOTHING, Place("time", ""), nothing)
        return (none, *(_rival(law, past) for law in near))
    return ()
