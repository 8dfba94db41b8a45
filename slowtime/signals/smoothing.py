r"""Two-stage smoother of slow-time series: running median, then EWMA.

It answers with every reading, and says with it how late it is and how sure. The delay is the
mean age of the readings it rests on, in full swing :math:`K + (1 - a) / a` readings for a
median over :math:`2 K + 1`; a frequency that drifts by :math:`\dot f` per reading is shown too
high or too low by that many times :math:`\dot f`, which its standard deviation does not hold.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from .filters import check_odd_window, check_weight

FORGOTTEN = 1e-6
"""Weight below which an old reading no longer counts."""


@dataclasses.dataclass(frozen=True, slots=True)
class Smooth:
    """A smoothed reading.

    Parameters
    ----------
    value, sd
        In the unit of the readings; the standard deviation is that of the noise that is left.
    lag
        Mean age of the readings behind it, in readings.
    """

    value: float
    sd: float
    lag: float


@dataclasses.dataclass(frozen=True, slots=True)
class SmootherState:
    """The latest readings, and how much each still weighs (the newest last)."""

    readings: tuple[float, ...] = ()
    average: float = math.nan
    weights: Float[np.ndarray, " age"] = dataclasses.field(default_factory=lambda: np.zeros(0))
    variances: Float[np.ndarray, " age"] = dataclasses.field(
        default_factory=lambda: np.zeros(0)
    )


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MedianEwma:
    """Median of the latest `window` readings, then EWMA with weight `a`.

    Examples
    --------
    >>> smoother = MedianEwma(window=3, a=0.5)
    >>> state = smoother.start()
    >>> for reading in (5.0, 5.0, 9.0, 5.0):
    ...     state, smooth = smoother.step(state, reading, 0.1)
    >>> smooth.value, round(smooth.lag, 3)
    (5.0, 1.688)
    """

    window: int = 5
    a: float = 0.3

    def __post_init__(self) -> None:
        """Refuse a window without a middle, and a weight that is none."""
        check_odd_window(self.window)
        check_weight(self.a)

    @property
    def lag(self) -> float:
        """Delay in full swing, in readings."""
        return (self.window - 1) / 2 + (1 - self.a) / self.a

    def start(self) -> SmootherState:
        """Begin with nothing seen."""
        return SmootherState()

    def step(
        self, state: SmootherState, value: float, sd: float
    ) -> tuple[SmootherState, Smooth]:
        """Process one reading; both numbers must be finite.

        Parameters
        ----------
        state
            State of the smoother.
        value
            Reading.
        sd
            Standard deviation.

        Returns
        -------
        New state, and the smoothed reading.
        """
        if not (math.isfinite(value) and math.isfinite(sd) and sd >= 0):
            raise ValueError(
                f"{value=} with {sd=} cannot be smoothed. Give finite numbers, and leave a "
                "missing reading out."
            )
        readings = (*state.readings, value)[-self.window :]
        middle = float(np.median(readings))
        first = not state.readings
        a = 1.0 if first else self.a
        average = middle if first else a * middle + (1 - a) * state.average
        weights = np.append((1 - a) * state.weights, 0.0)
        weights[-len(readings) :] += a / len(readings)
        variances = np.append(state.variances, sd**2)
        kept = slice(int(np.argmax(weights >= FORGOTTEN)), None)
        weights, variances = weights[kept], variances[kept]
        ages = np.arange(len(weights))[::-1]
        noise = median_penalty(len(readings)) * float(weights**2 @ variances)
        smooth = Smooth(average, math.sqrt(noise), float(weights @ ages))
        return SmootherState(readings, average, weights, variances), smooth


def median_penalty(count: int) -> float:
    r"""Variance of the median of Gaussian readings over that of their mean.

    1 for one or two readings, rising to :math:`\pi / 2`. Order statistics for small counts, and
    for larger ones a fit that is within 1 %. Neighbouring medians share readings in a way that
    an EWMA averages a little better than it would their means, so that the standard deviation
    of the two stages together is up to 6 % on the safe side.

    Returns
    -------
    Ratio [1].
    """
    if count in _EXACT_PENALTY:
        return _EXACT_PENALTY[count]
    return math.pi / 2 * (1 - (0.45 if count % 2 else 1.2) / count)


_EXACT_PENALTY = {1: 1.0, 2: 1.0, 3: 1.346, 4: 1.193, 5: 1.434, 6: 1.288, 7: 1.473}
