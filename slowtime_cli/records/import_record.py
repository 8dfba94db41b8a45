"""The verb `import`: converts a record to an MCAP recording of raw blocks."""

from pathlib import Path

import click
import numpy as np

from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import bar, note, removed_unless_finished
from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.files import UNDATED_NS, Record
from slowtime_services.record import RecordingWriter


@with_record
def import_(
    record: Record,
    path: Path,
    out: Path,
    site: str,
    asset: str | None,
    start_ns: int | None,
    block_s: float,
) -> None:
    """Turn a record into an MCAP recording."""
    name = asset or _as_name(path)
    begin = _start_ns(record, start_ns)
    total = -(-len(record.samples) // max(1, round(block_s * record.rate_hz)))
    with (
        removed_unless_finished(out),
        RecordingWriter(out, metadata=_metadata(record, path)) as writer,
        bar("Importing", total) as tell,
    ):
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
            writer.write(
                RAW, site, name, payload, block.start_ns, block.start_ns, until_ns=block.end_ns
            )
            tell(number + 1)
    click.echo(
        f"{out}: {len(record.samples)} samples of {', '.join(record.channels)} at "
        f"{record.rate_hz:g} Hz, {record.duration_s:.3f} s, as {site}.{name}"
    )


def _metadata(record: Record, path: Path) -> dict[str, str]:
    """Return notes on how the file was read, for the recording's metadata."""
    said = {"imported_from": path.name}
    for key, texts in (("assumptions", record.assumptions), ("notes", record.notes)):
        if texts:
            said[key] = " | ".join(texts)
    return said


def _start_ns(record: Record, start_ns: int | None) -> int:
    if start_ns is not None:
        return start_ns
    if record.start_ns is not None:
        return record.start_ns
    note("the file does not state its start; 2000-01-01 is assumed. Give --start.")
    return UNDATED_NS


def _as_name(path: Path) -> str:
    name = "".join(
        c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in path.stem.lower()
    )
    return name.strip("-_")[:63] or "record"
