"""Formats of seismology, by ObsPy: miniSEED, SAC, GCF, SEG-2."""

from pathlib import Path

import numpy as np
import obspy

from slowtime_services.files.arrays import refuse_above

from .found import Found, Series


def read(path: Path, max_bytes: int) -> Found:
    """Give each channel, its pieces put together; what is missing between them is NaN.

    Channels that begin or end at other times are cut to what all of them have.
    """
    stream = obspy.read(path, headonly=True)
    spans = [trace.stats.npts for trace in stream]
    refuse_above(path, 8 * sum(spans), max_bytes)
    stream = obspy.read(path)
    names = [trace.id for trace in stream]
    if len(set(names)) < len(names):
        for trace in stream:
            trace.data = np.asarray(trace.data, dtype=float)
        lasts = max(trace.stats.endtime for trace in stream)
        span_s = float(lasts - min(trace.stats.starttime for trace in stream))
        rate = max(trace.stats.sampling_rate for trace in stream)
        refuse_above(path, int(8 * span_s * rate * len(set(names))), max_bytes)
        stream.merge(method=1, fill_value=np.nan)
    notes: tuple[str, ...] = ()
    starts = [trace.stats.starttime for trace in stream]
    ends = [trace.stats.endtime for trace in stream]
    rates = {trace.stats.sampling_rate for trace in stream}
    step_s = 1.0 / max(rates)
    apart = max(starts) - min(starts) > 0.5 * step_s or max(ends) - min(ends) > 0.5 * step_s
    if len(stream) > 1 and len(rates) == 1 and apart and max(starts) < min(ends):
        stream.trim(max(starts), min(ends))
        notes = ("Channels that begin or end at other times were cut to what all have.",)
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
    )


def network_station(trace_id: str) -> str:
    """Everything of a trace's name but its channel."""
    return trace_id.rpartition(".")[0]
