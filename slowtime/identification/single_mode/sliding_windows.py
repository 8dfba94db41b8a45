"""Identification in sliding windows of a long record or a stream."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.identification import checks
from slowtime.identification.estimates import Identified
from slowtime.identification.options import OneByOne

from .estimation import first_mode

FOLLOW_SPREAD = 0.1
"""Relative standard deviation of a frequency between two windows [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Epoch:
    """One window, in seconds since the first sample, and the modes found in it, ascending.

    `refused` says why a window was not usable at all (a gap, a dead sensor); a window that was
    usable and held no clear mode has neither.
    """

    start_s: float
    end_s: float
    modes: tuple[Identified, ...]
    refused: str | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class TrackerState:
    """What the tracker remembers between windows: the last mode that was clear."""

    last: Identified | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Tracker:
    """First mode of one window after the other, live or off line by the same steps.

    Parameters
    ----------
    rate_hz
        Samples per second [Hz].
    band_hz, method
        As in `first_mode`.
    follow
        Try the candidate nearest to the last clear mode first. It helps where a lower, weaker
        resonance comes and goes; it is off by default, for a wrong start would be followed too.
    """

    rate_hz: float
    band_hz: tuple[float, float] | None = None
    method: OneByOne = "auto"
    follow: bool = False

    def start(self) -> TrackerState:
        """Nothing seen yet."""
        return TrackerState()

    def step(
        self,
        state: TrackerState,
        window: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    ) -> tuple[TrackerState, Identified | None]:
        """Identify one window; without a clear mode the state is unchanged.

        Parameters
        ----------
        state
            State of the tracker.
        window
            Samples of the window.

        Returns
        -------
        New state, and the mode or None.
        """
        mode = first_mode(
            window,
            self.rate_hz,
            band_hz=self.band_hz,
            method=self.method,
            expected_hz=self._expected(state),
        )
        return (state if mode is None else TrackerState(mode)), mode

    def _expected(self, state: TrackerState) -> tuple[float, float] | None:
        if not self.follow or state.last is None:
            return None
        frequency = state.last.frequency_hz
        return frequency.value, float(np.hypot(frequency.sd, FOLLOW_SPREAD * frequency.value))


def identify_windows(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    window_s: float,
    hop_s: float | None = None,
    band_hz: tuple[float, float] | None = None,
    method: OneByOne = "auto",
    follow: bool = False,
) -> list[Epoch]:
    """Identify the first mode of every window of `window_s` seconds, one every `hop_s`.

    Parameters
    ----------
    samples
        The whole record, equally spaced, any unit.
    rate_hz
        Samples per second [Hz].
    window_s
        Length of a window [s]; at least a dozen cycles of the mode are advisable.
    hop_s
        From the start of a window to that of the next [s]; a whole window by default.
        Errors of windows that overlap are not independent; see `dependence`.
    band_hz, method, follow
        As in `Tracker`.

    Returns
    -------
    One epoch for each window.
    """
    given = np.asarray(samples)
    length, hop = _lengths(len(given), rate_hz, window_s, hop_s)
    if band_hz is not None:
        checks.band(band_hz, rate_hz, length)
    tracker = Tracker(rate_hz=rate_hz, band_hz=band_hz, method=method, follow=follow)
    state = tracker.start()
    epochs = []
    for first in range(0, len(given) - length + 1, hop):
        span = first / rate_hz, (first + length) / rate_hz
        try:
            state, mode = tracker.step(state, given[first : first + length])
        except ValueError as refusal:
            epochs.append(Epoch(*span, modes=(), refused=str(refusal)))
            continue
        epochs.append(Epoch(*span, modes=() if mode is None else (mode,)))
    if all(epoch.refused for epoch in epochs):
        raise ValueError(f"Not one window could be used. The first: {epochs[0].refused}")
    return epochs


def dependence(
    start_s: Float[np.ndarray, " window"], end_s: Float[np.ndarray, " window"]
) -> Float[np.ndarray, " window"]:
    r"""Factor of variance by which overlapping windows count as independent ones.

    Windows of length L, k hops h apart, share :math:`1 - k h / L` of their samples, and their
    errors are correlated as much. A mean over many has the variance of independent ones times

    .. math:: 1 + 2 \sum_{k < L / h} \left(1 - \frac{k h}{L}\right) = \frac{L}{h}

    for whole L / h. With each variance multiplied by it, estimates that take windows for
    independent know no more than the record holds, however finely it is cut.

    Parameters
    ----------
    start_s, end_s
        Of the windows, ascending [s].

    Returns
    -------
    Factor of each window [1], at least 1.

    Examples
    --------
    >>> dependence(np.array([0.0, 15.0, 30.0, 45.0]), np.array([60.0, 75.0, 90.0, 105.0]))
    array([4., 4., 4., 4.])
    >>> dependence(np.array([0.0, 60.0]), np.array([60.0, 120.0]))
    array([1., 1.])
    """
    length = end_s - start_s
    if len(length) < 2:
        return np.ones(len(length))
    apart = np.diff(start_s)
    before, after = np.append(apart[0], apart), np.append(apart, apart[-1])
    hop = 0.5 * (np.minimum(before, length) + np.minimum(after, length))
    return np.asarray(np.maximum(length / np.maximum(hop, 1e-9 * length), 1.0))


def _lengths(
    count: int, rate_hz: float, window_s: float, hop_s: float | None
) -> tuple[int, int]:
    """Window and hop in samples."""
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(
            f"rate_hz={rate_hz} is not a sampling rate. Give samples per second, a positive "
            "number."
        )
    shortest, longest = checks.SHORTEST / rate_hz, count / rate_hz
    if not shortest <= window_s <= longest * (1 + 1e-9):
        raise ValueError(
            f"window_s={window_s:g} does not fit: a window holds at least {checks.SHORTEST} "
            f"samples ({shortest:g} s) and at most the record ({longest:g} s)."
        )
    length = min(round(window_s * rate_hz), count)
    if hop_s is None:
        return length, length
    if not (np.isfinite(hop_s) and round(hop_s * rate_hz) >= 1):
        raise ValueError(
            f"hop_s={hop_s:g} is less than one sample. Give at least {1 / rate_hz:g} s."
        )
    return length, round(hop_s * rate_hz)
