r"""Phase differences between two boards at the modes that both measure.

Where both boards see the same mode, and the second one's time axis is off by :math:`\delta`,
the cross-spectra at its frequency f are

.. math:: S_{ij}(f) = \phi_i \phi_j \, |H(f)|^2 \, e^{-2 \pi i f \delta}

for real mode shapes :math:`\phi`, whose sign is not known. It goes with the square: half the
angle of :math:`\sum_{ij} S_{ij}^2` is :math:`-2 \pi f \delta` up to multiples of :math:`\pi`.
Noise that the boards do not share has no cross-spectrum. With :math:`\delta` growing steadily,
because their rates differ, stretches of the record tell one after the other.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.detection.resonance_peaks import detect_peaks
from slowtime.signals.spectra import detrended

STRETCHES = 8
"""Parts of a record between which the phase may move."""
LEAST_CYCLES = 40.0
"""Of the lowest mode in a stretch."""
REACH = 0.02
"""Of its frequency, on either side: what is read of a mode's peak."""
HANN_WORTH = 1.94
"""Neighbouring ordinates under a Hann window count as one."""
FALSE_ALARM = 1e-6
"""That channels without anything in common pass for common motion at one frequency."""
COMPLEX_RAD = 0.05
"""Phase between parts of one mode where damping is not proportional: 3 degrees, one sd; mean
phase deviations of well separated modes of bridges and towers are 1 to 5 degrees."""


@dataclasses.dataclass(frozen=True, slots=True)
class SharedMode:
    """Cross-spectra of the two boards at a mode that both see.

    Parameters
    ----------
    cross
        Channels of one board by channels of the other, for each stretch.
    power
        Product of what both boards see in all of the band, the square of what `cross` would
        sum to if they saw nothing but the mode.
    ordinates
        Independent ones in each stretch.
    """

    frequency_hz: float
    cross: Complex[np.ndarray, "stretch first second"]
    power: float
    ordinates: float

    def along(
        self, drift: float, times_s: Float[np.ndarray, " stretch"]
    ) -> tuple[float, float, float]:
        """Phase in (-pi/2, pi/2] of all stretches together, its sd [rad], and coherence.

        The second board's axis falls back by `drift` seconds per second; times are about the
        middle of the record.
        """
        turn = np.exp(-2j * np.pi * self.frequency_hz * drift * times_s)
        total = np.einsum("s,sij->ij", turn, self.cross)
        return self._phase(total, self.power, self.ordinates * len(times_s))

    def apart(self) -> list[tuple[float, float]]:
        """Phase and its sd [rad] of each stretch alone."""
        count = len(self.cross)
        each = self.power / count**2
        return [self._phase(cross, each, self.ordinates)[:2] for cross in self.cross]

    def _phase(
        self, cross: Complex[np.ndarray, "first second"], power: float, ordinates: float
    ) -> tuple[float, float, float]:
        coherence = min(float(np.sum(np.abs(cross) ** 2)) / power, 1.0 - 1e-6)
        known = max((coherence - 1 / ordinates) / (1 - 1 / ordinates), 1e-6)
        sd = np.sqrt((1 - known) / (2 * known * ordinates))
        return float(np.angle(np.sum(cross**2)) / 2), float(min(sd, np.pi)), coherence

    @property
    def least_coherence(self) -> float:
        """Coherence that nothing in common would hardly reach."""
        count = max(self.ordinates * len(self.cross), 2.0)
        return float(1.0 - FALSE_ALARM ** (1.0 / (count - 1.0)))


def shared_modes(
    first: Float[np.ndarray, "time first"],
    second: Float[np.ndarray, "time second"],
    rate_hz: float,
    band_hz: tuple[float, float],
) -> tuple[tuple[SharedMode, ...], Float[np.ndarray, " stretch"]]:
    """Modes that both boards measure, and the times of segments about the middle [s]."""
    one, two = detrended(first), detrended(second)
    ours = [c.frequency_hz for c in detect_peaks(one, rate_hz, *band_hz)]
    theirs = np.array([c.frequency_hz for c in detect_peaks(two, rate_hz, *band_hz)])
    common = [f for f in ours if len(theirs) and np.min(np.abs(theirs - f)) < REACH * f]
    if not common:
        return (), np.zeros(0)
    count = min(STRETCHES, int(len(one) / rate_hz * common[0] / LEAST_CYCLES))
    length = len(one) // max(count, 2)
    starts = np.arange(max(count, 2)) * length
    times_s = (starts + length / 2 - len(one) / 2) / rate_hz
    window = np.hanning(length)[:, None]
    frequency = np.fft.rfftfreq(length, 1 / rate_hz)
    scale = 1 / one.std(axis=0), 1 / two.std(axis=0)
    spectra = [
        (
            np.fft.rfft(window * one[at : at + length] * scale[0], axis=0),
            np.fft.rfft(window * two[at : at + length] * scale[1], axis=0),
        )
        for at in starts
    ]
    modes = []
    for f in common:
        reach = max(REACH * f, 3 * frequency[1])
        inside = np.abs(frequency - f) <= reach
        cross = np.array([a[inside].T @ b[inside].conj() for a, b in spectra])
        powers = [
            [float(np.sum(np.abs(part[inside]) ** 2)) for part in pair] for pair in spectra
        ]
        power = float(np.prod(np.sum(powers, axis=0)))
        worth = _worth(spectra, inside) / HANN_WORTH
        modes.append(SharedMode(f, cross, power, max(worth, 1.5)))
    return tuple(modes), times_s


def _worth(spectra: list[tuple[np.ndarray, np.ndarray]], inside: np.ndarray) -> float:
    """Ordinates that share the power of a peak as so many equal ones would."""
    power = sum(np.sum(np.abs(part[inside]) ** 2, axis=1) for pair in spectra for part in pair)
    return float(np.sum(power) ** 2 / np.sum(np.square(power)))
