"""The verb `update`: parameters of a finite-element model from measured modes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from slowtime_api.finite_elements.matrix_models import FiniteElementModel
from slowtime_api.finite_elements.updating import update as update_model
from slowtime_cli.shared.terminal import note, show
from slowtime_services.reports import Table

from .shape_report import measured_of, updated_shapes, write_updated


def update(
    model: Path,
    modes: Path,
    frequency_error: float,
    shape_error: float,
    report: Path | None,
    as_json: bool,
) -> None:
    """Read both, estimate, and print."""
    read = FiniteElementModel.from_file(model)
    found = update_model(read, modes, frequency_error=frequency_error, shape_error=shape_error)
    parameters, frequencies = found.rows(), found.mode_rows()
    notes = [*found.not_determined, *found.warnings]
    if report is not None:
        tables = [
            Table(PARAMETER_HEADINGS, _parameter_rows(parameters)),
            Table(MODE_HEADINGS, _mode_rows(frequencies)),
        ]
        pairs = [int(k) for k in found.pairs]
        wire, shapes = updated_shapes(read.model, found.posterior.theta, max(pairs) + 1)
        seen = measured_of(modes, pairs)
        write_updated(report, read.name, tables, (wire, shapes, seen), notes)
    if as_json:
        body = {
            "parameters": parameters,
            "modes": frequencies,
            "not_determined": list(found.not_determined),
            "p_value": found.p_value,
            "shapes": {
                "chi_square": found.scatter.chi_square,
                "numbers": found.scatter.count,
                "sd_factor": found.scatter.factor,
            },
        }
        click.echo(json.dumps(body, indent=2))
        return
    show("Parameters", PARAMETER_HEADINGS, _parameter_rows(parameters), plain=parameters)
    show("Modes", MODE_HEADINGS, _mode_rows(frequencies), plain=frequencies)
    for sentence in notes:
        note(sentence)


PARAMETER_HEADINGS = ("parameter", "change [%]", "sd [%]", "posterior over prior sd")
MODE_HEADINGS = ("measured [Hz]", "as given [Hz]", "updated [Hz]")


def _parameter_rows(parameters: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [
        (
            str(one["parameter"]),
            f"{100 * one['change']:+.2f}",
            f"{100 * one['sd']:.2f}",
            f"{one['ratio']:.3f}",
        )
        for one in parameters
    ]


def _mode_rows(modes: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [tuple(f"{one[key]:.5g}" for key in _SHOWN) for one in modes]


_SHOWN = ("measured_hz", "as_given_hz", "updated_hz")
