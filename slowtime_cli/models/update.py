"""The verb `update`: parameters of a finite-element model from measured modes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.evolution.structures import (
    MeasuredModes,
    ReducedStructure,
    SparseStructure,
    StructurePosterior,
    UpdatableModel,
    estimate_with_scatter,
    identifiability_limits,
)
from slowtime.evolution.structures.fit import total_misfit
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime_cli.shared.terminal import note, show
from slowtime_services.matrices import MatrixFileError, MatrixModel, read_matrix_model
from slowtime_services.matrices.measured_files import read_measured_modes
from slowtime_services.reports import Table

from .shape_report import measured_of, updated_shapes, write_updated

SMALL = 3000
"""Degrees of freedom up to which every step solves the full model, in some 10 ms."""

BEYOND = 10
"""Modes of a reduced model beyond those that were measured, for pairing and slopes."""

UNLIKELY = 0.01
"""Probability of a misfit as large [1], below which it is told."""


def update(
    model: Path,
    modes: Path,
    frequency_error: float,
    shape_error: float,
    report: Path | None,
    as_json: bool,
) -> None:
    """Read both, estimate, and print."""
    read = read_matrix_model(model)
    if not read.matrices.names:
        raise MatrixFileError(
            f"{model.name} has no `parameters`. List there which quantities may differ "
            "from the model."
        )
    measured = read_measured_modes(
        modes, read, frequency_error=frequency_error, shape_error=shape_error
    )
    structure = _structure(read, len(measured.frequency_hz))
    found, scatter = estimate_with_scatter(structure, measured, read.prior_sd)
    pairs = total_misfit(structure, (measured,), found.theta, found.prior_sd).pairs
    count = int(pairs.max()) + 1
    rows = np.zeros((1, structure.size))
    before, after = (
        structure.sensed_modes(theta, rows, count).frequency_hz[pairs]
        for theta in (np.zeros(len(found.theta)), found.theta)
    )
    parameters = _parameters(found)
    frequencies = _frequencies(measured, before, after)
    limits = [limit.sentence for limit in identifiability_limits(structure, found)]
    warnings = [sentence for sentence in (scatter.sentence, *_misfit(found)) if sentence]
    if report is not None:
        notes = [*limits, *warnings]
        tables = [
            Table(PARAMETER_HEADINGS, _parameter_rows(parameters)),
            Table(MODE_HEADINGS, _mode_rows(frequencies)),
        ]
        wire, shapes = updated_shapes(read, found.theta, count)
        seen = measured_of(modes, [int(k) for k in pairs])
        write_updated(report, read.name, tables, (wire, shapes, seen), notes)
    if as_json:
        body = {
            "parameters": parameters,
            "modes": frequencies,
            "not_determined": limits,
            "p_value": found.p_value,
            "shapes": {
                "chi_square": scatter.chi_square,
                "numbers": scatter.count,
                "sd_factor": scatter.factor,
            },
        }
        click.echo(json.dumps(body, indent=2))
        return
    show("Parameters", PARAMETER_HEADINGS, _parameter_rows(parameters), plain=parameters)
    show("Modes", MODE_HEADINGS, _mode_rows(frequencies), plain=frequencies)
    for sentence in [*limits, *warnings]:
        note(sentence)


PARAMETER_HEADINGS = ("parameter", "change [%]", "sd [%]", "posterior over prior sd")
MODE_HEADINGS = ("measured [Hz]", "as given [Hz]", "updated [Hz]")


def _structure(read: MatrixModel, modes: int) -> UpdatableModel:
    size = read.matrices.size
    if size <= SMALL:
        return SparseStructure(matrices=read.matrices)
    number = min(modes + BEYOND, size)
    settings = BasisSettings(modes=number, coordinates=max(100, 3 * number))
    return ReducedStructure(model=reduce_modal(read.matrices, settings, trials=0))


def _parameters(found: StructurePosterior) -> list[dict[str, Any]]:
    """Change of each parameter, with its interval."""
    lower, upper = found.interval()
    columns = (
        found.names,
        found.change.tolist(),
        (np.exp(found.theta) * found.sd).tolist(),
        lower.tolist(),
        upper.tolist(),
        found.ratio.tolist(),
    )
    keys = ("parameter", "change", "sd", "lo", "hi", "ratio")
    return [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]


def _frequencies(
    measured: MeasuredModes, before: np.ndarray, after: np.ndarray
) -> list[dict[str, Any]]:
    """Frequencies as measured and of the model before and after [Hz]."""
    columns = (measured.frequency_hz, measured.frequency_sd_hz, before, after)
    keys = ("measured_hz", "sd_hz", "as_given_hz", "updated_hz")
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [dict(zip(keys, row, strict=True)) for row in rows]


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


def _misfit(found: StructurePosterior) -> list[str]:
    if found.p_value >= UNLIKELY:
        return []
    return [
        f"The updated model does not explain the modes (p = {found.p_value:.2g}): a part "
        "without parameters is wrong, or the stated errors of frequencies and shapes are "
        "too small."
    ]


_SHOWN = ("measured_hz", "as_given_hz", "updated_hz")
