"""The verb `separate`: decomposes a history into two slow time scales."""

import csv
import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime_api.responses.time_scales import KINDS
from slowtime_api.responses.time_scales import separate as separate_history
from slowtime_api.twin_files import samples_of
from slowtime_cli.shared.tables import read_columns
from slowtime_cli.shared.terminal import note, show
from slowtime_schemas.codec import decode
from slowtime_schemas.messages import Features
from slowtime_schemas.streams import FEATURES


def separate(source: Path, asset: str | None, out: Path | None, as_json: bool) -> None:
    """Separate a history, by an additive Gaussian process and a mixture of experts.

    Raises
    ------
    ValueError
        For fewer than 8 readings.
    """
    time, value, sd, quantity = _history(source, asset)
    found = separate_history(time, value, sd)
    rows = np.array([list(row.values()) for row in found.rows()])
    names = ("slow_time", quantity, "sd", "long", "long_sd", "short", "short_sd")
    if out is not None:
        with out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            writer.writerows(rows.tolist())
    summary: dict[str, Any] = {
        "quantity": quantity,
        "readings": len(time),
        "short_scale": found.kind,
        "period": found.period,
        "long_change": found.long_change,
        "long_change_sd": found.long_change_sd,
        "short_range": found.short_range,
        "better_model": found.better_model,
        "log_odds": found.log_odds,
    }
    if as_json:
        points = [dict(zip(names, row, strict=True)) for row in rows.tolist()]
        click.echo(json.dumps({**summary, "points": points}, indent=1))
        return
    _tell(summary)
    _show(rows, names)


def _history(source: Path, asset: str | None) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Return slow time, value and sd, in ascending order, and the name of the value."""
    if source.suffix.lower() not in (".json", ".mcap"):
        table = read_columns(source)
        if {"slow_time", "value", "sd"} <= set(table):
            order = np.argsort(table["slow_time"], kind="stable")
            return table["slow_time"][order], table["value"][order], table["sd"][order], "value"
    _, samples = samples_of(source, asset, note)
    told = (decode(FEATURES, sample.payload) for sample in samples)
    rows = [
        (one.slow_time, mode.frequency_hz.value, mode.frequency_hz.sd)
        for one in told
        if isinstance(one, Features)
        for mode in one.modes[:1]
    ]
    if not rows:
        raise click.UsageError(f"{source} holds no frequency. Give a history with some.")
    time, value, sd = np.array(sorted(rows)).T.copy()
    return time, value, sd, "frequency_hz"


def _tell(summary: dict[str, Any]) -> None:
    change, sd = summary["long_change"], summary["long_change_sd"]
    note(
        f"Long scale: {summary['quantity']} changed by {change:.4g} ± {sd:.2g} from the first "
        "reading to the last."
    )
    period = summary["period"]
    every = "" if period is None else f", period {period:.4g}"
    note(
        f"Short scale: {KINDS[summary['short_scale']]}, over a range of "
        f"{summary['short_range']:.4g}{every}."
    )
    if summary["better_model"] == "mixture":
        note(
            "A mixture of experts predicts the readings better (log odds "
            f"{-summary['log_odds']:.1f}): the history may change its character at some time."
        )


def _show(rows: np.ndarray, names: tuple[str, ...]) -> None:
    show(
        "Two slow time scales",
        names,
        [tuple(f"{value:.6g}" for value in row) for row in rows[:40]],
        plain=[dict(zip(names, row, strict=True)) for row in rows.tolist()],
    )
