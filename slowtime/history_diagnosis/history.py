"""A history as it is given, checked and put in order; and in units of its own, to work in."""

import dataclasses
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from slowtime.estimation import hyperparameters, matern

Role = Literal["temperature", "load", "vibration", "other"]
Series: TypeAlias = Float[np.ndarray, " time"]

FEWEST = 20
_KNOTS = 400  # readings of a covariate from which its gaps are learnt to be filled
_HINTS: tuple[tuple[str, Role], ...] = (
    ("temp", "temperature"),
    ("°c", "temperature"),
    ("load", "load"),
    ("weight", "load"),
    ("traffic", "load"),
    ("vibration", "vibration"),
    ("level", "vibration"),
    ("rms", "vibration"),
    ("amplitude", "vibration"),
)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Covariate:
    """What was read beside the value at each epoch, and might drive it.

    Parameters
    ----------
    name, unit
        For people.
    values
        One for each epoch; NaN where missing.
    role
        What it is: decides which laws are tried. Left out, it is guessed from name and unit.
    """

    name: str
    values: Series
    unit: str = ""
    role: Role | None = None

    @property
    def meaning(self) -> Role:
        """The role, guessed where it was not given."""
        if self.role is not None:
            return self.role
        text = f"{self.name} {self.unit}".lower()
        return next((role for hint, role in _HINTS if hint in text), "other")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class History:
    """Epochs in ascending order of time, all with a value.

    Parameters
    ----------
    time, value, sd
        Slow times, values and their stated standard deviations.
    covariates
        Of the same epochs.
    """

    time: Series
    value: Series
    sd: Series
    covariates: tuple[Covariate, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Filled:
    """A covariate without gaps, scaled to zero mean and unit spread.

    Parameters
    ----------
    values
        As scaled; smoothed across gaps.
    sd
        What a filled value may be wrong by; 0 where it was read.
    centre, scale
        ``covariate = centre + scale * values``.
    """

    name: str
    unit: str
    role: Role
    values: Series
    sd: Series
    centre: float
    scale: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """A history with time from 0 to 1, and values of zero median and unit spread.

    Parameters
    ----------
    time, value, sd
        As scaled.
    covariates
        Filled and scaled.
    start, span
        ``time in its unit = start + span * time``.
    centre, scale
        ``value in its unit = centre + scale * value``.
    gap
        Typical step from epoch to epoch, scaled.
    """

    time: Series
    value: Series
    sd: Series
    covariates: tuple[Filled, ...]
    start: float
    span: float
    centre: float
    scale: float
    gap: float


def history(
    slow_time: Series,
    value: Series,
    sd: Series,
    covariates: tuple[Covariate, ...] = (),
    *,
    fewest: int = FEWEST,
) -> History:
    """Check readings, pass over those that are not finite, and put the rest in order."""
    lengths = {"value": len(value), "sd": len(sd)}
    lengths |= {f"covariate {c.name!r}": len(c.values) for c in covariates}
    wrong = {name: length for name, length in lengths.items() if length != len(slow_time)}
    if wrong:
        raise ValueError(
            f"{len(slow_time)} slow times were given, but {wrong}. Give one entry for each "
            "epoch, NaN where it is missing."
        )
    names = [c.name for c in covariates]
    if len(set(names)) < len(names):
        raise ValueError(f"Covariates are named {names}. Give each a name of its own.")
    fine = np.isfinite(slow_time) & np.isfinite(value) & np.isfinite(sd) & (sd >= 0.0)
    if fine.sum() < fewest or (fewest > 1 and np.ptp(slow_time[fine]) <= 0.0):
        raise ValueError(
            f"{int(fine.sum())} of {len(value)} epochs have a time, a value and a standard "
            f"deviation that is not negative. At least {fewest} at different times are needed; "
            "wait for more epochs."
        )
    order = np.flatnonzero(fine)[np.argsort(slow_time[fine], kind="stable")]
    if not sd[order].any() and fewest > 1:
        raise ValueError(
            "Every standard deviation is 0, so nothing could be called noise. Give that of "
            "each value, as the identification states it."
        )
    return History(
        slow_time[order],
        value[order],
        sd[order],
        tuple(dataclasses.replace(c, values=c.values[order]) for c in covariates),
    )


def scaled(past: History) -> Scaled:
    """Put a history in units of its own."""
    start, span = float(past.time[0]), float(past.time[-1] - past.time[0])
    centre = float(np.median(past.value))
    away = np.abs(past.value - centre)
    kept = past.value[away <= 6.0 * 1.4826 * max(float(np.median(away)), 1e-300)]
    scale = max(float(np.std(kept)), float(np.median(past.sd)), 1e-300)
    time = (past.time - start) / span
    steps = np.diff(time)
    sd = past.sd / scale
    return Scaled(
        time,
        (past.value - centre) / scale,
        np.maximum(sd, 1e-3 * float(np.median(sd[sd > 0.0]))),
        tuple(filled(time, c) for c in past.covariates if np.ptp(_known(c)) > 0.0),
        start,
        span,
        centre,
        scale,
        float(np.median(steps[steps > 0.0])),
    )


def filled(time: Series, covariate: Covariate) -> Filled:
    """Scale a covariate and fill its gaps, saying how well.

    A gap is filled with what a Matérn process, learnt from the covariate itself, expects there.
    """
    known = np.isfinite(covariate.values)
    centre, scale = float(covariate.values[known].mean()), float(covariate.values[known].std())
    values = (covariate.values - centre) / scale
    sd = np.zeros(len(values))
    if not known.all():
        every = max(1, int(known.sum()) // _KNOTS)
        learnt = np.flatnonzero(known)[::every]
        process = hyperparameters.fit(
            time[learnt], values[learnt], np.full(len(learnt), 0.02), smoothness=0.5
        ).process
        smooth = matern.smooth(process, time, values, np.full(len(values), 0.02))
        values = np.where(known, values, smooth.mean)
        sd = np.where(known, 0.0, np.minimum(smooth.sd, 1.0))
    return Filled(covariate.name, covariate.unit, covariate.meaning, values, sd, centre, scale)


def _known(covariate: Covariate) -> Float[np.ndarray, " known"]:
    known = covariate.values[np.isfinite(covariate.values)]
    return known if len(known) >= FEWEST // 2 else np.zeros(1)


def used(mask: Bool[np.ndarray, " time"], variance: Series) -> Series:
    """Variances, infinite where a reading is not to be used."""
    return np.where(mask, variance, np.inf)
