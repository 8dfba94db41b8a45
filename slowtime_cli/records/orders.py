"""The verb `orders`: amplitudes of orders of a machine against its speed."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import click

from slowtime_api.responses.machine_orders import orders as track_orders
from slowtime_api.signals import Signals
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import note, show, write_json
from slowtime_services.files import Record

SHOWN = 20
"""Rows of a channel and order that the table shows at most; files hold all."""


@with_record
def orders(
    record: Record,
    path: Path,
    tacho: str,
    pulses: int,
    wanted: str,
    revolutions: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Track the orders of a record, and print them."""
    found = track_orders(
        Signals.from_record(record), tacho, _numbers(wanted), pulses=pulses,
        revolutions=revolutions,
    )  # fmt: skip
    for said in found.notes:
        note(said)
    rows = found.rows()
    if out is not None:
        _write(out, rows)
    if as_json:
        click.echo(json.dumps({"record": path.name, "orders": rows}, indent=2))
        return
    step = max(1, math.ceil(len(found.time_s) / SHOWN))
    each = len(rows) // len(found.time_s)
    kept = [row for number, row in enumerate(rows) if number // each % step == 0]
    if len(kept) < len(rows):
        note(f"one block of {step} is shown. --out writes all.")
    heads = ("time [s]", "speed [Hz]", "order", "channel", "amplitude", "phase [deg]")
    show(path.name, heads, [_cells(row) for row in kept], plain=rows)


def _numbers(words: str) -> list[float]:
    """Orders of a list with commas."""
    try:
        found = [float(word) for word in words.split(",")]
    except ValueError:
        found = []
    if not found or not all(0.0 < one < math.inf for one in found):
        raise click.UsageError(
            f"{words!r} was given for --orders. Allowed: numbers above 0, separated by commas, "
            "such as 1,2,3."
        )
    return found


def _write(out: Path, rows: list[dict[str, Any]]) -> None:
    if out.suffix.lower() == ".json":
        write_json(out, {"orders": rows})
        return
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    unit = f" {row['unit']}" if row["unit"] else ""
    return (
        f"{row['time_s']:.2f}",
        f"{row['speed_hz']:.3f}",
        f"{row['order']:g}",
        row["channel"],
        f"{row['amplitude']:.4g} ± {row['sd']:.2g}{unit}",
        f"{row['phase_deg']:.1f}",
    )
