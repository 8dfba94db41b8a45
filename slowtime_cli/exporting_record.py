"""A record or a recording, as a file of other tools."""

from pathlib import Path

import click

from slowtime_services.exports import write_csv, write_parquet, write_universal
from slowtime_services.files import Record

from .reading import with_record
from .terminal import plural, removed_unless_finished

WRITERS = {"csv": write_csv, "parquet": write_parquet, "uff": write_universal}


@with_record
def export_record(record: Record, path: Path, form: str, out: Path) -> None:
    """Write the samples of a record with their clock, names and units."""
    with removed_unless_finished(out):
        WRITERS[form](out, record)
    click.echo(
        f"{out}: {plural(len(record.samples), 'sample')} of {', '.join(record.channels)} at "
        f"{record.rate_hz:g} Hz, {out.stat().st_size:,} bytes"
    )
