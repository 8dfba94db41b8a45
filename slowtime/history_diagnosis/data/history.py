"""Histories of a feature and its covariates: checked, sorted and scaled."""

import dataclasses
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.estimation import filtering, hyperparameters

Role = Literal["temperature", "load", "vibration", "other"]
Series: TypeAlias = Float[np.ndarray, " time"]

FEWEST_EPOCHS = 20
"""[epochs] Fewest from which a history is diagnosed. Source: docs/what_decides.md: half and
double change no answer."""
_FILL_READINGS = 400
"""[readings] Of a covariate, from which the process that fills its gaps is learnt. Source: a
bound on computing time."""
_FILL_NOISE_SD = 0.02
"""[standard deviations of the covariate] Noise assumed of it then. Source:
docs/what_decides.md: half and double change no answer."""
_ROLE_HINTS: tuple[tuple[str, Role], ...] = (
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
    """A quantity measured at each epoch that may drive the feature.

    Parameters
    ----------
    name, unit
        As shown in the report.
    values
        One for each epoch, in `unit`; NaN where missing.
    role
        Decides which laws are tried; guessed from name and unit if None.
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
        return next((role for hint, role in _ROLE_HINTS if hint in text), "other")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FeatureHistory:
    """Epochs in ascending order of time, each with a finite value.

    Parameters
    ----------
    time, value, sd
        Slow times, values and their stated standard deviations, in the user's units.
    covariates
        At the same epochs.
    """

    time: Series
    value: Series
    sd: Series
    covariates: tuple[Covariate, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FilledCovariate:
    """A covariate without gaps, scaled to zero mean and unit standard deviation.

    Parameters
    ----------
    values
        Scaled values [1]; interpolated where they were missing.
    sd
        Standard deviation of the interpolated values [1]; 0 where they were measured.
    """

    name: str
    unit: str
    role: Role
    values: Series
    sd: Series
    centre: float
    scale: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ScaledHistory:
    """A history with time from 0 to 1 and values of zero median and unit scatter.

    Parameters
    ----------
    time, value, sd
        Scaled [1].
    start, span
        ``slow time = start + span * time``, in the unit of slow time.
    centre, scale
        ``value in its unit = centre + scale * value``.
    gap
        Median step between epochs, scaled [1].
    """

    time: Series
    value: Series
    sd: Series
    covariates: tuple[FilledCovariate, ...]
    start: float
    span: float
    centre: float
    scale: float
    gap: float

    @property
    def steps(self) -> Series:
        """Time since the epoch before; 0 at the first [1]."""
        return np.diff(self.time, prepend=self.time[0])


def checked_history(
    slow_time: Series,
    value: Series,
    sd: Series,
    covariates: tuple[Covariate, ...] = (),
    *,
    fewest: int = FEWEST_EPOCHS,
) -> FeatureHistory:
    """Check a history, drop epochs that are not finite, and sort the others by time.

    Raises `ValueError` if lengths differ, names repeat, too few epochs are usable, or no
    standard deviation is positive.
    """
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
    return FeatureHistory(
        slow_time[order],
        value[order],
        sd[order],
        tuple(dataclasses.replace(c, values=c.values[order]) for c in covariates),
    )


def scale_history(past: FeatureHistory) -> ScaledHistory:
    """Scale time, values and covariates; drop those that are constant or mostly missing."""
    start, span = float(past.time[0]), float(past.time[-1] - past.time[0])
    centre = float(np.median(past.value))
    # Values beyond six robust standard deviations do not count for the scale.
    away = np.abs(past.value - centre)
    kept = past.value[away <= 6.0 * 1.4826 * max(float(np.median(away)), 1e-300)]
    scale = max(float(np.std(kept)), float(np.median(past.sd)), 1e-300)
    time = (past.time - start) / span
    steps = np.diff(time)
    sd = past.sd / scale
    return ScaledHistory(
        time,
        (past.value - centre) / scale,
        np.maximum(sd, 1e-3 * float(np.median(sd[sd > 0.0]))),
        tuple(fill_covariate(time, c) for c in past.covariates if _varies(c)),
        start,
        span,
        centre,
        scale,
        float(np.median(steps[steps > 0.0])),
    )


def fill_covariate(time: Series, covariate: Covariate) -> FilledCovariate:
    """Scale a covariate and fill its gaps by Gaussian-process regression on itself.

    It has at least one finite value; times are scaled [1] and ascending.
    """
    known = np.isfinite(covariate.values)
    centre, scale = float(covariate.values[known].mean()), float(covariate.values[known].std())
    values = (covariate.values - centre) / scale
    sd = np.zeros(len(values))
    if not known.all():
        every = max(1, int(known.sum()) // _FILL_READINGS)
        learnt = np.flatnonzero(known)[::every]
        noise_sd = np.full(len(values), _FILL_NOISE_SD)
        process = hyperparameters.fit(
            time[learnt], values[learnt], noise_sd[learnt], smoothness=0.5
        ).process
        smooth = filtering.smooth(process, time, values, noise_sd)
        values = np.where(known, values, smooth.mean)
        sd = np.where(known, 0.0, np.minimum(smooth.sd, 1.0))
    return FilledCovariate(
        covariate.name, covariate.unit, covariate.meaning, values, sd, centre, scale
    )


def _varies(covariate: Covariate) -> bool:
    known = covariate.values[np.isfinite(covariate.values)]
    return len(known) >= FEWEST_EPOCHS // 2 and float(np.ptp(known)) > 0.0
