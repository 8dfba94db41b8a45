"""The verb `track`: estimates the constants of a structure from each record."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.evolution.predicted_response.ageing import learn_ageing
from slowtime_cli.shared.terminal import note, show
from slowtime_services.constant_tracking import TrackedConstants, label, track
from slowtime_services.diagnose import read_any
from slowtime_services.models import read_description

MIN_FORECAST_RECORDS = 5
"""Records from which constants are forecast [1]."""

FORECAST_STEPS = 10
"""Slow times of a forecast [1]."""

MAX_RESIDUAL_RATIO = 1.5
"""Mean squared residual over what was expected [1], above which the model is doubted."""


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
    found = track(
        read_description(model), sources, free=free, white_n=white_force, force_sd_n=force_sd
    )
    times = tuple(float(k) for k in range(len(records))) if at is None else at
    of_record = dict(zip((source.name for source in sources), times, strict=True))
    slow = np.array([of_record[name] for name in found.origins])
    for text in found.notes:
        note(text)
    rows = _rows(found, slow)
    ahead = _forecast(found, slow, forecast_to)
    if out is not None:
        with out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    if as_json:
        click.echo(json.dumps({"constants": rows, "forecast": ahead}, indent=1))
        return
    _warn(found)
    _show("Constants by record", rows)
    if ahead:
        click.echo()
        _show("Forecast", ahead)


def _rows(found: TrackedConstants, slow: np.ndarray) -> list[dict[str, Any]]:
    constants = found.constants
    lo, hi = constants.interval()
    rows: list[dict[str, Any]] = []
    for number, (origin, time) in enumerate(zip(found.origins, slow.tolist(), strict=True)):
        for k, name in enumerate(constants.names):
            value = float(constants.value[number, k])
            rows.append(
                {
                    "record": origin,
                    "slow_time": time,
                    "constant": label(name),
                    "value": value,
                    "sd": abs(value) * float(constants.log_sd[number, k]),
                    "lo": float(lo[number, k]),
                    "hi": float(hi[number, k]),
                    "nominal": float(constants.nominal[k]),
                    "surprise": float(constants.surprise[number]),
                }
            )
    return rows


def _forecast(
    found: TrackedConstants, slow: np.ndarray, horizon: float | None
) -> list[dict[str, Any]]:
    if horizon is None:
        return []
    last = float(slow.max())
    if not horizon > last:
        raise click.UsageError(
            f"--forecast-to {horizon:g} is not after the last record at {last:g}."
        )
    if len(slow) < MIN_FORECAST_RECORDS:
        raise click.UsageError(
            f"{len(slow)} records were given. A forecast takes {MIN_FORECAST_RECORDS} at least."
        )
    names = tuple(dict.fromkeys(name[0] for name in found.constants.names))
    ageing = learn_ageing(found.springs, slow, found.constants, of=names)
    later = last + (horizon - last) * np.arange(1, FORECAST_STEPS + 1) / FORECAST_STEPS
    rows: list[dict[str, Any]] = []
    for name in found.constants.names:
        band = ageing.future(name, later)
        for time, value, lo, hi in zip(later, band.value, band.lo, band.hi, strict=True):
            rows.append(
                {
                    "slow_time": float(time),
                    "constant": label(name),
                    "value": float(value),
                    "lo": float(lo),
                    "hi": float(hi),
                }
            )
    return rows


def _warn(found: TrackedConstants) -> None:
    for origin, surprise in zip(found.origins, found.constants.surprise.tolist(), strict=True):
        if surprise > MAX_RESIDUAL_RATIO:
            note(
                f"{origin}: the residuals are {surprise:.1f} times as large as expected (mean "
                "square). The model lacks something, or the stated noise and white force are "
                "too small; `slowtime diagnose` looks for what is missing."
            )


def _show(title: str, rows: list[dict[str, Any]]) -> None:
    heads = tuple(rows[0])
    cells = [
        tuple(f"{v:.5g}" if isinstance(v, float) else str(v) for v in row.values())
        for row in rows
    ]
    show(title, heads, cells, plain=rows)
