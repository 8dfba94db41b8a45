"""Envelope spectra of machines, and the lines of damaged bearings in them."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from slowtime.signals.envelopes import envelope_spectra
from slowtime.signals.envelopes.fault_frequencies import BearingFrequencies
from slowtime.signals.envelopes.fault_frequencies import bearing_frequencies as frequencies_of
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import Bounds, Count, Positive, checked
from slowtime_services.files import bridged

LEAST_P = 1e-12
"""[1] Smallest probability that is stated; below it the law of the noise is not known."""

STRONGEST = 20
"""Lines of the table, the strongest ones."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class EnvelopeSpectrum(Result):
    """Spectrum of the squared envelope of a band of one channel.

    Parameters
    ----------
    channel
        Name of the channel.
    band_hz
        The band [Hz].
    spectrum
        ``frequency_hz`` [Hz], ``amplitude`` relative to the mean [1], and ``over_noise``, the
        power relative to what noise would give [1].
    notes
        What was assumed about the record.
    """

    channel: str
    band_hz: tuple[float, float]
    spectrum: envelope_spectra.EnvelopeSpectrum
    notes: tuple[str, ...]

    @property
    def heading(self) -> str:
        """What was computed, in a line."""
        low, high = self.band_hz
        return f"Envelope of {self.channel} between {low:g} and {high:g} Hz, strongest lines"

    def rows(self) -> list[dict[str, Any]]:
        """Return the strongest lines.

        Returns
        -------
        One dictionary each: ``frequency_hz``, ``amplitude`` and ``over_noise``, from the
        strongest one down.
        """
        frequency, amplitude, over_noise = self.spectrum
        return [
            {
                "frequency_hz": float(frequency[k]),
                "amplitude": float(amplitude[k]),
                "over_noise": float(over_noise[k]),
            }
            for k in np.argsort(-over_noise)[:STRONGEST]
        ]

    @checked
    def line(
        self,
        frequency_hz: Positive,
        *,
        multiples: Count = 2,
        within: Annotated[float, Bounds(least=0, most=0.2)] = 0.02,
    ) -> envelope_spectra.Family:
        """Test whether a frequency is in the envelope, with its multiples.

        Parameters
        ----------
        frequency_hz
            Frequency of impacts [Hz], as `bearing_frequencies` gives it.
        multiples
            How many lines must be there, the frequency itself included.
        within
            Relative deviation that is looked through [1]; bearings slip by 1 to 2 %.

        Returns
        -------
        ``p_value``, the probability of so strong a weakest line by chance (never stated below
        1e-12); ``frequency_hz`` found and its ``sd_hz``; ``over_noise`` of each multiple.

        Raises
        ------
        ValueError
            If a multiple lies beyond the spectrum.
        """
        found = envelope_spectra.family(self.spectrum, frequency_hz, multiples, within)
        return found._replace(p_value=max(found.p_value, LEAST_P))

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the spectrum.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        axes = new_figure()[0]
        axes.plot(self.spectrum.frequency_hz, self.spectrum.amplitude, linewidth=0.7)
        axes.set(xlabel="frequency [Hz]", ylabel="squared envelope, relative to its mean [1]")
        return save(axes, path)


@checked
def envelope_spectrum(
    signals: Signals,
    channel: str | None = None,
    *,
    band_hz: tuple[float, float] | None = None,
    impacts_hz: Positive = 200.0,
) -> EnvelopeSpectrum:
    """Compute the spectrum of the squared envelope of a band.

    Damaged bearings and gears strike at low frequencies and excite resonances at high ones. The
    envelope of a resonance shows the strikes.

    Parameters
    ----------
    signals
        Vibration of a machine.
    channel
        Channel to use; may be left out where there is only one.
    band_hz
        Lower and upper edge [Hz]; where not given, the band with the highest kurtosis [1]_.
    impacts_hz
        Highest frequency of impacts to be looked for [Hz]; bands that are tried are at least
        four times as wide, so that two lines of it fit into the spectrum.

    Returns
    -------
    The spectrum; its method `line` tests a frequency.

    Raises
    ------
    ValueError
        If there are several channels and none is named, or the band does not fit the rate.

    References
    ----------
    .. [1] J. Antoni, "Fast computation of the kurtogram for the detection of transient faults",
       Mechanical Systems and Signal Processing 21 (2007) 108-124.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> strikes = (np.arange(60_000) % 80 == 0) * 1.0          # 150 per second
    >>> ringing = np.exp(-np.arange(60) / 10) * np.sin(2 * np.pi * 0.25 * np.arange(60))
    >>> x = np.convolve(strikes, ringing, "same") + 0.2 * rng.standard_normal(60_000)
    >>> found = envelope_spectrum(Signals(x, 12_000.0)).line(149.0)
    >>> round(found.frequency_hz, 1), found.p_value < 1e-6
    (150.0, True)
    """
    if channel is None and len(signals.channels) > 1:
        raise ValueError(
            f"The signals have the channels {', '.join(signals.channels)}. Name one."
        )
    record, said = bridged(signals[channel or signals.channels[0]].record)
    samples, half = np.asarray(record.samples, dtype=float)[:, 0], record.rate_hz / 2
    if not samples.any():
        raise ValueError(f"All samples of {record.channels[0]} are zero. Give a vibration.")
    narrowest = 4 * impacts_hz
    if band_hz is None:
        if 2 * narrowest > half:
            raise ValueError(
                f"impacts_hz={impacts_hz:g} needs bands of {narrowest:g} Hz, and the record "
                f"goes to {half:g} Hz. Give at most {half / 8:g}, or a band_hz."
            )
        band = envelope_spectra.most_impulsive_band(samples, record.rate_hz, narrowest)
    else:
        band = envelope_spectra.Band(*band_hz)
        if not 0 < band.low < band.high <= half:
            raise ValueError(
                f"band_hz={band_hz} was given. Give two increasing frequencies above 0 and up "
                f"to {half:g} Hz."
            )
    return EnvelopeSpectrum(
        channel=record.channels[0], band_hz=(band.low, band.high),
        spectrum=envelope_spectra.envelope_spectrum(samples, record.rate_hz, band),
        notes=(said,) if said else (),
    )  # fmt: skip


@checked
def bearing_frequencies(
    shaft_hz: Positive,
    *,
    elements: Count,
    diameter: Positive,
    pitch: Positive,
    contact_angle_deg: Annotated[float, Bounds(least=0, below=90)] = 0.0,
) -> BearingFrequencies:
    """Compute the frequencies at which parts of a rolling bearing meet a defect.

    Parameters
    ----------
    shaft_hz
        Rotation of the inner race [Hz]; the outer one stands still.
    elements
        Number of rolling elements.
    diameter, pitch
        Of a rolling element, and of the circle of their centres, in the same unit.
    contact_angle_deg
        Angle of contact [degrees].

    Returns
    -------
    ``outer_race``, ``inner_race``, ``rolling_element`` and ``cage`` [Hz], without slip.

    Raises
    ------
    ValueError
        If the elements are not smaller than their circle.

    Examples
    --------
    >>> round(bearing_frequencies(29.95, elements=9, diameter=7.94, pitch=39.04).inner_race, 1)
    162.2
    """
    if diameter >= pitch:
        raise ValueError(
            f"diameter={diameter:g} is not below pitch={pitch:g}. Give the diameter of a "
            "rolling element and that of the circle of their centres, in the same unit."
        )
    return frequencies_of(shaft_hz, elements, diameter, pitch, contact_angle_deg)
