"""Simulated structures with measured inputs, and their exact modes."""

import dataclasses

import numpy as np
import scipy.fft as fft


@dataclasses.dataclass(frozen=True, eq=False)
class Structure:
    """Modes of a proportionally damped structure.

    `shapes` are mass-normalised over the sensors, `forces` over the places of the inputs.
    """

    frequency_hz: np.ndarray
    damping_ratio: np.ndarray
    shapes: np.ndarray
    forces: np.ndarray

    @property
    def poles(self) -> np.ndarray:
        omega = 2 * np.pi * self.frequency_hz
        root = np.sqrt(1 - self.damping_ratio**2)
        return np.asarray(omega * (-self.damping_ratio + 1j * root))

    def acceleration(self, s: np.ndarray) -> np.ndarray:
        """Acceleration per force, [row output input]."""
        omega = 2 * np.pi * self.frequency_hz
        modal = s[:, None] ** 2 / (
            s[:, None] ** 2 + 2 * self.damping_ratio * omega * s[:, None] + omega**2
        )
        return np.asarray(np.einsum("ok,fk,ik->foi", self.shapes, modal, self.forces))

    def transmissibility(self, s: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Absolute acceleration per acceleration of the supports.

        `factors` are of each support and mode; the quasi-static motion is that of modes.
        """
        omega = 2 * np.pi * self.frequency_hz
        spring = 2 * self.damping_ratio * omega * s[:, None] + omega**2
        modal = spring / (s[:, None] ** 2 + spring)
        return np.asarray(np.einsum("ok,fk,ik->foi", self.shapes, modal, factors))


def frame(storeys: int = 5, *, first_hz: float = 3.0, damping: float = 0.01) -> Structure:
    """Shear frame of equal storeys of unit mass, with a force at the top and at storey 2."""
    k = np.arange(1, storeys + 1)
    angle = (2 * k - 1) * np.pi / (2 * storeys + 1)
    shapes = np.sin(np.outer(np.arange(1, storeys + 1), angle))
    shapes /= np.linalg.norm(shapes, axis=0)
    frequency = 2 * np.sin(angle / 2)
    frequency = first_hz * frequency / frequency[0]
    return Structure(frequency, np.full(storeys, damping), shapes, shapes[[storeys - 1, 1]])


def response_to(
    structure: Structure,
    inputs: np.ndarray,
    rate_hz: float,
    *,
    factors: np.ndarray | None = None,
    padding: int = 4,
) -> np.ndarray:
    """Response of a structure at rest to band-limited inputs: exact but for wrapped ringing."""
    count = len(inputs)
    size = fft.next_fast_len(count * padding)
    spectrum = fft.rfft(inputs, size, axis=0)
    s = 2j * np.pi * fft.rfftfreq(size, 1 / rate_hz)
    h = structure.acceleration(s) if factors is None else structure.transmissibility(s, factors)
    whole = fft.irfft(np.einsum("foi,fi->fo", h, spectrum), size, axis=0)
    return np.asarray(whole[:count])


def blows(
    at_s: np.ndarray,
    peaks: np.ndarray,
    rate_hz: float,
    duration_s: float,
    width_s: float = 0.01,
) -> np.ndarray:
    """Force of hammer blows: half-sine squared pulses."""
    time = np.arange(round(duration_s * rate_hz)) / rate_hz
    force = np.zeros(len(time))
    for at, peak in zip(at_s, peaks, strict=True):
        inside = (time >= at) & (time <= at + width_s)
        force[inside] += peak * np.sin(np.pi * (time[inside] - at) / width_s) ** 2
    return force
