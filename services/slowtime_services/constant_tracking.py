"""Estimation of the constants of a structure from each of its records in slow time.

Each record is filtered by itself: the joint unscented filter of motion and constants
(`slowtime.estimation.epochs`) under white forces that nobody measures.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.plant.parameter_names import Name
from slowtime.dynamics.stochastic import Springs, WhiteForce, means
from slowtime.dynamics.units import unit_factor
from slowtime.estimation.epochs import Constants, Watched, identify_epoch

from .diagnose.campaign import gather
from .diagnose.sources import Source

DEFAULT_NOISE_RATIO = 0.01
"""Sensor noise over the rms of its channel, where the model states none [1]."""

MIN_MOTION_FREQUENCY_RATIO = 0.3
"""Frequency over that of the lowest mode [1], below which accelerations tell no motion at the
start."""

READINGS_PER_PERIOD = 20.0
"""Readings per period of the fastest mode at least [1]; faster records are averaged down to
it."""

MAX_RATE_DIFFERENCE = 1e-4
"""Relative difference of the rates of two records [1], up to which one sensor has sampled both.
Source: stated tolerance of crystals, 100 ppm; frequencies are in error by as much."""

PRIOR_LOG_SD: Mapping[str, float] = {
    "stiffness": 0.3,
    "damping": 0.8,
    "mass": 0.1,
    "effect": 0.3,
}
"""Prior standard deviation of the logarithm of a constant [1], by kind, where none is given."""


INTERPOLATION_SD: Mapping[str, float] = {
    "stiffness": 3e-4,
    "damping": 3e-3,
    "mass": 1e-3,
    "effect": 2e-3,
}
"""Relative standard deviation [1] that interpolation between readings adds, by kind of
constant: measured on records of other integrators at `READINGS_PER_PERIOD` readings a
period."""


@dataclasses.dataclass(frozen=True, slots=True)
class TrackedConstants:
    """Constants of each record.

    Parameters
    ----------
    springs
        The structure with nominal values.
    constants
        Of all records, one row each.
    origins
        Name of the record of each row.
    notes
        What was assumed, in sentences.
    white
        White forces that were assumed.
    """

    springs: Springs
    constants: Constants
    origins: tuple[str, ...]
    notes: tuple[str, ...]
    white: WhiteForce


def label(name: Name) -> str:
    """Name of a constant as people write it, such as ``storey1.stiffness``."""
    what, *rest = name
    return f"{rest[0]}.{what}" if what != "effect" else f"effect{rest[0]}.{rest[1]}"


def free_names(springs: Springs, wanted: Sequence[str] | None) -> tuple[Name, ...]:
    """Constants to be estimated: those named, or all of springs, dampers and effects.

    Raises
    ------
    ValueError
        For a name that the model does not have.
    """
    may = {
        label(name): name
        for name, value in zip(springs.names, springs.values, strict=True)
        if value != 0.0
    }
    if wanted is None:
        return tuple(name for name in may.values() if name[0] != "mass")
    unknown = [name for name in wanted if name not in may]
    if unknown:
        raise ValueError(
            f"{', '.join(unknown)}: no constant of the model that could be scaled. Allowed: "
            f"{', '.join(may)}."
        )
    return tuple(may[name] for name in wanted)


def track(
    description: Description,
    sources: Sequence[Source],
    *,
    free: Sequence[str] | None = None,
    white_n: float = 0.0,
    force_sd_n: float | None = None,
    kinds: Mapping[str, Kind] | None = None,
) -> TrackedConstants:
    """Estimate the constants of a structure from each record.

    Parameters
    ----------
    description
        Point masses and springs, with inputs and acceleration sensors; its effects must be
        laws without memory.
    sources
        Records, in the order of slow time.
    free
        Names as `label` gives them; all stiffnesses, dampings and numbers of effects if None.
    white_n
        Square root of the density of white force on every node [N s^(1/2)].
    force_sd_n
        Standard deviation of the error of each measured force [N]; 1 % of its rms if None.
    kinds
        Of effects, by name; the catalogue if None.

    Raises
    ------
    ValueError
        For sensors that are no accelerometers, beams, or constants that the model lacks.
    """
    springs = Springs.of(description, kinds=kinds)
    names = free_names(springs, free)
    gathered = gather(description, sources)
    trials = gathered.campaign.trials
    rates = {trial.rate_hz for trial in trials}
    if max(rates) > (1 + MAX_RATE_DIFFERENCE) * min(rates):
        raise ValueError(
            f"Records of {', '.join(f'{r:g}' for r in sorted(rates))} Hz were given. Resample "
            "them to one rate."
        )
    accelerometers(description)
    rate_hz = trials[-1].rate_hz
    modes = undamped_modes(assemble(description)).frequency_hz
    every = max(int(rate_hz / (READINGS_PER_PERIOD * float(modes[-1]))), 1)
    white = WhiteForce(added=np.full(len(springs.nodes), white_n))
    found = [
        _of_trial(description, springs, trial, names, every, white, force_sd_n, float(modes[0]))
        for trial in trials
    ]
    notes = list(gathered.notes)
    if every > 1:
        notes.append(
            f"Readings were averaged over {every} samples: {rate_hz / every:g} Hz is "
            f"{READINGS_PER_PERIOD:g} times the fastest mode."
        )
    return TrackedConstants(springs, _together(found), gathered.origins, tuple(notes), white)


TRACKED_INPUTS = ("force", "base_acceleration")
"""Kinds of input under which constants can be tracked."""


def accelerometers(description: Description) -> None:
    """Check that every sensor is an accelerometer.

    Raises
    ------
    ValueError
        Naming the others.
    """
    others = [one.channel for one in description.sensors if one.quantity != "acceleration"]
    if others or not description.sensors:
        raise ValueError(
            f"Constants are tracked from accelerations; {', '.join(others) or 'no sensor'} "
            "is something else. Leave it out of the model's sensors."
        )
    moved = [e.channel for e in description.inputs if e.kind not in TRACKED_INPUTS]
    if moved:
        raise ValueError(
            "Constants are tracked only under inputs of kind "
            f"{' and '.join(TRACKED_INPUTS)}, not under {', '.join(moved)}. Use `slowtime "
            "diagnose`, or convert the motion of the base to a base_acceleration."
        )


def _of_trial(
    description: Description,
    springs: Springs,
    trial: Trial,
    names: tuple[Name, ...],
    every: int,
    white: WhiteForce,
    force_sd_n: float | None,
    lowest_hz: float,
) -> Constants:
    structure = assemble(description)
    unit = description.unit_of_coordinate
    force = np.zeros((len(trial.inputs), structure.dofs))
    base = np.zeros(len(trial.inputs))
    for column, entry in zip(trial.inputs.T, description.inputs, strict=True):
        quantity = entry.quantity
        values = column * unit_factor(entry.unit, quantity, unit)
        if entry.kind == "force":
            assert entry.node is not None
            force[:, structure.dof(entry.node)] += values
        else:
            base = base + values
            force += structure.base_force(values)
    readings, sds = [], []
    for column, sensor in zip(trial.outputs.T, description.sensors, strict=True):
        worth = unit_factor(sensor.unit, sensor.quantity, unit)
        values = column * worth - (base if sensor.frame == "absolute" else 0.0)
        readings.append(values)
        noise = sensor.noise_sd
        rms = float(np.sqrt(np.nanmean(values**2)))
        # The mean of two readings, then of `every` intervals, scatters less than one reading.
        sds.append(
            (DEFAULT_NOISE_RATIO * rms if noise is None else noise * worth) / math.sqrt(every)
        )
    seen = _interval_means(np.stack(readings, axis=1), every)
    pushed = _interval_ends(force, every)
    still = np.repeat(
        _motion(
            np.stack(readings, axis=1), trial.rate_hz, MIN_MOTION_FREQUENCY_RATIO * lowest_hz
        ),
        structure.dofs,
    )
    rms_force = np.sqrt(np.mean(force**2, axis=0))
    force_sd = np.where(rms_force > 0.0, 0.01 * rms_force, 0.0)
    if force_sd_n is not None:
        force_sd = np.where(rms_force > 0.0, force_sd_n, 0.0)
    watched = Watched(
        springs=springs,
        free=names,
        log_sd=np.array([PRIOR_LOG_SD[name[0]] for name in names]),
        step_s=every / trial.rate_hz,
        white=white,
        force_sd=np.maximum(force_sd, 1e-9 * max(float(rms_force.max()), 1.0)),
        sensors=np.array([structure.dof(sensor.node) for sensor in description.sensors]),
        reading_sd=np.array(sds),
        start_sd=still,
        substeps=2,
    )
    return identify_epoch(watched, seen[:, None], pushed[:, None])


def _interval_ends(
    force: Float[np.ndarray, "time node"], every: int
) -> Float[np.ndarray, "interval end"]:
    """Fit a straight line to each interval of `every` steps; give its ends, beginnings first.

    The line has the mean and the least-squares slope of the samples, straight between.
    """
    count = (len(force) - 1) // every
    rows = np.arange(count)[:, None] * every + np.arange(every + 1)
    within = force[rows]
    offset = np.arange(every + 1) - 0.5 * every
    slope = np.einsum("t,itn->in", offset, within) / (offset @ offset)
    mean = means(force, every)
    half = 0.5 * every * slope
    return np.concatenate([mean - half, mean + half], axis=1)


def _interval_means(
    readings: Float[np.ndarray, "time sensor"], every: int
) -> Float[np.ndarray, "interval sensor"]:
    r"""Means over intervals of `every` steps of a smooth signal.

    Cubic between samples: the mean over a step is
    :math:`(-a_{k-1} + 13 a_k + 13 a_{k+1} - a_{k+2}) / 24`. Straight lines would take 1 % off
    what has 18 samples a period.
    """
    step = 0.5 * (readings[1:] + readings[:-1])
    step[1:-1] += (readings[1:-2] + readings[2:-1] - readings[:-3] - readings[3:]) / 24.0
    count = len(step) // every
    return np.asarray(step[: count * every].reshape(count, every, -1).mean(axis=1))


def _motion(
    readings: Float[np.ndarray, "time sensor"], rate_hz: float, from_hz: float
) -> tuple[float, float]:
    """Largest rms displacement [m] and velocity [m/s] of the sensors, above a frequency."""
    spectrum = np.fft.rfft(np.nan_to_num(readings), axis=0)
    hz = np.fft.rfftfreq(len(readings), 1.0 / rate_hz)
    heard = hz >= from_hz
    omega = 2.0 * np.pi * hz[heard, None]
    found = []
    for power in (2, 1):
        square = np.sum(np.abs(spectrum[heard] / omega**power) ** 2, axis=0)
        found.append(float(np.sqrt(2.0 * square.max()) / len(readings)))
    return found[0], found[1]


def _together(found: Sequence[Constants]) -> Constants:
    """Constants of all records in one, a row each."""
    first = found[0]

    def joined(what: str) -> Float[np.ndarray, "..."]:
        return np.concatenate([getattr(one, what) for one in found], axis=0)

    added = np.diag([INTERPOLATION_SD[name[0]] ** 2 for name in first.names])
    return dataclasses.replace(
        first,
        prior_log_ratio=joined("prior_log_ratio"),
        log_ratio=joined("log_ratio"),
        log_covariance=joined("log_covariance") + added,
        log_likelihood=joined("log_likelihood"),
        surprise=joined("surprise"),
    )
