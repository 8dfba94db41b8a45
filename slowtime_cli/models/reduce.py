"""The verb `reduce`: a small model of finite-element matrices, with its error."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import click

from slowtime_api.finite_elements.reduction import reduce as reduce_model
from slowtime_cli.shared.terminal import note, show

from .shape_report import reduced_shapes, write_shapes


def reduce(model: Path, **given: Any) -> None:
    """Read, reduce, verify and print."""
    report, out, as_json = (given.pop(name) for name in ("report", "out", "as_json"))
    found = reduce_model(model, **given)
    reduced, read = found.reduced, found.full.model
    if report is not None:
        wire, shapes = reduced_shapes(read, reduced, found.settings.modes)
        write_shapes(report, read.name, wire, shapes)
    if out is not None and (left_out := found.save(out)):
        note(f"Strains are left out of {out.name}: {', '.join(left_out)}.")
    if as_json:
        body = {
            "degrees_of_freedom": len(found.full),
            "coordinates": reduced.size,
            "frequency_hz": found.frequency_hz.tolist(),
            "parameters": reduced.names,
            "error": None if reduced.error is None else dataclasses.asdict(reduced.error),
        }
        click.echo(json.dumps(body, indent=2))
        return
    rows = found.rows()
    cells = [(str(row["mode"]), f"{row['frequency_hz']:.6g}") for row in rows]
    show(found.heading, ("mode", "frequency [Hz]"), cells, plain=rows)
    if reduced.error is not None:
        note(
            f"At {reduced.error.trials} random parameters up to {reduced.error.span:g} the "
            f"frequencies err by at most {reduced.error.frequency:.2%}, and shapes agree to "
            f"{reduced.error.agreement:.5f} (mass-weighted MAC)."
        )
