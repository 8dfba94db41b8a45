"""The verb `scale`: modal masses and scaled shapes from tests with known added masses."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from jaxtyping import Float

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.mode_shapes.mass_scaling import MassScaling, scale_by_masses
from slowtime.identification.modes import Mode
from slowtime_cli.shared.terminal import note, show, write_json

from .merge import modes_of_file

LOWEST = 0.5
"""Frequency with masses over that without [1], below which a mode is taken for another one: so
much needs added masses of three times the modal mass."""

LEAST_MAC = 0.6
"""MAC [1] below which two shapes are not of one mode; from here to 0.9 the result is flagged
`shape_changed`."""


def scale(
    modes: Path, added: Sequence[tuple[Path, str]], out: Path | None, as_json: bool
) -> None:
    """Read, pair, scale and print."""
    channels, bare = modes_of_file(modes)
    heavier = []
    for path, words in added:
        others, found = modes_of_file(path)
        if others != channels:
            raise click.UsageError(
                f"{path.name} has the channels {', '.join(others)}, and {modes.name} "
                f"{', '.join(channels)}. Identify both with the same sensors in the same "
                "order."
            )
        heavier.append((found, _masses(words, channels)))
    scaled = [(mode, _scaled(mode, heavier)) for mode in bare if mode.kind == "structural"]
    body = {"channels": channels, "modes": [_entry(mode, one) for mode, one in scaled if one]}
    if out is not None:
        write_json(out, body)
    if as_json:
        click.echo(json.dumps(body, indent=2))
        return
    rows = [(_cells(mode, one), _entry(mode, one)) for mode, one in scaled if one]
    show(
        "Modal masses, of shapes of norm 1",
        ("frequency [Hz]", "modal mass [kg]", "mistrust"),
        [cells for cells, _ in rows],
        plain=[
            {
                "frequency_hz": entry["frequency_hz"],
                "modal_mass_kg": entry["modal_mass_kg"]["value"],
                "modal_mass_sd_kg": entry["modal_mass_kg"]["sd"],
                "flags": ",".join(entry["flags"]),
            }
            for _, entry in rows
        ],
    )


def _masses(words: str, channels: tuple[str, ...]) -> Float[np.ndarray, " channel"]:
    """Masses of `CHANNEL=KG,...` at all channels."""
    found = np.zeros(len(channels))
    for word in words.split(","):
        name, equals, text = word.strip().partition("=")
        try:
            mass = float(text)
        except ValueError:
            mass = float("nan")
        if not equals or name not in channels or not 0.0 < mass < float("inf"):
            raise click.UsageError(
                f"{word.strip()!r} was given for --added. Allowed: CHANNEL=KG with one of the "
                f"channels {', '.join(channels)} and a mass above 0, separated by commas."
            )
        found[channels.index(name)] = mass
    return found


def _scaled(
    mode: Mode, heavier: Sequence[tuple[list[Mode], Float[np.ndarray, " channel"]]]
) -> MassScaling | None:
    """Scale one mode by those files that show it; None where none does, which is noted."""
    hz = mode.frequency_hz.value
    after, masses, why = [], [], "no file with masses shows it"
    for found, kg in heavier:
        near = [
            other
            for other in found
            if other.kind == "structural" and LOWEST < other.frequency_hz.value / hz <= 1.01
        ]
        best = max(near, key=lambda other: mac(mode.shape, other.shape), default=None)
        if best is not None and mac(mode.shape, best.shape) >= LEAST_MAC:
            after.append(best)
            masses.append(kg)
    if after:
        try:
            return scale_by_masses(mode, after, masses)
        except ValueError as error:
            why = str(error)
    note(f"{hz:.4g} Hz is not scaled: {why}")
    return None


def _entry(mode: Mode, scaled: MassScaling) -> dict[str, Any]:
    mass, factor = scaled.modal_mass, scaled.factor
    return {
        "frequency_hz": mode.frequency_hz.value,
        "modal_mass_kg": {"value": mass.value, "sd": mass.sd},
        "factor": {"value": factor.value, "sd": factor.sd},
        "shape": scaled.shape.tolist(),
        "flags": list(scaled.flags),
    }


def _cells(mode: Mode, scaled: MassScaling) -> tuple[str, ...]:
    mass = scaled.modal_mass
    return (
        f"{mode.frequency_hz.value:.4f}",
        f"{mass.value:.4g} ± {mass.sd:.2g}",
        ", ".join(scaled.flags),
    )
