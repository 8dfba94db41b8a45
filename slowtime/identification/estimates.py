"""Estimates of an identification: values with standard deviations, and warning flags."""

import dataclasses
import math
from statistics import NormalDist


@dataclasses.dataclass(frozen=True, slots=True)
class Measured:
    """A value and its standard deviation, in the unit of the field that holds it."""

    value: float
    sd: float

    def __float__(self) -> float:
        return self.value

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Symmetric interval of a Gaussian error.

        Parameters
        ----------
        level
            Probability of the interval.

        Returns
        -------
        Lower and upper limit, in the unit of the value.

        Examples
        --------
        >>> low, high = Measured(10.0, 1.0).interval()
        >>> round(low, 2), round(high, 2)
        (8.04, 11.96)
        """
        reach = NormalDist().inv_cdf(0.5 + level / 2) * self.sd
        return self.value - reach, self.value + reach


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    r"""One mode of vibration, read off one record or one part of it.

    Parameters
    ----------
    frequency_hz
        Undamped natural frequency :math:`|s| / 2 \pi` of the pole s [Hz].
    damping_ratio
        :math:`-\mathrm{Re}\, s / |s|` [1].
    correlation
        Between the errors of frequency and of damping ratio.
    snr_db
        Of the mode: peak density over noise floor (ambient), power at the first instant over
        noise variance (free decay) [dB].
    amplitude
        Of the mode in the unit of the samples: standard deviation (ambient), amplitude at the
        first instant (free decay).
    method
        `free_decay`, `ambient` or `peak`.
    span_s
        First and last second of the record that the fit used.
    flags
        Words on what to mistrust, such as `below_threshold`.
    """

    frequency_hz: Measured
    damping_ratio: Measured
    correlation: float
    snr_db: float | None
    amplitude: float
    method: str
    span_s: tuple[float, float]
    flags: tuple[str, ...] = ()

    def damping_interval(self, level: float = 0.95) -> tuple[float, float]:
        """Interval of the damping ratio for a Gaussian error of its logarithm.

        It stays positive, and is the better one where the damping is known to worse than
        about a fifth. A damping that was not found positive has the plain interval.

        Parameters
        ----------
        level
            Probability of the interval.

        Returns
        -------
        Lower and upper limit [1].
        """
        value, sd = self.damping_ratio.value, self.damping_ratio.sd
        if value <= 0:
            return self.damping_ratio.interval(level)
        factor = math.exp(NormalDist().inv_cdf(0.5 + level / 2) * sd / value)
        return value / factor, value * factor
