"""The verb `simulate`: writes the samples of a simulated structure."""

import math
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime_cli.shared.demo_structures import structure
from slowtime_cli.shared.terminal import bar, plural, removed_unless_finished
from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.files import MAX_BYTES
from slowtime_services.record import RecordingWriter
from slowtime_services.simulate import EvolvingStructure, simulated_structure

from .simulate_model import read_start, simulate_model


def simulate(
    name: str | None,
    model: Path | None,
    record: Path | None,
    epochs: int,
    seed: int | None,
    rate_hz: float | None,
    duration_s: float | None,
    force_psd: float,
    hold: str,
    noise: bool,
    effects: tuple[Path, ...],
    initial: tuple[str, ...],
    out: Path,
) -> None:
    """Write the vibration of an ageing structure or of a model file."""
    if model is not None:
        simulate_model(
            model,
            record,
            out,
            rate_hz=rate_hz,
            duration_s=duration_s,
            seed=seed,
            force_psd=force_psd,
            hold=hold,
            noise=noise,
            effects=effects,
            initial=[read_start(given) for given in initial],
        )
        return
    assert name is not None
    settings = structure(name) | {"epochs": epochs} | ({} if seed is None else {"seed": seed})
    simulated = simulated_structure(settings)
    with removed_unless_finished(out):
        if out.suffix.lower() == ".npz":
            _as_arrays(simulated, epochs, out)
        else:
            _as_recording(simulated, epochs, name, out)
    click.echo(
        f"{out}: {plural(epochs, 'epoch')} of {simulated.seconds:g} s at "
        f"{simulated.rate_hz:g} Hz"
    )


def _as_recording(simulated: EvolvingStructure, epochs: int, name: str, out: Path) -> None:
    with RecordingWriter(out) as writer, bar("Simulating", epochs) as tell:
        for sequence, block in enumerate(simulated.blocks()):
            samples = np.ascontiguousarray(block.samples)
            header = RawHeader(
                site="demo",
                asset=name,
                boot="simulated",
                sequence=sequence,
                t_ns=block.start_ns,
                time_base="simulated",
                rate_hz=block.rate_hz,
                first_index=block.first_index,
                dtype=simulated.sensor.dtype,
                samples=len(samples),
                channels=block.channels,
                units=block.units,
                epoch=block.epoch,
                slow_time=block.slow_time,
                slow_time_unit=simulated.slow_time_unit,
                covariates=dict(block.covariates),
                truth=dict(block.truth) or None,
            )
            payload = encode_raw(header, samples.tobytes())
            writer.write(
                RAW,
                "demo",
                name,
                payload,
                block.start_ns,
                block.start_ns,
                until_ns=block.end_ns,
            )
            tell((block.epoch or 0) + 1)


def _as_arrays(simulated: EvolvingStructure, epochs: int, out: Path) -> None:
    shape = (len(simulated.channels), epochs, simulated.samples)
    if math.prod(shape) * 8 > MAX_BYTES:
        raise click.UsageError(
            f"{out.name} would hold {math.prod(shape) * 8 / 2**20:.0f} MiB; .npz is made in "
            f"memory, of at most {MAX_BYTES / 2**20:.0f} MiB. Give fewer --epochs, or "
            "write .mcap."
        )
    samples = np.full(shape, np.nan)
    with bar("Simulating", epochs) as tell:
        for number in range(epochs):
            for block in simulated.epoch(number):
                start = block.first_index - number * simulated.samples
                samples[:, number, start : start + len(block.samples)] = block.samples.T
            tell(number + 1)
    truth = [simulated.truth(number) for number in range(epochs)]
    arrays: dict[str, Any] = {
        f"true_{key}": np.array([known[key] for known in truth]) for key in truth[0]
    }
    arrays |= dict(zip(simulated.channels, samples, strict=True))
    arrays["rate_hz"] = np.array(simulated.rate_hz)
    arrays["slow_time"] = np.arange(epochs) * simulated.slow_time_step
    np.savez(out, **arrays)
