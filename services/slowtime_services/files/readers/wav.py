"""WAV files, by SciPy."""

from pathlib import Path

import scipy.io.wavfile

from .found import Found, Series


def read(path: Path, max_bytes: int) -> Found:
    """Give each channel as it was quantised; what one step is, the file does not say."""
    rate, samples = scipy.io.wavfile.read(path)
    table = samples[:, None] if samples.ndim == 1 else samples
    series = [
        Series(f"channel_{i}", table[:, i], rate_hz=float(rate)) for i in range(table.shape[1])
    ]
    notes: tuple[str, ...] = ()
    if samples.dtype.kind in "iu":
        notes = (
            f"{path.name} holds integers of {8 * samples.dtype.itemsize} bits, in steps of its "
            "sound card; multiply by the sensitivity for a physical unit.",
        )
    return Found(series, notes)
