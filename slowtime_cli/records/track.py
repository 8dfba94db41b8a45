"""The verb `track`: estimates the constants of a structure from each record."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from slowtime_api.models import Model
from slowtime_api.responses.tracked_constants import track_sources
from slowtime_cli.shared.terminal import note, show
from slowtime_services.diagnose import read_any
from slowtime_services.models import read_description


def track_records(
    model: Path,
    records: Sequence[str],
    free: tuple[str, ...] | None,
    white_force: float,
    force_sd: float | None,
    at: tuple[float, ...] | None,
    forecast_to: float | None,
    rate_hz: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Estimate the constants of each record, and forecast them.

    Raises
    ------
    ValueError
        Where model and records do not go together.
    """
    sources = [read_any(text, rate_hz=rate_hz) for text in records]
    found = track_sources(
        Model(read_description(model)), sources, slow_time=at, free=free,
        white_force=white_force, force_sd=force_sd,
    )  # fmt: skip
    for text in found.notes:
        note(text)
    rows = found.rows()
    ahead = [] if forecast_to is None else found.forecast(forecast_to)
    if out is not None:
        with out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    if as_json:
        click.echo(json.dumps({"constants": rows, "forecast": ahead}, indent=1))
        return
    for text in found.warnings:
        note(text)
    _show("Constants by record", rows)
    if ahead:
        click.echo()
        _show("Forecast", ahead)


def _show(title: str, rows: list[dict[str, Any]]) -> None:
    heads = tuple(rows[0])
    cells = [
        tuple(f"{v:.5g}" if isinstance(v, float) else str(v) for v in row.values())
        for row in rows
    ]
    show(title, heads, cells, plain=rows)
