"""Experiments that a rig allows, in order of effort, and their inputs."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import Experiment
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description, Input, Sensor, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.units import UnitOfCoordinate, unit_factor

SIMULATED_S = 12.0
"""[s] Length of the records that are simulated. Source: docs/what_decides.md: half and double
change no answer."""
RELEASES = (0.5, 0.25, 0.1, 1.5, 2.0)
"""[1] Factors on the initial state of a release, the mildest first. Source: larger amplitudes
than twice those measured are often not allowed."""
LEVELS = (0.5, 2.0, 3.0, 4.0, 0.25, 6.0, 8.0, 0.1)
"""[1] Factors on the excitation, the mildest first. Source: docs/what_decides.md: half and
double change no answer."""
BAND_MARGINS = (0.3, 1.6)
"""[1] Ends of a band that holds all modes, over the lowest and the highest of them. Source:
docs/what_decides.md: half and double change no answer."""
BLOW_PEAK = 20.0
"""[root mean squares of the measured input] Peak of a blow. Source: docs/what_decides.md: half
and double change no answer."""
MAX_FREQUENCY = 0.4
"""[share of the sampling rate] Of an excitation. Source: usual edge of an anti-aliasing
filter, 0.39 of the rate."""

UNITS: dict[UnitOfCoordinate, dict[str, str]] = {
    "m": {"acceleration": "m/s^2", "displacement": "m", "force": "N"},
    "rad": {"acceleration": "rad/s^2", "displacement": "rad", "force": "N m"},
}

Series = Float[np.ndarray, " time"]


def experiment_options(
    description: Description, trials: Sequence[Trial]
) -> list[list[Experiment]]:
    """List experiments that a rig allows, in classes of rising effort."""
    if not any(trial.inputs.any() for trial in trials):
        return [_releases(), [*_later_repeats(trials), *_added_sensors(description, None)]]
    frequencies = undamped_modes(assemble(description)).frequency_hz
    low, high = float(frequencies[0]), float(frequencies[-1])
    broad = BAND_MARGINS[0] * low, BAND_MARGINS[1] * high
    top = MAX_FREQUENCY * min(trial.rate_hz for trial in trials)
    return [
        _other_levels(),
        [*_other_excitations(low, broad, top), *_later_repeats(trials)],
        [
            *_added_sensors(description, None),
            *_added_sensors(description, broad),
            *_added_forces(description, broad),
        ],
    ]


def experiment_trial(option: Experiment, trial: Trial, description: Description) -> Trial:
    """Generate the inputs of an experiment, as strong as those that were measured.

    Outputs are zero. A release has no inputs, and is as long as the record.
    """
    released = option.excitation == "release"
    count = len(trial.inputs)
    count = count if released else min(count, int(SIMULATED_S * trial.rate_hz))
    inputs = trial.inputs[:count] * option.level
    times = np.arange(count) / trial.rate_hz
    if option.excitation is not None and not released:
        size = option.level * trial.inputs.std(axis=0)
        inputs = np.outer(_waveform(option, times), size)
    if option.add_inputs:
        # Forces of the size of those of inertia that a shaken base had made.
        masses = [node.mass_kg for node in description.nodes if node.mass_kg]
        mass = float(np.mean(masses)) if masses else 1.0
        coordinate = description.unit_of_coordinate
        size = max(
            float(column.std())
            * unit_factor(entry.unit, entry.quantity, coordinate)
            * (mass if entry.node is None else 1.0)
            for entry, column in zip(description.inputs, trial.inputs.T, strict=True)
        )
        wave = _waveform(option, times)[:, None] * size
        inputs = np.hstack([np.zeros_like(inputs), np.repeat(wave, len(option.add_inputs), 1)])
    return Trial(inputs=inputs, outputs=np.zeros((count, 1)), rate_hz=trial.rate_hz)


def _other_levels() -> list[Experiment]:
    return [
        Experiment(
            f"Repeat the strongest record at {_level_words(level)} its level.", level=level
        )
        for level in LEVELS
    ]  # fmt: skip


def _releases() -> list[Experiment]:
    return [
        Experiment(
            f"Release the structure again from {_level_words(level)} the initial "
            "displacement.",
            level=level, excitation="release",
        )
        for level in RELEASES
    ]  # fmt: skip


def _level_words(level: float) -> str:
    named = {0.5: "half", 0.25: "a quarter of", 0.1: "a tenth of"}
    return named.get(level, f"{level:g} times")


def _other_excitations(low: float, broad: tuple[float, float], top: float) -> list[Experiment]:
    """Other waveforms of the excitation, in bands about the modes [Hz]."""
    below = 0.2 * low, 0.7 * low
    options = [
        Experiment(
            f"Excite in a band from {broad[0]:.3g} to {broad[1]:.3g} Hz, which contains "
            "all modes"
            + ("." if level == 1 else f", at {_level_words(level)} the level."),
            level=level, band_hz=broad, excitation="multisine",
        )
        for level in (1.0, 0.5, 2.0, 4.0)
    ]  # fmt: skip
    options.append(
        Experiment(
            f"Excite in a band from {below[0]:.3g} to {below[1]:.3g} Hz, below all modes.",
            band_hz=below, excitation="multisine",
        )
    )  # fmt: skip
    if top > 1.5 * broad[1]:
        options += [
            Experiment(
                f"Excite in a band from {broad[0]:.3g} to {top:.3g} Hz, up to far above "
                "the modes"
                + ("." if level == 1 else f", at {_level_words(level)} the level."),
                level=level, band_hz=(broad[0], top), excitation="multisine",
            )
            for level in (1.0, 2.0)
        ]  # fmt: skip
    return [
        *options,
        Experiment(
            f"Excite with a steady sine at {low:.3g} Hz.", band_hz=(low, low), excitation="sine"
        ),
        Experiment(
            "Strike the structure once and record the free decay.",
            band_hz=broad,
            excitation="free_decay",
        ),
    ]


def _later_repeats(trials: Sequence[Trial]) -> list[Experiment]:
    """Repeat after as long again as the campaign has lasted."""
    first = min(trial.start_s for trial in trials)
    last = max(trial.start_s + trial.duration_s for trial in trials)
    start = float(math.ceil(2 * last - first))
    return [
        Experiment(
            f"Repeat the strongest record later, at campaign time {start:g} s.", start_s=start
        )
    ]


def _added_sensors(
    description: Description, band: tuple[float, float] | None
) -> list[Experiment]:
    """Additional sensors: one at a time, then accelerations everywhere."""
    units = UNITS[description.unit_of_coordinate]
    there = {(s.quantity, s.node) for s in description.sensors}
    missing = [
        Sensor(
            channel=_unused_name(f"{quantity[0].replace('d', 'x')}_{node.id}", description),
            quantity=quantity, node=node.id, unit=units[quantity],
            frame="absolute" if quantity == "acceleration" else "relative_to_base",
        )
        for quantity in ("acceleration", "displacement")
        for node in description.nodes
        if (quantity, node.id) not in there
    ]  # fmt: skip
    sets: list[tuple[Sensor, ...]] = [(sensor,) for sensor in missing]
    every = tuple(s for s in missing if s.quantity == "acceleration")
    sets += [every] if len(every) > 1 else []
    shaken = "" if band is None else f", and excite from {band[0]:.3g} to {band[1]:.3g} Hz"
    return [
        Experiment(
            f"Also measure the {_sensor_words(sensors)}{shaken}.",
            band_hz=band, excitation="multisine" if band else None, add_sensors=sensors,
        )
        for sensors in sets
    ]  # fmt: skip


def _added_forces(description: Description, band: tuple[float, float]) -> list[Experiment]:
    """Additional shakers with force cells on nodes without one."""
    unit = UNITS[description.unit_of_coordinate]["force"]
    driven = {entry.node for entry in description.inputs if entry.kind == "force"}
    return [
        Experiment(
            f"Excite only {node.id}, with a measured force from {band[0]:.3g} to "
            f"{band[1]:.3g} Hz.",
            band_hz=band, excitation="multisine",
            add_inputs=(
                Input(
                    channel=_unused_name(f"f_{node.id}", description),
                    kind="force", node=node.id, unit=unit,
                ),
            ),
        )
        for node in description.nodes
        if node.mass_kg and node.id not in driven
    ]  # fmt: skip


def _sensor_words(sensors: Sequence[Sensor]) -> str:
    words = [f"{s.quantity} of {s.node}" for s in sensors]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and the {words[-1]}"


def _unused_name(name: str, description: Description) -> str:
    taken = {entry.channel for entry in description.inputs}
    taken |= {entry.channel for entry in description.sensors}
    while name in taken:
        name += "_"
    return name


def _waveform(option: Experiment, times: Series) -> Series:
    """Waveform of unit root mean square, or of a blow; `times` in seconds."""
    assert option.band_hz is not None
    low, high = option.band_hz
    if option.excitation == "free_decay":
        length = max(int(1 / (high * (times[1] - times[0]))), 3)
        pulse = np.zeros(len(times))
        pulse[:length] = BLOW_PEAK * np.hanning(length)
        return pulse
    if option.excitation == "sine":
        return np.asarray(np.sqrt(2.0) * np.sin(2 * np.pi * low * times))
    lines = np.array(list(_lines(low, high, float(times[-1]))))
    # Schroeder (1970) phases: a low crest factor without random numbers.
    phases = -np.pi * np.arange(len(lines)) ** 2 / len(lines)
    waves = np.cos(2 * np.pi * np.multiply.outer(times, lines) + phases)
    return np.asarray(waves.sum(axis=1) * np.sqrt(2.0 / len(lines)))


def _lines(low: float, high: float, seconds: float) -> Iterable[float]:
    first = max(int(np.ceil(low * seconds)), 1)
    last = max(int(np.floor(high * seconds)), first)
    return (k / seconds for k in range(first, last + 1))
