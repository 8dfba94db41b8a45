"""The verb `scale`: modal masses and scaled shapes from tests with known added masses."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from slowtime.identification.mode_shapes.mass_scaling import MassScaling
from slowtime.identification.modes import Mode
from slowtime_api.mode_sets.merging import modes_file
from slowtime_api.mode_sets.scaling import scale as scale_modes
from slowtime_cli.shared.terminal import note, show, write_json


def scale(
    modes: Path, added: Sequence[tuple[Path, str]], out: Path | None, as_json: bool
) -> None:
    """Read, pair, scale and print."""
    channels = tuple(modes_file(modes).channels)
    tests = [(path, _masses(words, channels)) for path, words in added]
    found = scale_modes(modes, tests)
    for said in found.notes:
        note(said)
    pairs = list(zip(found.modes, found.scalings, strict=True))
    body = {"channels": channels, "modes": [_entry(mode, one) for mode, one in pairs]}
    if out is not None:
        write_json(out, body)
    if as_json:
        click.echo(json.dumps(body, indent=2))
        return
    rows = [(_cells(mode, one), _entry(mode, one)) for mode, one in pairs]
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


def _masses(words: str, channels: tuple[str, ...]) -> dict[str, float]:
    """Masses [kg] of `CHANNEL=KG,...` by channel."""
    found: dict[str, float] = {}
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
        found[name] = mass
    return found


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
