"""The verb `import`: converts a record to an MCAP recording of raw blocks."""

from pathlib import Path

import click

from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import bar, note, removed_unless_finished
from slowtime_services.exports.recordings import write_imported
from slowtime_services.files import Record


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
    if start_ns is None and record.start_ns is None:
        note("the file does not state its start; 2000-01-01 is assumed. Give --start.")
    total = -(-len(record.samples) // max(1, round(block_s * record.rate_hz)))
    with removed_unless_finished(out), bar("Importing", total) as tell:
        write_imported(
            out, record, site=site, asset=name, start_ns=start_ns, block_s=block_s,
            source=path.name, tell=tell,
        )  # fmt: skip
    click.echo(
        f"{out}: {len(record.samples)} samples of {', '.join(record.channels)} at "
        f"{record.rate_hz:g} Hz, {record.duration_s:.3f} s, as {site}.{name}"
    )


def _as_name(path: Path) -> str:
    name = "".join(
        c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in path.stem.lower()
    )
    return name.strip("-_")[:63] or "record"
