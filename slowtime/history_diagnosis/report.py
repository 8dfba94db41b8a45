"""What a diagnosis of a history says: for people, for machines, and for the page's plots."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from .model import SlowModel
from .parameters import Parameter

Verdict = Literal[
    "missing_effect", "nothing_missing", "sensor_fault", "undecided", "unknown_effect"
]


@dataclasses.dataclass(frozen=True, slots=True)
class Alternative:
    """Another law in the place of one that was named; `covariate` where it follows one."""

    effect: str
    covariate: str | None
    probability: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """What an effect does, against what it follows (slow time, or the covariate).

    Parameters
    ----------
    x, label, unit
        Of the axis.
    value, lo, hi
        Change of the value by this effect alone, in the unit of the values, zero on average
        over the history; 95 % band.
    points
        Readings with all other effects taken away, at `points_x`.
    """

    x: Float[np.ndarray, " grid"]
    label: str
    unit: str
    value: Float[np.ndarray, " grid"]
    lo: Float[np.ndarray, " grid"]
    hi: Float[np.ndarray, " grid"]
    points_x: Float[np.ndarray, " used"]
    points: Float[np.ndarray, " used"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SlowEffect:
    """One effect that was found.

    Parameters
    ----------
    effect, family
        Its name; confusing two of one family costs less.
    covariate
        What it follows; None for time alone.
    parameters
        Its numbers.
    probability
        That this law, and no other, stands in its place.
    alternatives
        Others that might.
    sentence
        For people.
    curve
        For plots; None where it has none, as for a change of noise.
    """

    effect: str
    family: str
    covariate: str | None
    parameters: tuple[Parameter, ...]
    probability: float
    alternatives: tuple[Alternative, ...]
    sentence: str
    curve: Curve | None


@dataclasses.dataclass(frozen=True, slots=True)
class Gap:
    """How far expectation and reading are apart, before and after.

    Parameters
    ----------
    nominal, augmented
        Scatter of what is left of the readings, the constant and the effects taken away, over
        the scatter of the readings: what a forecast beyond the memory of the wandering part
        would be wrong by.
    nominal_step, augmented_step
        Error of expecting each reading from all before it, likewise.
    noise_floor
        Standard deviation of the noise of readings, likewise.
    """

    nominal: float
    augmented: float
    nominal_step: float
    augmented_step: float
    noise_floor: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The history as it was read, and what either model makes of it.

    Parameters
    ----------
    time, value, sd, used
        Readings; `used` false for outliers.
    nominal, nominal_sd, augmented, augmented_sd
        What each model expected of each reading from those before it, noise included.
    effects
        Change by each effect.
    before, after
        Residuals of either, standardised.
    """

    time: Float[np.ndarray, " time"]
    value: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    used: Bool[np.ndarray, " time"]
    nominal: Float[np.ndarray, " time"]
    nominal_sd: Float[np.ndarray, " time"]
    augmented: Float[np.ndarray, " time"]
    augmented_sd: Float[np.ndarray, " time"]
    effects: Float[np.ndarray, "effect time"]
    before: Float[np.ndarray, " time"]
    after: Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SlowReport:
    """The answer.

    Parameters
    ----------
    verdict
        One word.
    sentence
        For people.
    effects
        In the order in which they were found.
    undecided
        Names that cannot be told apart; "nothing_missing" may be one.
    experiment
        What would decide; empty where all is decided.
    nothing_probability
        That nothing more is missing.
    gap
        What adopting the effects is worth.
    residual_white, white_p_value
        Whether what remains is without memory (at 1 %).
    wander_sd, wander_length
        Of what wanders without a name, in the units of value and time; 0 for none.
    noise_factor
        By which stated standard deviations are too small (above 1) or too large.
    outliers
        Slow times of readings that were not used.
    swapped
        Those of them that lie together at one other value: another mode in the place of this.
    ignored
        Covariates that could not be used, being constant or nearly all missing.
    picture
        For plots.
    nominal, augmented
        Models to forecast with: see `adopt`.
    """

    verdict: Verdict
    sentence: str
    effects: tuple[SlowEffect, ...]
    undecided: tuple[str, ...]
    experiment: str
    nothing_probability: float
    gap: Gap
    residual_white: bool
    white_p_value: float
    wander_sd: float
    wander_length: float
    noise_factor: float
    outliers: tuple[float, ...]
    swapped: tuple[float, ...]
    ignored: tuple[str, ...]
    picture: Picture
    nominal: SlowModel
    augmented: SlowModel
