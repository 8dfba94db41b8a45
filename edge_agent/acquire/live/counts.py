"""Counters of a live sensor, which `Health` reports."""

from collections.abc import Mapping

COUNTERS: Mapping[str, str] = {
    "samples_received": "samples that came",
    "samples_lost": "samples that the device has taken and that never came",
    "samples_lost_inferred": "those of them that were inferred from time, without a counter",
    "samples_lost_unsure": "samples that may have been lost beyond those: a narrow counter may "
    "have wrapped once more in a pause, or the device have restarted in it",
    "samples_duplicated": "samples that came again",
    "samples_repeated": "samples with the values of the one before in all channels, as of a "
    "sensor that is polled faster than it measures",
    "samples_reordered": "samples that came after later ones, and were put in their place",
    "samples_late": "samples that came too late for it; they count as lost too",
    "samples_dropped": "samples dropped because the work fell behind and the queue was full",
    "samples_refused": "samples whose counter or stamp contradicts those before and after",
    "garbage_bytes": "bytes that are not what the layout declares",
    "sensor_restarts": "restarts of the device",
    "sensor_reconnects": "how often the connection was lost",
    "source_restarts": "how often a source plug-in ended or hung, and was started again",
    "sensor_bursts": "how often much came at once, after a pause",
    "sensor_silences": "how often nothing came for `silent_after_s`",
    "sensor_silent_s": "for how long nothing has come, if that is longer than it; else 0",
    "rate_changes": "how often the device has changed its rate",
    "sampling_rate_uhz": "true sampling rate, as estimated [millionths of a hertz]",
    "sampling_rate_sd_ppm": "its standard deviation, relative [millionths]",
}
"""Counters of `Health`, and what each says."""


class SampleCounts:
    """Counts, written by two threads, each its own names, and read by a third.

    Examples
    --------
    >>> tally = SampleCounts()
    >>> tally.add("samples_lost", 8)
    >>> tally["samples_lost"], tally["garbage_bytes"]
    (8, 0)
    """

    def __init__(self) -> None:
        # All names exist from the start, so the mapping never changes during iteration.
        self._counts = dict.fromkeys(COUNTERS, 0)

    def add(self, what: str, by: int = 1) -> None:
        """Count."""
        self._counts[what] += by

    def put(self, what: str, value: int) -> None:
        """Set a number."""
        self._counts[what] = value

    def __getitem__(self, what: str) -> int:
        return self._counts[what]

    def told(self) -> dict[str, int]:
        """Return all counters."""
        return dict(self._counts)
