"""Checks that records can be what the model says they are, before the diagnosis.

A factor of a thousand between what a channel says and what the model makes of the inputs is no
effect that was forgotten: it is a unit, a wire, or a column.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration.prior import prior_of
from slowtime.discrepancy.imposed_motion.records import clock_errors, is_imposed, rig_of
from slowtime.discrepancy.large_models import is_large, reasons_against, reduce_plainly
from slowtime.discrepancy.records import MIN_SAMPLES, Campaign, Trial
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.effects import Kind, catalogue
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.plant import Plant
from slowtime_services.files import RecordError

from .channel_swaps import refuse_swaps

MAX_SIZE_RATIO = 200.0
"""Measured over simulated rms of a channel [1], or its inverse, beyond which only a wrong unit
or a broken wire explains it."""
RIGID_FREQUENCY_RATIO = 1e-6
"""Frequency over the highest natural frequency [1] below which a motion is no vibration."""
PLAUSIBLE_SIZE_RATIO = 20.0
"""Ratio of measured and simulated rms [1] to which an exchange must bring all channels, to be
told."""
FOLLOWED_ERROR = 0.9
"""Scatter of measured less simulated over that of the measured [1] below which a slow record
may confirm its clock. Source: a model that says nothing leaves 1."""
OTHER_CLOCKS = (60.0, 1e3, 1e6)
"""Samples per second over those as read [1], where a clock counts minutes or thousandths or
millionths of a second."""
BETTER_CLOCK = 0.8
"""Error with the clock as read over that with any other [1] up to which it is the better one.
Source: judgement; motion far below resonance gives about 0.1."""
STACKS = 40
"""[1] Matrices over states and states, one for each constant that may be off, that a fit holds
at once. Source: 21 GB of 200 coordinates and 400 constants."""
MOST_BYTES = 8 * 2**30
"""[bytes] Of these. Source: half of what a machine with 16 GB has."""
ANYWAY = "If this is correct, skip this check with --setting unchecked=yes."

Sizes = Float[np.ndarray, " sensor"]


def refuse_large_models(model: Description, kinds: Mapping[str, Kind] | None = None) -> None:
    """Refuse a model whose fits would take more memory than machines have.

    One that can be reduced to the band of its records is not refused
    (`slowtime.discrepancy.large_models`), nor is one with few constants that may be off.

    Raises
    ------
    RecordError
        Saying how much that would be, why it cannot be reduced, and what to do.
    """
    reason = reasons_against(model)
    if not reason:
        return
    constants = len(prior_of(Plant.of(model, kinds=kinds)).names)
    coordinates = len(model.dofs)
    size = STACKS * (1 + constants) * (2 * coordinates) ** 2 * 8
    if size > MOST_BYTES:
        raise RecordError(
            f"A model of {coordinates} coordinates of which {constants} constants may be off "
            f"takes about {size / 2**30:.0f} GB to fit; at most {MOST_BYTES / 2**30:.0f} GB "
            "are allowed. Models are reduced to the band of their records, but not with "
            f"{reason}. Reduce it with `slowtime model reduce`, join nodes, or state a "
            "tolerance of 0 for constants that are known."
        )


def refuse_nonsense(
    campaign: Campaign, names: Sequence[str], kinds: Mapping[str, Kind] | None = None
) -> None:
    """Refuse inputs that never change, and sizes that no structure could make of them.

    Parameters
    ----------
    names
        What to call each trial to learn from.

    Raises
    ------
    RecordError
        Saying which channel, by how much, and what it looks like.
    """
    model = campaign.description
    if campaign.ambient:
        return
    if is_large(model) and not reasons_against(model):
        # Fits of the whole model would take hours; the reduced one has its inputs and sensors.
        first = campaign.trials[:1]
        known = catalogue() if kinds is None else kinds
        try:
            reduced = reduce_plainly(model, first, known)
        except ValueError as error:
            raise RecordError(str(error)) from error
        refuse_nonsense(dataclasses.replace(campaign, description=reduced.small), names, kinds)
        return
    imposed = is_imposed(model, campaign.trials)
    if imposed and all(entry.kind.startswith("imposed_") for entry in model.inputs):
        return  # laws are fitted to force and motion directly, so that any rate will do
    plant = Plant.of(model, kinds=kinds)
    for trial, name in zip(campaign.trials, names, strict=True):
        if float(np.ptp(trial.inputs, axis=0).max()) == 0.0:
            if float(np.ptp(trial.measured, axis=0).max()) > 0.0 and _struck(trial):
                continue
            channels = ", ".join(repr(entry.channel) for entry in model.inputs)
            raise RecordError(
                f"{name}: input {channels} never changes, while the structure moves. Was it "
                "recorded? A structure that rings by itself dies away, and this does not. "
                f"Remove the input from the model if it was not measured. {ANYWAY}"
            )
        _refuse_slow(model, trial, plant, name)
        if not imposed:
            _refuse_sizes(model, trial, plant, name)
    refuse_swaps(campaign, plant, " and ".join(dict.fromkeys(names)), ANYWAY)


def _struck(trial: Trial) -> bool:
    """Whether the motion dies away, as it does where it was let go."""
    half = len(trial.measured) // 2
    early, late = trial.measured[:half].std(axis=0), trial.measured[half:].std(axis=0)
    return bool(np.all(late <= early))


def _refuse_slow(model: Description, trial: Trial, plant: Plant, name: str) -> None:
    """Refuse a rate at which not even the slowest vibration could be followed.

    A structure that is moved slowly follows its inputs without vibrating: where the model says
    more of what was measured with this clock than with others, the clock is right.
    """
    if not model.dofs:
        return
    frequency = undamped_modes(assemble(model)).frequency_hz
    own = frequency[frequency > RIGID_FREQUENCY_RATIO * frequency[-1]]
    slow = len(own) > 0 and trial.rate_hz < 2 * own[0]
    if slow and not _is_followed(model, plant, trial):
        raise RecordError(
            f"{name} has {trial.rate_hz:.4g} samples per second, which show vibration up to "
            f"{trial.rate_hz / 2:.4g} Hz only, and the lowest natural frequency of the model "
            f"is {own[0]:.4g} Hz. Check the units of the model (N, kg, m) and the clock of "
            "the record: where it does not count seconds, name the unit in the head of the "
            "column, such as t_ms, or give --rate-hz. If both are right, --setting "
            "unchecked=yes diagnoses the record all the same."
        )


def _is_followed(model: Description, plant: Plant, trial: Trial) -> bool:
    """Whether the clock as it was read is the right one for a motion below all resonances.

    The model explains what was measured, and best with that clock; or any spring and damper
    explain the force of an imposed motion, whose inertia no other clock shows.
    """
    measured = _sizes(trial.outputs, trial)
    if not (measured > 0).all():
        return False

    def error(clock: float) -> float:
        with np.errstate(all="ignore"):
            made = plant.simulate(plant.values, trial.inputs, clock * trial.rate_hz)
        return float((_sizes(trial.outputs - made, trial) / measured).max())

    own = error(1.0)
    if own < FOLLOWED_ERROR and own < BETTER_CLOCK * min(map(error, OTHER_CLOCKS)):
        return True
    return _is_imposed_by(model, trial)


def _is_imposed_by(model: Description, trial: Trial) -> bool:
    """Whether the force follows the motion without inertia, and with no other clock better."""
    rig = rig_of(model)
    if rig is None or rig.driven is not None or not is_imposed(model, [trial]):
        return False
    own, *others = clock_errors(rig, trial, (1.0, *OTHER_CLOCKS))
    return bool(own < FOLLOWED_ERROR and min(others) > BETTER_CLOCK * own)


def _refuse_sizes(model: Description, trial: Trial, plant: Plant, name: str) -> None:
    measured = _sizes(trial.outputs, trial)
    with np.errstate(all="ignore"):
        made = _sizes(plant.simulate(plant.values, trial.inputs, trial.rate_hz), trial)
    if not (np.isfinite(made).all() and (made > 0).all() and (measured > 0).any()):
        return
    heard = measured > 0
    ratio = np.where(heard, measured, made) / made
    off = (ratio > MAX_SIZE_RATIO) | (ratio < 1 / MAX_SIZE_RATIO)
    if not off.any():
        return
    channels = [sensor.channel for sensor in model.sensors]
    told = ", ".join(
        f"{channel} is {_times(float(r))}"
        for channel, r, bad in zip(channels, ratio, off, strict=True)
        if bad
    )
    raise RecordError(
        f"{name}: {told} what the model makes of the inputs, which no effect explains. "
        f"{_guess(model, measured, made, ratio, heard)} {ANYWAY}"
    )


def _guess(model: Description, measured: Sizes, made: Sizes, ratio: Sizes, heard: Sizes) -> str:
    """Return the likely cause: exchanged sensors, a unit of the inputs, or of one sensor."""
    sensors = model.sensors
    for i, j in itertools.combinations(range(len(sensors)), 2):
        swapped = measured.copy()
        swapped[[i, j]] = measured[[j, i]]
        again = np.where(heard, swapped, made) / made
        if np.all(np.abs(np.log(again)) < np.log(PLAUSIBLE_SIZE_RATIO)):
            one, other = sensors[i].channel, sensors[j].channel
            return (
                f"With {one} and {other} exchanged, the record would fit. If they are "
                f"swapped, give --channel {one}={other} --channel {other}={one}."
            )
    factor = float(np.exp(np.mean(np.log(ratio))))
    alike = bool(np.all(np.abs(np.log(ratio / factor)) < np.log(PLAUSIBLE_SIZE_RATIO)))
    if alike and len(sensors) > 1:
        units = ", ".join(f"{entry.channel} [{entry.unit}]" for entry in model.inputs)
        return f"All sensors are, alike: look at the unit of the inputs, {units}."
    worst = int(np.argmax(np.abs(np.log(ratio))))
    sensor, power = sensors[worst], 10.0 ** (3 * round(float(np.log10(ratio[worst])) / 3))
    return (
        f"Look at the unit of {sensor.channel}, {sensor.unit} in the model: if its numbers in "
        f"the record are {_times(power)} that, say "
        f"--channel {sensor.channel}={sensor.channel}/{power:g}."
    )


def _times(ratio: float) -> str:
    return f"{ratio:.4g} times" if ratio >= 1 else f"1/{round(1 / ratio):,} of"


def _sizes(series: Float[np.ndarray, "time sensor"], trial: Trial) -> Sizes:
    """Scatter of each sensor over the samples to be believed; 0 where there are too few."""
    return np.array(
        [
            float(np.std(column[use])) if use.sum() >= MIN_SAMPLES else 0.0
            for column, use in zip(series.T, trial.used.T, strict=True)
        ]
    )
