"""The verb `update`: parameters of a finite-element model from measured modes."""

import json
from pathlib import Path

import click
import numpy as np

from slowtime.evolution.structures import (
    MeasuredModes,
    ReducedStructure,
    SparseStructure,
    StructurePosterior,
    UpdatableModel,
    estimate,
    identifiability_limits,
)
from slowtime.evolution.structures.fit import total_misfit
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime_cli.shared.terminal import note, show
from slowtime_services.matrices import MatrixFileError, MatrixModel, read_matrix_model
from slowtime_services.matrices.measured_files import read_measured_modes

SMALL = 3000
"""Degrees of freedom up to which every step solves the full model, in some 10 ms."""

BEYOND = 10
"""Modes of a reduced model beyond those that were measured, for pairing and slopes."""

UNLIKELY = 0.01
"""Probability of a misfit as large [1], below which it is told."""


def update(
    model: Path, modes: Path, frequency_error: float, shape_error: float, as_json: bool
) -> None:
    """Read both, estimate, and print."""
    read = read_matrix_model(model)
    if not read.matrices.names:
        raise MatrixFileError(
            f"{model.name} has no `parameters`. Name what may differ from the model."
        )
    measured = read_measured_modes(
        modes, read, frequency_error=frequency_error, shape_error=shape_error
    )
    structure = _structure(read, len(measured.frequency_hz))
    found = estimate(structure, measured, read.prior_sd)
    pairs = total_misfit(structure, (measured,), found.theta, found.prior_sd).pairs
    count = int(pairs.max()) + 1
    rows = np.zeros((1, structure.size))
    before, after = (
        structure.sensed_modes(theta, rows, count).frequency_hz[pairs]
        for theta in (np.zeros(len(found.theta)), found.theta)
    )
    _print(structure, measured, found, before, after, as_json=as_json)


def _structure(read: MatrixModel, modes: int) -> UpdatableModel:
    size = read.matrices.size
    if size <= SMALL:
        return SparseStructure(matrices=read.matrices)
    number = min(modes + BEYOND, size)
    settings = BasisSettings(modes=number, coordinates=max(100, 3 * number))
    return ReducedStructure(model=reduce_modal(read.matrices, settings, trials=0))


def _print(
    structure: UpdatableModel,
    measured: MeasuredModes,
    found: StructurePosterior,
    before: np.ndarray,
    after: np.ndarray,
    *,
    as_json: bool,
) -> None:
    lower, upper = found.interval()
    parameters = [
        {"parameter": name, "change": change, "sd": sd, "lo": lo, "hi": hi, "ratio": ratio}
        for name, change, sd, lo, hi, ratio in zip(
            found.names,
            found.change.tolist(),
            (np.exp(found.theta) * found.sd).tolist(),
            lower.tolist(),
            upper.tolist(),
            found.ratio.tolist(),
            strict=True,
        )
    ]
    modes = [
        {"measured_hz": seen, "sd_hz": sd, "as_given_hz": first, "updated_hz": last}
        for seen, sd, first, last in zip(
            measured.frequency_hz.tolist(),
            measured.frequency_sd_hz.tolist(),
            before.tolist(),
            after.tolist(),
            strict=True,
        )
    ]
    limits = [limit.sentence for limit in identifiability_limits(structure, found)]
    if as_json:
        body = {
            "parameters": parameters,
            "modes": modes,
            "not_determined": limits,
            "p_value": found.p_value,
        }
        click.echo(json.dumps(body, indent=2))
        return
    show(
        "Parameters",
        ("parameter", "change [%]", "sd [%]", "posterior over prior sd"),
        [
            (
                str(one["parameter"]),
                f"{100 * one['change']:+.2f}",
                f"{100 * one['sd']:.2f}",
                f"{one['ratio']:.3f}",
            )
            for one in parameters
        ],
        plain=parameters,
    )
    show(
        "Modes",
        ("measured [Hz]", "as given [Hz]", "updated [Hz]"),
        [tuple(f"{one[key]:.5g}" for key in _SHOWN) for one in modes],
        plain=modes,
    )
    for sentence in limits:
        note(sentence)
    if found.p_value < UNLIKELY:
        note(
            f"The updated model does not explain the modes (p = {found.p_value:.2g}): another "
            "part is wrong, or the errors of frequencies and shapes are larger than said."
        )


_SHOWN = ("measured_hz", "as_given_hz", "updated_hz")
