"""WAV files, by SciPy."""

import struct
from pathlib import Path

import scipy.io.wavfile

from .found import Figure, Found, Series

HEAD_BYTES = 4096
PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
"""Codes of formats whose frames are of one size."""


def read(path: Path, max_bytes: int) -> Found:
    """Return each channel as quantised; the file does not state the size of a step."""
    rate, samples = scipy.io.wavfile.read(path)
    table = samples[:, None] if samples.ndim == 1 else samples
    series = [
        Series(f"channel_{i}", table[:, i], rate_hz=float(rate)) for i in range(table.shape[1])
    ]
    notes: tuple[str, ...] = ()
    if samples.dtype.kind in "iu":
        notes = (
            f"{path.name} holds integers of {8 * samples.dtype.itemsize} bits, in steps of its "
            "sound card. Give --sensitivity, such as 16384counts/g, for accelerations.",
        )
    return Found(series, notes, {}, _figures(path))


def _figures(path: Path) -> tuple[Figure, ...]:
    """Read the rate that bytes a second and bytes a frame make, which the header states too."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    at = head.find(b"fmt ")
    if at < 0 or len(head) < at + 24:
        return ()
    order = ">" if head[:4] == b"RIFX" else "<"
    form, _, _, a_second, a_frame = struct.unpack_from(f"{order}HHIIH", head, at + 8)
    if form not in (PCM, FLOAT, EXTENSIBLE) or not a_frame:
        return ()
    return (Figure(a_second / a_frame, "bytes a second over bytes a frame:"),)
