"""Window, median and EWMA for a frequency that is to be watched."""

import math
from typing import Literal

from slowtime.identification.single_mode.bounds import ambient_law
from slowtime.identification.single_mode.spectral_peak import inefficiency
from slowtime.signals.smoother_choice import SmootherChoice
from slowtime.signals.smoother_choice import choose_smoother as choose
from slowtime_services.argument_checks import Positive, checked

__all__ = ["SmootherChoice", "choose_smoother"]

LAW_FROM = 20.0
"""[time constants of the free decay] Window from which on the law of errors holds."""
REACH = 2.0
"""[half-power half widths] Half of the band that the law of errors supposes."""


@checked
def choose_smoother(
    frequency_hz: Positive,
    damping_ratio: Positive,
    *,
    drop: Positive,
    within_s: Positive,
    false_alarms_per_year: Positive,
    method: Literal["peak", "ambient"] = "peak",
    sd_hz: Positive | None = None,
    sd_window_s: Positive = 60.0,
    outliers_in_a_row: int = 2,
    probability: float = 0.9,
) -> SmootherChoice:
    """Choose window, median and EWMA so that a sudden drop of a frequency is noticed in time.

    Parameters
    ----------
    frequency_hz
        Natural frequency [Hz].
    damping_ratio
        Damping ratio [1].
    drop
        Sudden relative fall of the frequency to be noticed [1], below 1; half as large as the
        relative loss of stiffness behind it.
    within_s
        Time from the fall to the alarm [s].
    false_alarms_per_year
        Expected number while nothing changes [1/year].
    method
        Of the edge agent: ``peak`` is the FFT, ``ambient`` the likelihood. Where `sd_hz` is
        not given, errors follow the uncertainty law of a response to white noise [1]_.
    sd_hz, sd_window_s
        Scatter of single readings as you have measured it [Hz], and their window [s].
    outliers_in_a_row
        Wrong readings, one after the other, that must not move the smoothed value.
    probability
        With which the fall is noticed within the time [1].

    Returns
    -------
    Window [s], readings of the median, weight of the EWMA [1], the relative fall at which to
    alarm [1], and the smallest drop that is noticed in time [1].

    Raises
    ------
    ValueError
        For numbers that are impossible, and where no choice notices such a drop in time: it
        says which drop can be noticed.

    References
    ----------
    .. [1] S.-K. Au, "Uncertainty law in ambient modal identification", MSSP 48 (2014).

    Examples
    --------
    >>> found = choose_smoother(3.0, 0.01, drop=0.01, within_s=86_400.0,
    ...     false_alarms_per_year=1.0)
    >>> found.median_window, found.smallest_drop < 0.01
    (5, True)
    """
    shortest_s = LAW_FROM / (2.0 * math.pi * frequency_hz * damping_ratio)
    if sd_hz is None:
        cycles = frequency_hz * shortest_s
        loss = inefficiency(damping_ratio * cycles) if method == "peak" else 1.0
        sd = loss * ambient_law(damping_ratio, cycles, reach=REACH)[0]
        sd_window_s = shortest_s
    else:
        sd = sd_hz / frequency_hz
    return choose(
        drop=drop, within_s=within_s, false_alarms_per_year=false_alarms_per_year, sd=sd,
        sd_window_s=sd_window_s, shortest_window_s=shortest_s,
        outliers_in_a_row=outliers_in_a_row, probability=probability,
    )  # fmt: skip
