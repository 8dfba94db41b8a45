"""Export of a record or a recording to CSV, Parquet and universal files."""

from pathlib import Path

import click

from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import plural, removed_unless_finished
from slowtime_services.exports import write_csv, write_parquet, write_universal
from slowtime_services.files import Record

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
