"""Input validation: samples, sampling rate and search band of an identification."""

import numpy as np
from jaxtyping import Bool, Float

from slowtime.signals.spectra import detrended

SHORTEST = 32
"""Least number of samples."""

SMALLEST, LARGEST = 1e-100, 1e100
"""Range of the largest absolute sample, in its unit: its square times any number of samples
then stays within double precision (2.2e-308 to 1.8e308)."""


def series(samples: np.ndarray, rate_hz: float) -> Float[np.ndarray, "time channel"]:
    """Check a record and return it as float columns.

    What is in order already is given back as it is, not copied: it is not to be written into.

    Samples are real numbers, (time,) or (time, channel), in any unit. A channel that does not
    move is left out as long as another one does.
    """
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(
            f"rate_hz={rate_hz} is not a sampling rate. Give samples per second, a positive "
            "number."
        )
    given = np.asarray(samples)
    if np.iscomplexobj(given) or given.dtype.kind not in "iuf":
        raise ValueError(
            f"Samples of type {given.dtype} were given. Allowed are real numbers; give the "
            "measured signal itself, not its transform."
        )
    columns = given[:, None] if given.ndim == 1 else given
    if columns.ndim != 2 or columns.shape[1] == 0:
        raise ValueError(
            f"Samples of shape {given.shape} were given. Allowed are (time,) and "
            "(time, channel); put instants in rows and channels in columns."
        )
    if len(columns) < SHORTEST:
        raise ValueError(
            f"{len(columns)} samples were given, at least {SHORTEST} are needed. Give a "
            f"longer record (and if shape {given.shape} is channels by time, transpose it)."
        )
    columns = columns.astype(float, copy=False)
    bad = np.count_nonzero(~np.isfinite(columns))
    if bad:
        raise ValueError(
            f"{bad} of {columns.size} samples are NaN or infinite, the first in row "
            f"{int(np.argmax(~np.isfinite(columns).all(axis=1)))}. Give finite "
            "samples: cut the record at the gap, or fill it, before identification."
        )
    check_magnitude(columns)
    varies = moving(columns)
    return columns if varies.all() else columns[:, varies]


def check_magnitude(columns: Float[np.ndarray, "time channel"]) -> None:
    """Check that the squares of the samples are within double precision.

    Raises `ValueError` if the largest is beyond `SMALLEST` to `LARGEST`, and is not 0.
    """
    largest = max(float(columns.max()), -float(columns.min()))
    if largest and not SMALLEST < largest < LARGEST:
        raise ValueError(
            f"The largest sample is {largest:.3g}. Its square is beyond double precision; "
            f"scale the samples to between {SMALLEST:g} and {LARGEST:g}."
        )


def moving(columns: Float[np.ndarray, "time channel"]) -> Bool[np.ndarray, " channel"]:
    """Channels that vary by more than rounding."""
    spread = np.ptp(columns, axis=0)
    largest = np.maximum(columns.max(axis=0), -columns.min(axis=0))
    varies = spread > 1e-12 * largest
    if not varies.any():
        raise ValueError(
            f"Every one of {columns.shape[1]} channels is constant over {len(columns)} "
            "samples. Check the sensor, its cable and the channel selection."
        )
    return np.asarray(varies)


def band(
    band_hz: tuple[float, float] | None, rate_hz: float, count: int
) -> tuple[float, float]:
    """Search band, by default from four cycles in the record to 0.45 of the rate."""
    nyquist = rate_hz / 2
    if band_hz is None:
        return 4.0 * rate_hz / count, 0.9 * nyquist
    low, high = (float(edge) for edge in band_hz)
    if not (np.isfinite([low, high]).all() and 0 < low < high < nyquist):
        raise ValueError(
            f"band_hz=({low:g}, {high:g}) is not a band between 0 and {nyquist:g} Hz, half the "
            f"sampling rate. Give 0 < low < high < {nyquist:g} Hz, or sample faster."
        )
    if (high - low) * count / rate_hz < 4:
        raise ValueError(
            f"band_hz=({low:g}, {high:g}) is narrower than 4 frequency bins of a record of "
            f"{count / rate_hz:g} s. Widen it by {4 * rate_hz / count:g} Hz, or record longer."
        )
    return low, high


def modelled_band(
    band_hz: tuple[float, float] | None, default_hz: tuple[float, float]
) -> tuple[float, float]:
    """Band that is modelled where modes of `band_hz` are asked for."""
    # Neighbours and noise floor come from the whole record, because a skirt whose mode is left
    # out would widen the modes that are left. The defaults may be in the wrong order in a short
    # record.
    if band_hz is None:
        return default_hz
    return min(band_hz[0], default_hz[0]), max(band_hz[1], default_hz[1])


def is_inside(frequency_hz: float, band_hz: tuple[float, float] | None) -> bool:
    """Whether a mode is reported where `band_hz` is asked for."""
    return band_hz is None or bool(band_hz[0] <= frequency_hz <= band_hz[1])


def share_below(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, low_hz: float
) -> float:
    """Return the largest share, among channels, of the variance in lines up to a frequency [1].

    A straight line is taken out of each channel; 0 where none moves.
    """
    power = np.abs(np.fft.rfft(detrended(samples), axis=0)[1:]) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1 / rate_hz)[1:]
    whole = power.sum(axis=0)
    below = power[frequency <= low_hz * (1 + 1e-9)].sum(axis=0)
    return float(np.max(below[whole > 0] / whole[whole > 0], initial=0.0))
