r"""Tests whether the excitation of a record was a steady random force.

Ambient identification takes the force for random and steady. Two others are plain to see.

An earthquake, a passing train or a test with blows puts most of its energy into a small part of
the record, as the significant duration of strong-motion records measures it [1]_. A periodic
excitation, such as a multisine, makes the record repeat itself: its autocorrelation comes back
at a long lag, though many lines take part, with little in between. What is found by ambient
methods in either are the lines or the spectrum of the force.

References
----------
.. [1] M. D. Trifunac, A. G. Brady, "A study on the duration of strong earthquake ground
   motion", Bulletin of the Seismological Society of America 65 (1975).
"""

import dataclasses

import numpy as np
import scipy.fft as fft
import scipy.linalg as la
from jaxtyping import Float

from slowtime.identification.checks import check_magnitude
from slowtime.signals.spectra import detrended

PARTS = 32
"""Number of parts of a record whose energies are compared."""

ENERGY = 0.9
"""Share of the energy in `TIME`."""

TIME = 0.3
"""Share of the time that holds `ENERGY` of the energy, below which a record is an event. Of
8,000 simulated records of one mode, 0.5 to 5 half-bandwidths long, 1 in 1,000 is below 0.42."""

ORDER = 20
"""Order of the autoregression whose residual estimates the force."""

WINDOWS = 100
"""Number of windows in the test for an onset."""

QUIET = 0.01
"""Power of the force in the first window, relative to its median, below which a record begins
before the event."""

RETURN = 0.4
"""Least autocorrelation of a periodic record at its period. A multisine with odd lines whose
phases change every second period reaches 0.5."""

BETWEEN = 0.5
"""Largest autocorrelation between a quarter and three quarters of the period, relative to that
at the period."""

LINES = 12.0
"""Least effective number of lines of a periodic excitation; fewer count as machine lines."""

FEWEST_PERIODS = 2.0
"""Least number of periods in the record."""

FEWEST_SAMPLES = 16
"""Least lag that is examined; a period must be four times as long [samples]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Excitation:
    """What is plain of the force.

    Parameters
    ----------
    event_s
        Time within which 90 % of the energy came, where that is an event [s]; else None.
    onset
        Whether the force set in after the beginning of the record.
    period_s
        After which the record repeats itself [s]; else None.
    """

    event_s: float | None = None
    onset: bool = False
    period_s: float | None = None

    @property
    def is_transient(self) -> bool:
        """Whether the force came and went, or set in."""
        return self.event_s is not None or self.onset

    @property
    def flags(self) -> tuple[str, ...]:
        """Words for what is read from such a record."""
        event = ("transient_force",) if self.is_transient else ()
        return event + (("periodic_force",) if self.period_s is not None else ())


def excitation(samples: Float[np.ndarray, "time channel"], rate_hz: float) -> Excitation:
    """Tell whether the force of a record was an event, or periodic.

    Parameters
    ----------
    samples
        Channels in any unit; each counts alike.
    rate_hz
        Samples per second [Hz].

    Returns
    -------
    Duration of an event [s], whether the force sets in, and its period [s].
    """
    columns = np.asarray(samples, dtype=float)
    if columns.size:
        check_magnitude(columns)
    columns = detrended(columns)
    scale = columns.std(axis=0)
    columns = columns[:, scale > 0] / scale[scale > 0]
    if len(columns) < 4 * PARTS or columns.shape[1] == 0:
        return Excitation()
    share = energetic_share(columns)
    period = _period(columns)
    return Excitation(
        event_s=share * len(columns) / rate_hz if share < TIME else None,
        onset=_sets_in(columns),
        period_s=period / rate_hz if period is not None else None,
    )


def energetic_share(columns: Float[np.ndarray, "time channel"]) -> float:
    """Smallest share of the time that holds 90 % of the energy.

    Parameters
    ----------
    columns
        Samples of all channels, in any unit.

    Returns
    -------
    Share, 0 to 1.
    """
    power = np.sum(columns**2, axis=1)
    parts = np.array([part.sum() for part in np.array_split(power, PARTS)])
    held = np.cumsum(np.sort(parts)[::-1]) / parts.sum()
    return float(np.interp(ENERGY, np.append(0.0, held), np.arange(PARTS + 1) / PARTS))


def _sets_in(columns: Float[np.ndarray, "time channel"]) -> bool:
    """Whether the force, as an autoregression leaves it, is quiet at the beginning."""
    count = len(columns)
    length = max(count // WINDOWS, ORDER)
    padded = fft.next_fast_len(count + ORDER + 1, real=True)
    power = np.zeros(count)
    for column in columns.T:
        density = np.abs(fft.rfft(column, padded)) ** 2
        lags = fft.irfft(density, padded)[: ORDER + 1]
        lags[0] *= 1 + 1e-9
        weights = la.solve_toeplitz(lags[:-1], lags[1:])
        force = np.convolve(column, np.append(1.0, -weights))[:count]
        power += force**2 / max(float(force @ force) / count, np.finfo(float).tiny)
    windows = power[: count // length * length].reshape(-1, length).mean(axis=1)
    return bool(windows[0] < QUIET * np.median(windows))


def _period(columns: Float[np.ndarray, "time channel"]) -> int | None:
    """Lag after which a record of many lines comes back [samples]."""
    count = len(columns)
    padded = fft.next_fast_len(2 * count, real=True)
    density = (np.abs(fft.rfft(columns, padded, axis=0)) ** 2).sum(axis=1)
    longest = int(count / FEWEST_PERIODS)
    lags = np.arange(longest + 1)
    # The envelope, by the positive frequencies alone: correlations of a mode cross zero.
    analytic = fft.ifft(np.append(density, np.zeros(padded - len(density))))
    correlation = np.abs(analytic[: longest + 1]) / (count - lags)
    correlation = correlation / correlation[0]
    # As far as it falls off from lag 0 it says nothing.
    fallen = np.flatnonzero(correlation < RETURN * BETWEEN)
    first = max(FEWEST_SAMPLES, int(fallen[0])) if len(fallen) else longest
    if first >= longest:
        return None
    top = float(correlation[first:].max())
    if top < RETURN:
        return None
    lag = first + int(np.argmax(correlation[first:] >= 0.95 * top))
    lag += int(np.argmax(correlation[lag : lag + max(lag // 10, 1)]))
    between = correlation[lag // 4 : 3 * lag // 4]
    if lag < 4 * FEWEST_SAMPLES or between.max() > BETWEEN * top:
        return None
    width = padded / lag
    groups = max(1, int(len(density) / width))
    power = np.array([part.sum() for part in np.array_split(density, groups)])
    effective = power.sum() ** 2 / np.sum(power**2)
    return lag if effective >= LINES else None
