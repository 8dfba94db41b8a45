"""Frequency and damping along a free decay."""

from slowtime.identification.free_decay.amplitude_law import DecayLaw, decay_law
from slowtime.identification.free_decay.envelope import decay_envelope
from slowtime_services.argument_checks import NotNegative, Positive, checked

from .signals import Signals

__all__ = ["DecayLaw", "fit_decay"]


@checked
def fit_decay(
    signals: Signals,
    *,
    near_hz: Positive | None = None,
    band_hz: tuple[float, float] | None = None,
    start_s: NotNegative = 0.0,
) -> DecayLaw:
    """Follow one mode along a free decay: frequency and damping against amplitude.

    Parameters
    ----------
    signals
        A free decay, with whatever came before its release. All channels are used together.
    near_hz
        Frequency near which the mode is [Hz]; where not given, that of the strongest line.
    band_hz
        Band of the mode [Hz]; where not given, all that the record can show.
    start_s
        Time before which nothing is used [s]. The decay begins where the motion is largest, or
        where a drive stops.

    Returns
    -------
    Frequencies [Hz] and damping ratios [1] at amplitudes from the largest to the smallest, with
    standard deviations, and the law of damping: viscous, quadratic, dry friction or their sums,
    by the Bayesian information criterion. Amplitudes have the unit of
    ``signals.channels[law.channel]``. Only where `DecayLaw.one_number` is true, one frequency
    and one damping ratio hold along the whole decay; `DecayLaw.sentence` says it in words.

    Raises
    ------
    ValueError
        If the record has gaps, no motion in the band, or too few cycles above the noise.
    TypeError
        If `signals` are no `Signals`, or an argument is no number.

    References
    ----------
    .. [1] B. F. Feeny and J. W. Liang, "A decrement method for the simultaneous estimation of
       Coulomb and viscous friction", Journal of Sound and Vibration 195 (1996) 149-154.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0, 20, 0.01)
    >>> law = fit_decay(Signals(np.exp(-0.2 * t) * np.cos(20 * t), rate_hz=100.0))
    >>> law.one_number, round(float(law.damping[0]), 4)
    (True, 0.01)
    """
    if not start_s < signals.duration_s:
        raise ValueError(
            f"start_s={start_s:g} was given. Give seconds from 0 to {signals.duration_s:g}."
        )
    if signals.record.gaps:
        raise ValueError(
            "Samples are missing within the signals. Give a part without gaps, by "
            "signals.between(first_s, last_s)."
        )
    return decay_law(
        decay_envelope(
            signals.samples, signals.rate_hz, start_s, band_hz=band_hz, near_hz=near_hz
        )
    )
