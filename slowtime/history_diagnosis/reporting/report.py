"""Report of a diagnosis of a history: effects, probabilities, and series for plots."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import Answer
from slowtime.history_diagnosis.forecasting.mixture import MixtureModel


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class EffectCurve:
    """An effect as a function of slow time or of its covariate.

    Parameters
    ----------
    value, lo, hi
        Change of the feature by this effect alone, in the unit of the values, zero on average
        over the history; 95 % band.
    points_x, points
        Readings without all other effects.
    """

    x: Float[np.ndarray, " grid"]
    label: str
    unit: str
    value: Float[np.ndarray, " grid"]
    lo: Float[np.ndarray, " grid"]
    hi: Float[np.ndarray, " grid"]
    points_x: Float[np.ndarray, " used"]
    points: Float[np.ndarray, " used"]


@dataclasses.dataclass(frozen=True, slots=True)
class ScatterGap:
    """Scatter that remains before and after adoption, over the scatter of the readings [1].

    Parameters
    ----------
    nominal, augmented
        Scatter without constant and effects: the error of a forecast beyond the memory of the
        random process.
    nominal_step, augmented_step
        Root mean square error of predicting each reading from those before it.
    """

    nominal: float
    augmented: float
    nominal_step: float
    augmented_step: float
    noise_floor: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PlotSeries:
    """The history, and the predictions of the nominal and of the augmented model.

    Parameters
    ----------
    nominal, augmented
        Prediction of each reading by each model from those before it.
    """

    time: Float[np.ndarray, " time"]
    value: Float[np.ndarray, " time"]
    nominal: Float[np.ndarray, " time"]
    augmented: Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HistoryReport(Answer):
    """Result of `diagnose_history`.

    The place of an effect is the covariate that it follows, time, or a sensor at fault. Where
    the history does not tell whether anything is missing, "nothing_missing" is one of the
    undecided. Fields that are not told here are those of a diagnosis by records.

    Parameters
    ----------
    curves
        Of each effect, for plots; None where there is none, as for a change of noise.
    gap
        What adopting the effects is worth.
    wander_sd, wander_length
        Standard deviation and length scale of the random process, in the units of value and
        time; 0 if there is none.
    noise_factor
        Factor by which the stated standard deviations are too small (above 1) or too large.
    outliers
        Slow times of readings that were not used.
    swapped
        Those of them that belong to another mode.
    ignored
        Covariates that could not be used, being constant or mostly missing.
    plot_series
        For plots.
    nominal, augmented
        Models to forecast with; see `adopt`.
    """

    curves: tuple[EffectCurve | None, ...]
    gap: ScatterGap
    wander_sd: float
    wander_length: float
    noise_factor: float
    outliers: tuple[float, ...]
    swapped: tuple[float, ...]
    ignored: tuple[str, ...]
    plot_series: PlotSeries
    nominal: MixtureModel
    augmented: MixtureModel
