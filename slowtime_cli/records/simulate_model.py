"""The option `simulate --model`: the sensor signals of a model under the inputs of a record."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.dynamics.description import Description, DescriptionError, Input, Start
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.units import UNITS
from slowtime_cli.shared.record_input import note_reading, read_any
from slowtime_cli.shared.terminal import note, plural, removed_unless_finished
from slowtime_services.files import ALL, MAX_BYTES, ReadingOptions, Record
from slowtime_services.matrices import read_any_description
from slowtime_services.models import ambient_model, run_model
from slowtime_services.plugins.effect_kinds import known

Series = np.ndarray[Any, np.dtype[np.float64]]


def simulate_model(
    model: Path,
    record_path: Path | None,
    out: Path,
    *,
    rate_hz: float | None,
    duration_s: float | None,
    seed: int | None,
    force_psd: float,
    hold: str,
    noise: bool,
    effects: Sequence[Path],
    initial: Sequence[Start] = (),
) -> None:
    """Run a model file and write ``t`` and one array a sensor.

    Parameters
    ----------
    initial
        Initial states that replace those of the same nodes in the model.
    """
    if out.suffix.lower() != ".npz":
        raise click.UsageError(f"{out.name!r} does not end in .npz. Give one that does.")
    kinds = known(effects)
    description = _started(read_any_description(model, kinds, note=note), initial)
    if not description.sensors:
        raise click.UsageError(
            f"{model.name} lists no sensors. List under `sensors` the quantities to write."
        )
    if noise and seed is None:
        raise click.UsageError(
            "--noise is random. Give --seed, so that the result can be reproduced."
        )
    if description.inputs:
        if record_path is None:
            wanted = ", ".join(entry.channel for entry in description.inputs)
            raise click.UsageError(f"{model.name} has inputs: {wanted}. Give --input RECORD.")
        record = read_any(record_path, ReadingOptions(rate_hz=rate_hz, keep=(ALL,)))
        times, arrays = _under(description, record, hold, kinds, seed)
    else:
        if record_path is not None:
            note("--input was not used: the model lists no inputs.")
        if description.initial:
            times, arrays = _free_decay(description, rate_hz, duration_s, kinds, seed)
        else:
            times, arrays = _ambient(
                description, model, rate_hz, duration_s, seed, force_psd, kinds
            )
    if noise:
        rng = np.random.default_rng([0 if seed is None else seed, 1])
        for sensor in description.sensors:
            white = (sensor.noise_sd or 0.0) * rng.standard_normal(len(times))
            arrays[sensor.channel] = arrays[sensor.channel] + white
    with removed_unless_finished(out), out.open("wb") as file:
        np.savez(file, **({"t": times} | arrays))  # type: ignore[arg-type]
    step = (times[-1] - times[0]) / (len(times) - 1)
    click.echo(
        f"{out}: {plural(len(times), 'sample')} of {', '.join(arrays)} at {1 / step:g} Hz"
    )


def read_start(given: str) -> Start:
    """Read the initial state of a node: NODE=DISPLACEMENT or NODE=DISPLACEMENT,VELOCITY.

    Parameters
    ----------
    given
        As typed, in m and m/s, or rad and rad/s.

    Returns
    -------
    Displacement and velocity of the node; the velocity is 0 where it is left out.

    Raises
    ------
    click.UsageError
        Where it is written otherwise.
    """
    node, _, numbers = given.partition("=")
    try:
        displacement, velocity = (float(one) for one in [*numbers.split(","), "0"][:2])
        if numbers.count(",") > 1 or not (math.isfinite(displacement + velocity) and node):
            raise ValueError(given)
    except ValueError:
        raise click.UsageError(
            f"--initial {given!r} is not understood. Write NODE=DISPLACEMENT or "
            "NODE=DISPLACEMENT,VELOCITY in m and m/s (rad, rad/s), such as m1=0.02,0.1."
        ) from None
    return Start(node=node.strip(), displacement_m=displacement, velocity_m_per_s=velocity)


def _started(description: Description, initial: Sequence[Start]) -> Description:
    """Replace the start of some nodes."""
    named = {one.node for one in initial}
    kept = [one for one in description.initial if one.node not in named]
    try:
        return dataclasses.replace(description, initial=(*kept, *initial))
    except DescriptionError as error:
        raise click.UsageError(f"--initial: {error}") from None


def _free_decay(
    description: Description,
    rate_hz: float | None,
    duration_s: float | None,
    kinds: Mapping[str, Kind],
    seed: int | None,
) -> tuple[Series, dict[str, Series]]:
    if rate_hz is None or duration_s is None:
        raise click.UsageError(
            "The model has an initial state and no inputs, so that it decays freely. Give "
            "--rate-hz and --duration."
        )
    samples = _count(description, rate_hz, duration_s)
    rng = None if seed is None else np.random.default_rng([seed, 2])
    arrays = run_model(description, {}, rate_hz, kinds=kinds, rng=rng, samples=samples)
    return np.arange(samples) / rate_hz, arrays


def _under(
    description: Description,
    record: Record,
    hold: str,
    kinds: Mapping[str, Kind],
    seed: int | None,
) -> tuple[Series, dict[str, Series]]:
    note_reading(record)
    if record.gaps:
        raise click.UsageError(
            f"The record lacks {sum(gap.missing for gap in record.gaps)} samples, so that the "
            "inputs are not known throughout. Cut it at its gaps."
        )
    inputs = {}
    for name, unit, column in zip(record.channels, record.units, record.samples.T, strict=True):
        inputs[name] = column.astype(float)
        for entry in description.inputs:
            if entry.channel == name:
                inputs[name] = inputs[name] * _between(entry, unit, description)
    clock = record.aux.get("t")
    seconds = np.arange(len(record.samples)) / record.rate_hz
    if clock is not None and np.shape(clock) == seconds.shape:
        seconds = seconds + float(clock[0])
    arrays = run_model(
        description,
        inputs,
        record.rate_hz,
        hold=hold,
        kinds=kinds,
        start_s=float(seconds[0]),
        rng=None if seed is None else np.random.default_rng([seed, 2]),
    )
    return seconds, arrays


def _between(entry: Input, unit: str, description: Description) -> float:
    """From the unit a record gives a channel, where it does, to the one the model gives it."""
    known = UNITS[description.unit_of_coordinate, entry.quantity]
    if not unit or unit == entry.unit:
        return 1.0
    if unit not in known:
        raise click.UsageError(
            f"The record has {entry.channel} in {unit}, the model in {entry.unit}, which "
            f"cannot be converted into each other. Allowed: {', '.join(known)}."
        )
    note(f"{entry.channel} is in {unit} in the record; converted to the model's {entry.unit}.")
    return known[unit] / known[entry.unit]


def _ambient(
    description: Description,
    model: Path,
    rate_hz: float | None,
    duration_s: float | None,
    seed: int | None,
    force_psd: float,
    kinds: Mapping[str, Kind],
) -> tuple[Series, dict[str, Series]]:
    if rate_hz is None or duration_s is None or seed is None:
        raise click.UsageError(
            f"{model.name} lists no inputs: it is under ambient forces. Give --rate-hz, "
            "--duration and --seed."
        )
    samples = _count(description, rate_hz, duration_s)
    arrays = ambient_model(
        description, samples, rate_hz, seed, force_psd=force_psd, kinds=kinds
    )
    return np.arange(samples) / rate_hz, arrays


def _count(description: Description, rate_hz: float, duration_s: float) -> int:
    """Return the number of samples, where memory holds as many."""
    samples = round(duration_s * rate_hz)
    if samples < 2 or samples * len(description.dofs) * 8 > MAX_BYTES:
        raise click.UsageError(
            f"--duration {duration_s:g} s at --rate-hz {rate_hz:g} makes {samples} samples. "
            f"Give 2 or more, and less than {MAX_BYTES / 2**20:.0f} MiB of them."
        )
    return samples
