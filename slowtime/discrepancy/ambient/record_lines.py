"""Spectral lines of ambient records: which sensors and which frequencies are used."""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from slowtime.discrepancy.localization import LinearModel
from slowtime.dynamics.description import Description

SHAPE_KNOTS = 4
"""[1] Knots of the shape of a force over log frequency. Source: a decision: wind and traffic
have smooth spectra, and more knots would imitate resonances."""
BAND_LINES = 12
"""[lines] Of a band in which power is averaged to find where forces end. Source: averages of
12 lines scatter by a third, far less than `EDGE_FALL`."""
EDGE_FALL = 8.0
"""[1] Factor by which the power of a force falls from one band to the next where its spectrum
ends. Source: twice the smooth shapes that `SHAPE_SD` allows between two bands."""
NEAR_MODES = 1.25
"""[1] Frequency over the highest mode, and under the lowest, up to which response is taken for
that of the modes. Source: twice the error of a natural frequency that a tolerance of the
stiffness of a quarter allows."""

Lines = Complex[np.ndarray, "frequency sensor"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RecordLines:
    """Spectral lines of one record.

    The mean square of `lines` (frequency, sensor) is the one-sided density [unit²/Hz].
    """

    frequency_hz: Float[np.ndarray, " frequency"]
    lines: Lines

    @property
    def shapes(self) -> Float[np.ndarray, "frequency knot"]:
        """Hat functions over log frequency."""
        log = np.log(self.frequency_hz)
        knots = np.linspace(log[0], log[-1], SHAPE_KNOTS)
        return np.stack([np.interp(log, knots, one) for one in np.eye(SHAPE_KNOTS)], axis=1)

    def shape_at(
        self, frequency_hz: Float[np.ndarray, " other"], log_shape: Float[np.ndarray, " knot"]
    ) -> Float[np.ndarray, " other"]:
        """Shape of the forces at other frequencies, from its logarithm at the knots; or 0."""
        density = np.exp(self.shapes @ log_shape)
        return np.asarray(np.interp(frequency_hz, self.frequency_hz, density, right=0.0))


def sensors_of_different_nodes(description: Description) -> list[int]:
    """Choose sensors of different nodes, accelerations first: their spectra are flattest."""
    order = {"acceleration": 0, "velocity": 1, "displacement": 2}
    ranked = sorted(
        (order.get(sensor.quantity, 3), number)
        for number, sensor in enumerate(description.sensors)
    )
    chosen: dict[str | None, int] = {}
    for rank, number in ranked:
        if rank < len(order):
            # A second sensor of a node repeats the first but for the leakage of the taper,
            # which grows with the range of a spectrum.
            chosen.setdefault(description.sensors[number].node, number)
    return sorted(chosen.values()) or list(range(len(description.sensors)))


def driven_lines(
    linear: LinearModel, frequency_hz: Float[np.ndarray, " frequency"], lines: Lines
) -> RecordLines:
    """Drop lines beyond the end of the spectrum of the forces, and those at its edges."""
    # Beyond the spectrum of the forces, noise and harmonics respond, which say nothing of a
    # linear model.
    response = linear.sensor_response(frequency_hz, linear.compliance(frequency_hz))
    parts = np.array_split(np.arange(len(lines)), max(len(lines) // BAND_LINES, 1))
    power, unit = np.abs(lines) ** 2, np.sum(np.abs(response) ** 2, axis=2)
    # The sensor that responds most bounds the density of the forces best.
    ratio = np.array([np.min(power[p].mean(axis=0) / unit[p].mean(axis=0)) for p in parts])
    modes = natural_frequencies_hz(linear)
    seen = modes[(modes > frequency_hz[0]) & (modes < frequency_hz[-1])]
    low, high = (seen.min(), seen.max()) if len(seen) else frequency_hz[[0, -1]]
    top = np.array([frequency_hz[p[-1]] for p in parts])
    above = np.flatnonzero(top > high)
    below = np.flatnonzero(top < low)[::-1]
    acts = np.ones(len(parts), bool)
    inner = (top >= low / NEAR_MODES) & (top <= NEAR_MODES * high)
    lines_inner = np.repeat(inner if inner.any() else ~inner, [len(p) for p in parts])
    usual = float(np.min(power[lines_inner].sum(axis=0) / unit[lines_inner].sum(axis=0)))
    for outward in (above, below):
        ended = _first_fall(ratio[outward], usual)
        if ended < len(outward):
            acts[outward[max(ended - 1, 0) :]] = False
    kept = np.repeat(acts, [len(p) for p in parts])
    return RecordLines(frequency_hz[kept], lines[kept])


def _first_fall(ratio: Float[np.ndarray, " band"], usual: float) -> int:
    """Return the number of the first band, going outward, where the forces have ended."""
    for number in range(len(ratio)):
        # A mode off its place lifts the ratio about it, but not the usual one.
        before = float(np.median(ratio[max(number - 3, 0) : number])) if number else usual
        if ratio[number : number + 2].max() < min(before, usual) / EDGE_FALL:
            return number
    return len(ratio)


def natural_frequencies_hz(linear: LinearModel) -> Float[np.ndarray, " mode"]:
    """Undamped natural frequencies of a linear model [Hz], ascending."""
    structure = linear.structure
    squares = scipy.linalg.eigvals(structure.stiffness, structure.mass).real
    return np.asarray(np.sort(np.sqrt(np.maximum(squares, 0.0))) / (2 * np.pi))
