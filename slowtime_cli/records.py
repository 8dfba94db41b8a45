"""Verbs that start from a record of somebody's samples: `import` and `identify`."""

import dataclasses
import datetime
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from slowtime.identification.first import all_modes
from slowtime.identification.identified import Identified
from slowtime.identification.windows import Epoch, identify_windows
from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.files import Record, accelerations
from slowtime_services.record import RecordingWriter

from .reading import record_flags
from .terminal import bar

OUT = click.Path(dir_okay=False, path_type=Path)
UNDATED_NS = 946_684_800_000_000_000
"""2000-01-01 UTC: when a record begins that does not say when it began."""


@click.command(
    "import",
    epilog="""\b
Examples:
  slowtime import record.csv --out record.mcap
  slowtime import trial.txt --out trial.mcap --asset beam --start 2022-07-19T22:55:00Z
  slowtime import sensors.npy --rate-hz 256 --out sensors.mcap
""",
)
@record_flags
@click.option(
    "--out", required=True, type=OUT, help="MCAP file to write; it must not exist yet."
)
@click.option("--site", default="import", show_default=True, help="Site of the asset.")
@click.option("--asset", help="Name of the asset.  [default: from the file's name]")
@click.option(
    "--start",
    type=click.DateTime(["%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%dT%H:%M:%S.%fZ"]),
    help="Time of the first sample, UTC, where the file does not say.",
)
@click.option(
    "--block-s",
    default=0.1,
    show_default=True,
    type=click.FloatRange(min=0, min_open=True),
    help="Length of a raw block.",
)
def import_(
    record: Record,
    path: Path,
    out: Path,
    site: str,
    asset: str | None,
    start: datetime.datetime | None,
    block_s: float,
) -> None:
    """Turn a text, NumPy or MATLAB record into an MCAP recording of raw blocks.

    The same file gives the same bytes. `slowtime edge --recording` and `slowtime identify`
    read the result; so do Foxglove's and other MCAP tools.
    """
    name = asset or _as_name(path)
    begin = _start_ns(record, start)
    total = -(-len(record.samples) // max(1, round(block_s * record.rate_hz)))
    with RecordingWriter(out) as writer, bar("Importing", total) as tell:
        for number, block in enumerate(record.blocks(block_s, start_ns=begin)):
            samples = np.ascontiguousarray(block.samples)
            header = RawHeader(
                site=site,
                asset=name,
                boot="import",
                sequence=number,
                t_ns=block.start_ns,
                time_base="recorded",
                rate_hz=block.rate_hz,
                first_index=block.first_index,
                dtype=samples.dtype.newbyteorder("<").str,
                samples=len(samples),
                channels=block.channels,
                units=block.units,
            )
            payload = encode_raw(header, samples.tobytes())
            writer.write(RAW, site, name, payload, block.start_ns, block.start_ns)
            tell(number + 1)
    click.echo(
        f"{out}: {len(record.samples)} samples of {', '.join(record.channels)} at "
        f"{record.rate_hz:g} Hz, {record.duration_s:.3f} s, as {site}.{name}"
    )


def _start_ns(record: Record, start: datetime.datetime | None) -> int:
    if start is not None:
        return round(start.replace(tzinfo=datetime.UTC).timestamp() * 1e6) * 1000
    if record.start_ns is not None:
        return record.start_ns
    click.echo(
        "note: the file does not say when it began; 2000-01-01 is put there. Give --start.",
        err=True,
    )
    return UNDATED_NS


def _as_name(path: Path) -> str:
    name = "".join(
        c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in path.stem.lower()
    )
    return name.strip("-_")[:63] or "record"


@click.command(
    epilog="""\b
Examples:
  slowtime identify record.csv --rate-hz 200
  slowtime identify record.csv --rate-hz 200 --band-hz 1 20 --out modes.json
  slowtime identify trial.mcap --window-s 1 --out epochs.json
"""
)
@record_flags
@click.option(
    "--band-hz",
    nargs=2,
    type=float,
    metavar="LO HI",
    help="Where to look for modes.  [default: from a few cycles to 0.45 of the rate]",
)
@click.option(
    "--window-s",
    type=click.FloatRange(min=0, min_open=True),
    help="Identify window by window instead of the whole record.",
)
@click.option(
    "--hop-s",
    type=click.FloatRange(min=0, min_open=True),
    help="From one window to the next.  [default: a quarter of a window]",
)
@click.option(
    "--method",
    default="auto",
    show_default=True,
    type=click.Choice(["auto", "ambient", "free_decay", "peak"]),
    help="How to fit; auto finds out what the record is.",
)
@click.option("--out", type=OUT, help="JSON file to write.")
def identify(
    record: Record,
    path: Path,
    band_hz: tuple[float, float] | None,
    window_s: float | None,
    hop_s: float | None,
    method: Any,
    out: Path | None,
) -> None:
    """Find natural frequencies and damping in a record, with their standard deviations.

    RECORD is MCAP, text of any delimiter, NumPy or MATLAB. Frequencies are undamped natural
    frequencies. Where nothing stands out of the noise, nothing is claimed.
    """
    if hop_s is not None and window_s is None:
        raise click.UsageError("--hop-s goes with --window-s.")
    record = _accelerations_of(record)
    samples = np.asarray(record.samples, dtype=float)
    facts = {
        "record": path.name,
        "rate_hz": record.rate_hz,
        "channels": list(record.channels),
        "duration_s": record.duration_s,
    }
    if window_s is None:
        modes = all_modes(
            _longest(record, samples), record.rate_hz, band_hz=band_hz or None, method=method
        )
        _show(modes, path)
        result: dict[str, Any] = {**facts, "modes": [_as_json(mode) for mode in modes]}
    else:
        epochs = _windows(record, samples, window_s, hop_s, band_hz or None, method)
        _show_epochs(epochs, path)
        result = {
            **facts,
            "window_s": window_s,
            "epochs": [_epoch_json(epoch) for epoch in epochs],
        }
    if out is not None:
        out.write_text(json.dumps(result, indent=1) + "\n")


def _accelerations_of(record: Record) -> Record:
    """Leave out what is no acceleration by its name, where others are, and say so."""
    chosen = accelerations(record.channels, record.units)
    left_out = [name for name in record.channels if name not in chosen]
    if not left_out:
        return record
    click.echo(
        f"note: identified from {', '.join(chosen)}; {', '.join(left_out)} left out, being no "
        "acceleration by name or unit. --channels chooses others.",
        err=True,
    )
    columns = [record.channels.index(name) for name in chosen]
    return dataclasses.replace(
        record,
        samples=record.samples[:, columns],
        channels=chosen,
        units=tuple(record.units[column] for column in columns),
    )


def _stretches(record: Record) -> list[tuple[int, int, int]]:
    """First row, last row and rows missing before, of each part without a gap."""
    starts = [0, *(gap.row for gap in record.gaps), len(record.samples)]
    lost = np.cumsum([0, *(gap.missing for gap in record.gaps)])
    return [
        (a, b, int(missing))
        for a, b, missing in zip(starts[:-1], starts[1:], lost, strict=True)
    ]


def _longest(record: Record, samples: "np.ndarray[Any, Any]") -> "np.ndarray[Any, Any]":
    first, last, _ = max(_stretches(record), key=lambda part: part[1] - part[0])
    if record.gaps:
        click.echo(
            f"note: samples are missing in {len(record.gaps)} places; the longest part without "
            f"a gap is used, {(last - first) / record.rate_hz:.3f} s.",
            err=True,
        )
    return samples[first:last]


def _windows(
    record: Record,
    samples: "np.ndarray[Any, Any]",
    window_s: float,
    hop_s: float | None,
    band_hz: tuple[float, float] | None,
    method: Any,
) -> list[Epoch]:
    shortest = round(window_s * record.rate_hz)
    parts = [part for part in _stretches(record) if part[1] - part[0] >= shortest]
    if not parts:
        raise click.UsageError(
            f"No part of the record without a gap is as long as --window-s {window_s:g}. The "
            f"record has {record.duration_s:g} s. Give a shorter window."
        )
    epochs = []
    for first, last, lost in parts:
        offset = (first + lost) / record.rate_hz
        for epoch in identify_windows(
            samples[first:last],
            record.rate_hz,
            window_s=window_s,
            hop_s=hop_s,
            band_hz=band_hz,
            method=method,
        ):
            epochs.append(
                Epoch(epoch.start_s + offset, epoch.end_s + offset, epoch.modes, epoch.refused)
            )
    return epochs


def _as_json(mode: Identified) -> dict[str, Any]:
    return {
        "frequency_hz": {"value": mode.frequency_hz.value, "sd": mode.frequency_hz.sd},
        "damping_ratio": {"value": mode.damping_ratio.value, "sd": mode.damping_ratio.sd},
        "correlation": mode.correlation,
        "snr_db": mode.snr_db,
        "method": mode.method,
        "span_s": list(mode.span_s),
        "flags": list(mode.flags),
    }


def _epoch_json(epoch: Epoch) -> dict[str, Any]:
    body: dict[str, Any] = {
        "start_s": epoch.start_s,
        "end_s": epoch.end_s,
        "modes": [_as_json(mode) for mode in epoch.modes],
    }
    return body | ({"refused": epoch.refused} if epoch.refused else {})


def _cells(mode: Identified) -> tuple[str, ...]:
    f, z = mode.frequency_hz, mode.damping_ratio
    return (
        f"{f.value:.4f} ± {f.sd:.4f}",
        f"{100 * z.value:.3f} ± {100 * z.sd:.3f}",
        "" if mode.snr_db is None else f"{mode.snr_db:.0f}",
        mode.method,
        ", ".join(mode.flags),
    )


COLUMNS = ("frequency [Hz]", "damping [%]", "SNR [dB]", "method", "mistrust")


def _show(modes: Sequence[Identified], path: Path) -> None:
    if not modes:
        click.echo(
            f"{path.name}: no mode stands out of the noise. Record longer, or give --band-hz."
        )
        return
    _print(path.name, (), [((), mode) for mode in modes])


def _show_epochs(epochs: Sequence[Epoch], path: Path) -> None:
    rows: list[tuple[tuple[str, ...], Identified | None]] = []
    for epoch in epochs:
        span = (f"{epoch.start_s:.3f}", f"{epoch.end_s:.3f}")
        rows += [(span, mode) for mode in epoch.modes] or [(span, None)]
    _print(path.name, ("from [s]", "to [s]"), rows)


def _print(
    title: str,
    before: tuple[str, ...],
    rows: Sequence[tuple[tuple[str, ...], Identified | None]],
) -> None:
    table = Table(title=title, title_justify="left")
    for name in (*before, *COLUMNS):
        table.add_column(name, justify="left" if name in ("method", "mistrust") else "right")
    for span, mode in rows:
        table.add_row(*span, *(_cells(mode) if mode is not None else ("-",) * len(COLUMNS)))
    Console().print(table)
