"""WAV files, by SciPy."""

import struct
from pathlib import Path

import numpy as np
import scipy.io.wavfile

from .found import Figure, Found, Series

HEAD_BYTES = 4096
MIDDLE_OF_BYTES = 128
"""Value of silence in samples of 8 bits, which have no sign."""
PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
"""Codes of formats whose frames are of one size."""


def read(path: Path, max_bytes: int) -> Found:
    """Return each channel as quantised; the file does not state the size of a step."""
    rate, samples = scipy.io.wavfile.read(path)
    bits = _bits(path) or 8 * samples.dtype.itemsize
    if samples.dtype == np.int32 and bits == 24:
        samples = samples >> 8  # SciPy moves three bytes to the upper end of four
    elif samples.dtype == np.uint8:
        samples = samples.astype(np.int16) - MIDDLE_OF_BYTES
    table = samples[:, None] if samples.ndim == 1 else samples
    series = [
        Series(f"channel_{i}", table[:, i], rate_hz=float(rate)) for i in range(table.shape[1])
    ]
    notes: tuple[str, ...] = ()
    if samples.dtype.kind in "iu":
        notes = (
            f"{path.name} holds integers of {bits} bits, in steps of its "
            "sound card. Give --reading sensitivity, such as 16384counts/g, for accelerations.",
        )
    return Found(series, notes, {}, _figures(path))


def _format_chunk(path: Path) -> tuple[int, int, int, int, int, int] | None:
    """Read code, channels, rate [Hz], bytes a second, bytes a frame and bits a sample."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    at = head.find(b"fmt ")
    if at < 0 or len(head) < at + 24:
        return None
    order = ">" if head[:4] == b"RIFX" else "<"
    form, width, rate, a_second, a_frame, bits = struct.unpack_from(
        f"{order}HHIIHH", head, at + 8
    )
    return form, width, rate, a_second, a_frame, bits


def _bits(path: Path) -> int | None:
    """Read the bits of a sample that the header states."""
    chunk = _format_chunk(path)
    return None if chunk is None else chunk[-1]


def _figures(path: Path) -> tuple[Figure, ...]:
    """Read the rate that bytes a second and bytes a frame make, which the header states too."""
    chunk = _format_chunk(path)
    if chunk is None:
        return ()
    form, _, _, a_second, a_frame, _ = chunk
    if form not in (PCM, FLOAT, EXTENSIBLE) or not a_frame:
        return ()
    return (Figure(a_second / a_frame, "bytes a second over bytes a frame:"),)
