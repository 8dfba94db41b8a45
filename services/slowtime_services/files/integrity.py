"""The check of values that files, recordings and measured pieces have in common."""

import dataclasses

import numpy as np

from slowtime.signals.value_checks import value_notes

from .channels.repeated_rows import new_rows
from .reading_options import ReadingOptions, Repeated
from .record import Record


def with_checked_values(record: Record, file: str, repeated: Repeated | None = None) -> Record:
    """Check the values of a record that did not come through `read_record`.

    Rows that repeat the one before are left out where that is certain; other values that are
    no measurements are noted.

    Parameters
    ----------
    record
        Record of any source.
    file
        What messages call it.
    repeated
        Whether rows that repeat the one before are left out, ``"drop"``, or are samples,
        ``"keep"``; None to find out.

    Raises
    ------
    RecordError
        Where rows repeat and do not come evenly; the text names the options.
    """
    samples = np.asarray(record.samples, dtype=float)
    said = value_notes(samples, record.channels, record.rate_hz)
    if not record.gaps:
        options = ReadingOptions(repeated=repeated)
        new = new_rows(
            file, samples, record.channels, record.rate_hz, None, options, of_a_piece=False
        )
        said += new.notes
        if new.rows is not None:
            record = dataclasses.replace(
                record, samples=record.samples[new.rows], rate_hz=new.rate_hz
            )
    notes = (*record.notes, *(text for text in said if text not in record.notes))
    return dataclasses.replace(record, notes=notes)
