"""An identifier: the highest peak of a window, and its width at half of its power."""

from typing import Any

import numpy as np

PIECES = 8


def identify(
    samples: np.ndarray, rate_hz: float, channels: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Give the mode of the highest peak; its errors from the scatter between pieces."""
    length = len(samples) // PIECES
    pieces = samples[: length * PIECES].reshape(PIECES, length, -1)
    taper = np.hanning(length)[:, None]
    power = (
        np.abs(np.fft.rfft((pieces - pieces.mean(1, keepdims=True)) * taper, axis=1)) ** 2
    ).sum(2)
    frequency = np.fft.rfftfreq(length, 1 / rate_hz)
    peaks = frequency[1 + power[:, 1:].argmax(1)]
    mean = power.mean(0)
    top = 1 + int(mean[1:].argmax())
    half = np.count_nonzero(mean[max(1, top - 20) : top + 21] > 0.5 * mean[top])
    width_hz = half * frequency[1]
    centre = slice(max(1, top - 2), top + 3)
    value = float(np.average(frequency[centre], weights=mean[centre]))
    sd = float(max(peaks.std() / np.sqrt(PIECES), frequency[1] / np.sqrt(12 * PIECES)))
    damping = width_hz / 2 / value
    return [
        {
            "frequency_hz": {"value": value, "sd": sd},
            "damping_ratio": {"value": float(damping), "sd": float(damping)},
        }
    ]
