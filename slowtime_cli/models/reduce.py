"""The verb `reduce`: a small model of finite-element matrices, with its error."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.finite_elements.reduction import (
    AdaptiveModel,
    BasisSettings,
    reduce_modal,
    settings_for_band,
)
from slowtime_cli.shared.terminal import note, show
from slowtime_services.matrices import (
    MatrixModel,
    describe_reduced,
    read_matrix_model,
    write_reduced,
)
from slowtime_services.models import model_file_of, write_model
from slowtime_services.wireframes import geometry_of, with_geometry

from .shape_report import reduced_shapes, write_shapes

MODEL_FILES = (".yaml", ".yml", ".json")
"""Endings of a reduced model that is written as a model file."""


def reduce(model: Path, **given: Any) -> None:
    """Read, reduce, verify and print."""
    read = read_matrix_model(model)
    matrices = read.matrices
    settings = BasisSettings(
        modes=given["modes"] or 1,
        coordinates=given["coordinates"],
        span=given["span"],
        seed=given["seed"],
    )
    if given["band_hz"] is not None:
        settings = settings_for_band(matrices, given["band_hz"], settings)
    reduced = reduce_modal(matrices, settings, trials=given["trials"])
    frequencies = reduced.modes(np.zeros(len(reduced.names)), settings.modes).frequency_hz
    if given["report"] is not None:
        wire, shapes = reduced_shapes(read, reduced, settings.modes)
        write_shapes(given["report"], read.name, wire, shapes)
    if given["out"] is not None:
        _write(given["out"], read, reduced, settings)
    error = None if reduced.error is None else dataclasses.asdict(reduced.error)
    if given["as_json"]:
        body = {
            "degrees_of_freedom": matrices.size,
            "coordinates": reduced.size,
            "frequency_hz": frequencies.tolist(),
            "parameters": reduced.names,
            "error": error,
        }
        click.echo(json.dumps(body, indent=2))
        return
    show(
        f"{matrices.size} degrees of freedom, {reduced.size} coordinates",
        ("mode", "frequency [Hz]"),
        [(str(j + 1), f"{f:.6g}") for j, f in enumerate(frequencies)],
        plain=[{"mode": j + 1, "frequency_hz": float(f)} for j, f in enumerate(frequencies)],
    )
    if reduced.error is not None:
        note(
            f"At {reduced.error.trials} random parameters up to {reduced.error.span:g} the "
            f"frequencies err by at most {reduced.error.frequency:.2%}, and shapes agree to "
            f"{reduced.error.agreement:.5f} (mass-weighted MAC)."
        )


def _write(
    out: Path, read: MatrixModel, reduced: AdaptiveModel, settings: BasisSettings
) -> None:
    """Write the reduced model: as a model file, or as an archive for updating."""
    suffix = out.suffix.lower()
    if suffix not in MODEL_FILES:
        write_reduced(out, reduced)
        return
    found = describe_reduced(read, settings)
    if found.left_out:
        note(f"Strains are left out of {out.name}: {', '.join(found.left_out)}.")
    file = with_geometry(model_file_of(found.description), geometry_of(read, found))
    if suffix == ".json":
        out.write_text(file.model_dump_json(), encoding="utf-8")
    else:
        write_model(out, file)
