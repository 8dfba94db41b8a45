"""Records → recordings of raw blocks."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.files import UNDATED_NS, Record
from slowtime_services.record import RecordingWriter

BLOCK_S = 0.1
"""Length of a block [s] where none is given."""


def write_imported(
    out: Path,
    record: Record,
    *,
    site: str,
    asset: str,
    start_ns: int | None = None,
    block_s: float = BLOCK_S,
    source: str = "",
    tell: Callable[[int], object] = lambda _: None,
) -> None:
    """Write a record as a recording of raw blocks.

    Parameters
    ----------
    out
        Recording to write (.mcap).
    record
        The record.
    site, asset
        Names under which the blocks are published.
    start_ns
        Sensor time of the first sample [ns since 1970-01-01 UTC]; that of the record, or
        2000-01-01, where not given.
    block_s
        Length of a block [s].
    source
        Name of the file that was read, for the metadata.
    tell
        Told the number of blocks written.
    """
    begin = next(one for one in (start_ns, record.start_ns, UNDATED_NS) if one is not None)
    with RecordingWriter(out, metadata=_metadata(record, source)) as writer:
        for number, block in enumerate(record.blocks(block_s, start_ns=begin)):
            samples = np.ascontiguousarray(block.samples)
            header = RawHeader(
                site=site,
                asset=asset,
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
                RAW, site, asset, payload, block.start_ns, block.start_ns, until_ns=block.end_ns
            )
            tell(number + 1)


def _metadata(record: Record, source: str) -> dict[str, str]:
    """Return notes on how the file was read, for the recording's metadata."""
    said = {"imported_from": source} if source else {}
    for key, texts in (("assumptions", record.assumptions), ("notes", record.notes)):
        if texts:
            said[key] = " | ".join(texts)
    return said
