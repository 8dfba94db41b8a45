"""Spectral densities of sensor noise: white, with a power law or one broad resonance.

A structure answers in sharp peaks. Noise that may not have any is not mistaken for a structure.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .drift import Drift

# Not by axis: checked where it comes from, and asked for ten thousand times.
Frequencies = np.ndarray[Any, np.dtype[np.float64]]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Colour:
    r"""Density of the noise of one sensor.

    .. math:: N(f) = n_0 + n_1 \, (1 + (f / f_c)^2)^{-\beta / 2}
              \, |1 - 2 r \cos \varphi \, z^{-1} + r^2 z^{-2}|^{-2},
              \qquad z = e^{2 \pi i f / f_s}

    White for :math:`n_1 = 0`, first-order low-pass for :math:`\beta = 2`, flicker for
    :math:`\beta = 1` and a small :math:`f_c`, differentiated for :math:`\beta = -2`; the last
    factor is the broad resonance of a second-order autoregressive process (a pair of poles).

    Parameters
    ----------
    white
        :math:`n_0`, one-sided [unit²/Hz].
    coloured
        :math:`n_1` [unit²/Hz].
    corner_hz
        :math:`f_c` [Hz].
    slope
        :math:`\beta` [1].
    radius, angle
        :math:`r` [1], :math:`\varphi` [rad] of the poles; no resonance for a radius of 0.
    rate_hz
        Sampling rate :math:`f_s` that the poles belong to.
    """

    white: float
    coloured: float = 0.0
    corner_hz: float = 1.0
    slope: float = 0.0
    radius: float = 0.0
    angle: float = 0.0
    rate_hz: float = 1.0

    def density(self, frequency_hz: Frequencies) -> Frequencies:
        """One-sided density [unit²/Hz] at frequencies.

        Examples
        --------
        >>> low_pass = Colour(white=1.0, coloured=8.0, corner_hz=1.0, slope=2.0)
        >>> low_pass.density(np.array([0.0, 1.0]))
        array([9., 5.])
        """
        ratio = np.log1p((frequency_hz / self.corner_hz) ** 2)
        part = self.coloured * np.exp(-self.slope / 2 * ratio)
        if self.radius > 0:
            part = part * pole_pair_gain(frequency_hz / self.rate_hz, self.radius, self.angle)
        return np.asarray(self.white + part)

    def scaled(self, factor: float) -> "Colour":
        """Multiply the density by a factor."""
        return dataclasses.replace(
            self, white=self.white * factor, coloured=self.coloured * factor
        )


def pole_pair_gain(turns: Frequencies, radius: float, angle: float) -> Frequencies:
    """Squared gain of complex poles at frequencies over the sampling rate; the angle in rad."""
    pole = radius * np.exp(1j * angle)
    back = np.exp(-2j * np.pi * turns)
    return np.asarray(1 / np.abs((1 - pole * back) * (1 - np.conj(pole) * back)) ** 2)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Noise of every sensor in every trial.

    Parameters
    ----------
    relative_sd
        How well the density is known, relative; by trial, then by sensor.
    drift
        Error of free runs of a structure with rigid motions; no noise of the sensors.
    """

    colours: tuple[tuple[Colour, ...], ...]
    relative_sd: tuple[tuple[float, ...], ...]
    drift: Drift | None = None

    def for_trials(self, trials: Sequence[int]) -> "Noise":
        """Select the noise of trials, each as often as it is named, without the drift."""
        return Noise(
            colours=tuple(self.colours[i] for i in trials),
            relative_sd=tuple(self.relative_sd[i] for i in trials),
        )

    def density(
        self, trial: int, frequency_hz: Frequencies
    ) -> Float[np.ndarray, "frequency sensor"]:
        """One-sided density of each sensor in one trial [unit²/Hz]."""
        return np.stack([c.density(frequency_hz) for c in self.colours[trial]], axis=1)

    def weighting_density(
        self, trial: int, frequency_hz: Frequencies
    ) -> Float[np.ndarray, "frequency sensor"]:
        """One-sided density by which residuals are weighted, drift included [unit²/Hz]."""
        own = self.density(trial, frequency_hz)
        return own if self.drift is None else own + self.drift.density(trial, frequency_hz)

    def sd(self, trial: int, rate_hz: float) -> Float[np.ndarray, " sensor"]:
        """Give the standard deviation of the samples of each sensor, in its unit."""
        grid = np.linspace(0.0, rate_hz / 2, 513)
        return np.asarray(np.sqrt(np.trapezoid(self.density(trial, grid), grid, axis=0)))


def white_noise(densities: Sequence[Sequence[float]]) -> Noise:
    """White noise of one-sided densities [unit²/Hz] that are known, by trial and sensor.

    Examples
    --------
    >>> noise = white_noise([[0.02]])
    >>> noise.sd(0, 100.0).round(6)
    array([1.])
    """
    if not all(0 < value < math.inf for row in densities for value in row):
        raise ValueError(f"{densities=} must be positive. Give the density of each sensor.")
    colours = tuple(tuple(Colour(white=float(value)) for value in row) for row in densities)
    return Noise(colours=colours, relative_sd=tuple((0.0,) * len(r) for r in colours))


def with_drift(noise: Noise, drift: Drift, rate_hz: float) -> Noise:
    """Add drift to a noise model."""
    top = np.array([rate_hz / 2])
    # What a drifting sensor leaves at low frequency is drift and no colour of its noise, which
    # is taken to be white at the level of the highest line.
    loose = [bool(row.any()) for row in drift.shapes]
    colours = tuple(
        tuple(
            Colour(white=float(colour.density(top)[0])) if drifts else colour
            for colour, drifts in zip(row, loose, strict=True)
        )
        for row in noise.colours
    )
    return dataclasses.replace(noise, colours=colours, drift=drift)
