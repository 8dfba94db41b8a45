"""Formats of seismology, by ObsPy: miniSEED, SAC, GCF, SEG-2."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.files.binary.numpy_arrays import refuse_above
from slowtime_services.files.record import RecordError

from .found import Figure, Found, Series

MIN_SEAMS = 3
"""Seams between records from which their starts tell a rate [1]."""
SEAM_TOLERANCE = 0.01
"""Relative difference of seams that are alike [1]."""
MOST_A_BYTE = 2
"""Samples that a byte holds at most [1]: seven in four bytes, by the compression Steim 2 (SEED
manual 2.4, appendix B)."""
_SINGLE = 1.2e-7
"""Relative step of numbers of single precision."""
_SAC_BYTES, _SAC_VERSION_AT = 632, 304
"""Size of a SAC header and place of its version (its manual, "Data file format")."""


def read(path: Path, max_bytes: int) -> Found:
    """Return each channel, its pieces joined; missing samples between them are NaN.

    Channels that begin or end at other times are cut to what all of them have.
    """
    import obspy  # warns of its own use of others as it is imported

    stream = obspy.read(path, headonly=True)
    spans = [trace.stats.npts for trace in stream]
    refuse_above(path, 8 * sum(spans), max_bytes)
    if sum(spans) > MOST_A_BYTE * path.stat().st_size:
        raise RecordError(
            f"{path.name} has {path.stat().st_size:,} bytes and states {sum(spans):,} samples, "
            "more than can be in it: it is cut short or damaged. Get the original again."
        )
    stream = obspy.read(path)
    notes = _unread(stream)
    figures = (*_of_starts(stream), *_of_sac(path))
    names = [trace.id for trace in stream]
    if len(set(names)) < len(names):
        for trace in stream:
            trace.data = np.asarray(trace.data, dtype=float)
        lasts = max(trace.stats.endtime for trace in stream)
        span_s = float(lasts - min(trace.stats.starttime for trace in stream))
        rate = max(trace.stats.sampling_rate for trace in stream)
        refuse_above(path, int(8 * span_s * rate * len(set(names))), max_bytes)
        stream.merge(method=1, fill_value=np.nan)
    starts = [trace.stats.starttime for trace in stream]
    ends = [trace.stats.endtime for trace in stream]
    rates = {trace.stats.sampling_rate for trace in stream}
    step_s = 1.0 / max(rates)
    apart = max(starts) - min(starts) > 0.5 * step_s or max(ends) - min(ends) > 0.5 * step_s
    if len(stream) > 1 and len(rates) == 1 and apart and max(starts) < min(ends):
        stream.trim(max(starts), min(ends))
        cut = "Channels that begin or end at other times were cut to what all have."
        notes = (*notes, cut)
    first_ns = min((trace.stats.starttime.ns for trace in stream), default=0)
    shared = {network_station(trace.id) for trace in stream}
    return Found(
        [
            Series(
                trace.stats.channel if len(shared) == 1 and trace.stats.channel else trace.id,
                np.asarray(trace.data),
                rate_hz=float(trace.stats.sampling_rate),
                # Of one stream, starts that differ by less than half a sample are one.
                start_ns=first_ns
                if abs(trace.stats.starttime.ns - first_ns) < 5e8 * step_s
                else trace.stats.starttime.ns,
            )
            for trace in stream
        ],
        notes,
        {},
        figures,
    )


def _unread(stream: Any) -> tuple[str, ...]:
    """Return a note where ObsPy has left out a part of a miniSEED file.

    ObsPy skips what is no record, mostly with a warning, and sometimes ends there without one.
    """
    told = [trace.stats.mseed for trace in stream if "mseed" in trace.stats]
    if not told:
        return ()
    size = int(told[0].filesize)
    unread = size - sum(int(one.number_of_records) * int(one.record_length) for one in told)
    if unread <= 0:
        return ()
    return (
        f"{unread} of {size} bytes are no records of samples that can be read: the file is "
        "truncated or damaged. What was measured there is missing.",
    )


def _of_starts(stream: Any) -> Iterator[Figure]:
    """Return the rate that the starts of a channel's pieces imply, if none follows directly."""
    for name in dict.fromkeys(trace.id for trace in stream):
        pieces = [trace.stats for trace in stream if trace.id == name]
        if len(pieces) <= MIN_SEAMS or len({p.sampling_rate for p in pieces}) > 1:
            continue
        pieces.sort(key=lambda one: one.starttime.ns)
        starts = np.array([one.starttime.ns for one in pieces])
        counts = np.array([one.npts for one in pieces])
        implied = counts[:-1] / np.maximum(np.diff(starts) * 1e-9, 1e-12)
        usual = float(np.median(implied))
        # Losses are here and there; a wrong rate leaves the same gap or overlap everywhere.
        if np.abs(implied / usual - 1.0).max() < SEAM_TOLERANCE:
            yield Figure(usual, f"starts of the records of {name}:")


def _of_sac(path: Path) -> Iterator[Figure]:
    """Return the rate that begin, end and count of a SAC header imply."""
    with path.open("rb") as file:
        head = file.read(_SAC_BYTES)
    if path.suffix.lower() != ".sac" or len(head) < _SAC_BYTES:
        return
    little = 1 <= struct.unpack_from("<i", head, _SAC_VERSION_AT)[0] <= 7
    order = "<" if little else ">"
    begin, end = struct.unpack_from(f"{order}2f", head, 20)
    (count,) = struct.unpack_from(f"{order}i", head, 316)
    undefined = -12345.0
    blunt = _SINGLE * max(abs(begin), abs(end)) > 1e-4 * (end - begin)
    if count > 1 and undefined not in (begin, end) and not blunt:
        yield Figure((count - 1) / (end - begin), "begin, end and count:")


def network_station(trace_id: str) -> str:
    """Everything of a trace's name but its channel."""
    return trace_id.rpartition(".")[0]
