"""Diagnosis of a history: selection of effects, and the adoption of a model."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from .data.history import Covariate, ScaledHistory, Series, checked_history, scale_history
from .data.mode_swaps import ModeSwap, find_mode_swap
from .forecasting.mixture import MixtureModel, build_model, rival_members
from .laws.catalogue import candidate_laws
from .laws.terms import ScreenedHistory
from .reporting.report import HistoryReport
from .reporting.summary import Quantity, summarize
from .selection.forward_selection import select_terms
from .selection.mode_departures import find_departure, mode_average
from .selection.outliers import covariate_residual, inlier_mask

Readouts: TypeAlias = Float[np.ndarray, " time"] | Float[np.ndarray, "time mode"]


def diagnose_history(
    slow_time: Series,
    value: Readouts,
    sd: Readouts,
    covariates: Sequence[Covariate] = (),
    *,
    quantity: Quantity = "stiffness_change",
    time_unit: str = "day",
    max_effects: int = 3,
    progress: Callable[[str, float], None] | None = None,
) -> HistoryReport:
    """Find the effects that a history of features follows and its twin lacks.

    The nominal model is a constant plus a Matérn process whose variance and length are learnt.
    Effects are added by forward selection on the marginal likelihood of the state-space model,
    coefficients integrated out and shapes penalised.

    Parameters
    ----------
    slow_time
        Of the epochs, in any order and at any distance.
    value, sd
        Relative change of stiffness [1], relative frequency [1] or frequency [Hz], with its
        stated standard deviation (which may be wrong by a common factor); NaN where missing.
        With several modes, one column each: their average is diagnosed, and whether one mode
        departs from the others.
    covariates
        Measured at the same epochs; may have gaps.
    quantity
        Which of the three the values are.
    time_unit
        Of slow time: "s", "min", "h", "day", "year", or another name for what is no time.
    max_effects
        Most effects that are added.
    progress
        Called with the stage and the share that is done.

    Returns
    -------
    The report; `adopt` returns the model with which to forecast.

    Raises
    ------
    ValueError
        If the history cannot be used; the text says what to change.

    Examples
    --------
    >>> rng = np.random.default_rng(5)
    >>> day = np.arange(200.0)
    >>> warmth = 10.0 * np.sin(day / 20.0) + rng.normal(0.0, 4.0, 200)
    >>> change = -0.001 * warmth + rng.normal(0.0, 0.002, 200)
    >>> report = diagnose_history(day, change, np.full(200, 0.002),
    ...                           [Covariate("temperature", warmth, "°C")])
    >>> report.verdict, report.effects[0].effect.kind
    ('missing_effect', 'temperature_linear')
    """
    tell = progress or (lambda stage, share: None)
    departed = None
    if value.ndim == 2 and value.shape[1] > 1:
        tell("modes", 0.0)
        departed = find_departure(slow_time, value, sd)
        if departed is not None:
            value, sd = (np.delete(each, departed.mode, axis=1) for each in (value, sd))
        value, sd = mode_average(value, sd)
    shape = (len(value),)
    past = checked_history(
        slow_time, value.reshape(shape), sd.reshape(shape), tuple(covariates)
    )
    inner = scale_history(past)
    readings, swap = _screen(inner)
    found = select_terms(readings, candidate_laws(inner, time_unit), max_effects, tell)
    nominal = build_model(past, found.readings, (), found.nominal.process)
    augmented = nominal
    if terms := found.augmented.terms:
        rivals = rival_members(found.comparisons)
        process = found.augmented.process
        augmented = build_model(past, found.readings, terms, process, nominal, rivals)
    tell("done", 1.0)
    return summarize(found, nominal, augmented, quantity, time_unit, swap, departed)


def adopt(report: HistoryReport, effects: Sequence[int] | None = None) -> MixtureModel:
    """Return the model with effects of a report.

    Parameters
    ----------
    report
        Of `diagnose_history`.
    effects
        Indices of those to adopt; None for all.

    Returns
    -------
    For `forecast` and `follow`; `undo` returns the one before.

    Raises
    ------
    ValueError
        If an index is not that of an effect.
    """
    count = len(report.effects)
    if wrong := [index for index in effects or () if not 0 <= index < count]:
        raise ValueError(
            f"Effects {wrong} were asked for, but the report holds {count}. Give indices from "
            "0, or none for all of them."
        )
    whole = report.augmented
    best = whole.members[0]
    terms = tuple(t for i, t in enumerate(best.terms) if effects is None or i in effects)
    if len(terms) == len(best.terms):
        return whole
    return build_model(whole.past, whole.readings, terms, best.process, report.nominal)


def _screen(past: ScaledHistory) -> tuple[ScreenedHistory, ModeSwap | None]:
    """Find outliers, and readings of another mode."""
    nothing, barred = np.empty((len(past.time), 0)), np.zeros(len(past.time), dtype=bool)
    mask = inlier_mask(past, nothing, barred)
    swap = find_mode_swap(covariate_residual(past, mask))
    if swap is not None:
        barred = swap.which
        mask = inlier_mask(past, nothing, barred)
    return ScreenedHistory(past, mask, past.sd**2, barred), swap
