"""Data of frequency windows of a band, scaled for the likelihood."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float

from slowtime.identification.spectral_likelihood.model import BandData
from slowtime.identification.spectral_likelihood.windows import WIDEST
from slowtime.identification.subspace.stabilisation import StablePole

FEWEST_ORDINATES = 30
"""Least number of ordinates in a window."""

MOST_TOGETHER = 5
"""Largest number of modes in a window."""

SPARE = 1
"""Channel combinations beyond the number of modes."""

MOST_DIRECTIONS = 6
"""Largest number of channel combinations."""

LINE_FIT = 3.0
"""Range in which a machine line is measured [decay rates of the window]."""

LINE_CORE = 5.0
"""Range about a machine line in which no mode is sought [decay rates of the window]."""

GROUPED = 0.5
"""Width of the averages, relative to the distance from the nearest pole [1]."""

QUIET = 1e-3
"""Least noise density, relative to the median density [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FadingSpectra:
    """Spectral matrices of a band, and how they were seen.

    Parameters
    ----------
    frequency_hz
        Of the ordinates, equally spaced [Hz].
    density
        Of combinations of the channels, up to a factor.
    cross
        Of the channels with the combinations, by the same factor.
    power
        Of the channels.
    number
        Independent ordinates of a record that each of them is worth.
    decay
        What the window added to the decay rate of every mode [rad/s].
    spared
        Ordinates that are not to be used.
    """

    frequency_hz: Float[np.ndarray, " ordinate"]
    density: Complex[np.ndarray, "ordinate direction direction"]
    cross: Complex[np.ndarray, "ordinate channel direction"]
    power: Float[np.ndarray, "ordinate channel"]
    number: float
    decay: float
    spared: Bool[np.ndarray, " ordinate"]

    def without_line(self, frequency_hz: float) -> "FadingSpectra":
        """Subtract a steady line, whose skirts in the window are known.

        What is left of its core is spared.
        """
        away = 2 * np.pi * (self.frequency_hz - frequency_hz) / self.decay
        about = np.abs(away) < LINE_FIT
        if np.count_nonzero(about) < 3:
            return self
        shape = 1.0 / (1.0 + away**2)
        columns = np.stack([shape[about], np.ones(np.count_nonzero(about))], axis=1)
        amount = np.linalg.pinv(columns)[0]
        parts = [
            part
            - shape.reshape(-1, *[1] * (part.ndim - 1)) * np.tensordot(amount, part[about], 1)
            for part in (self.density, self.cross, self.power)
        ]
        spared = self.spared | (np.abs(away) < LINE_CORE)
        return dataclasses.replace(
            self, density=parts[0], cross=parts[1], power=parts[2], spared=spared
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class StartMode:
    """Where a mode is thought to be, and what began it."""

    pole: complex
    shape: Complex[np.ndarray, " direction"]
    candidate: StablePole


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FadingWindow:
    """One window made ready: scaled data and where poles and shapes are thought to be.

    The last `held` modes are beside the window, and stay where they are.
    """

    data: BandData
    poles: np.ndarray
    shapes: np.ndarray
    unit: float
    middle: float
    directions: np.ndarray
    inside: np.ndarray
    held: int

    @property
    def price(self) -> float:
        """Half the Bayesian penalty per parameter times the parameters of one mode."""
        return float(2.0 * len(self.shapes) * np.log(max(self.data.number.sum(), 2.0)))


def group_start_modes(order: list[StartMode], close: float) -> list[list[int]]:
    """Group neighbouring modes; large groups are split at the widest gap.

    Modes join that are closer than `close` [half-bandwidths].
    """
    poles = [start.pole for start in order]
    groups: list[list[int]] = []
    for k in range(len(order)):
        if groups:
            gap = poles[k].imag - poles[k - 1].imag
            if gap < -0.5 * close * (poles[k].real + poles[k - 1].real):
                groups[-1].append(k)
                continue
        groups.append([k])
    return [part for group in groups for part in _split(group, poles)]


def _split(group: list[int], poles: list[complex]) -> list[list[int]]:
    if len(group) <= MOST_TOGETHER:
        return [group]
    at = 1 + int(np.argmax(np.diff([poles[k].imag for k in group])))
    return _split(group[:at], poles) + _split(group[at:], poles)


def prepare_fading_window(
    seen: FadingSpectra,
    order: list[StartMode],
    members: list[int],
    held: list[StartMode],
    wide: float,
) -> FadingWindow:
    """Prepare the data of a window, in few combinations of channels.

    Poles of the modes `held`, beside the window, stay; the window reaches `wide`
    [half-bandwidths] beyond its members.
    """
    omega = 2 * np.pi * seen.frequency_hz
    poles = np.array([order[k].pole for k in members]) - seen.decay
    least = FEWEST_ORDINATES / 2 * (omega[1] - omega[0])
    reach = np.maximum(np.minimum(-wide * poles.real, WIDEST * poles.imag), least)
    inside = (omega > (poles.imag - reach).min()) & (omega < (poles.imag + reach).max())
    # Nothing of a neighbour's peak, where the neighbour is in a window of its own.
    if members[0] > 0:
        inside &= omega > (order[members[0] - 1].pole.imag + poles[0].imag) / 2
    if members[-1] + 1 < len(order):
        inside &= omega < (order[members[-1] + 1].pole.imag + poles[-1].imag) / 2
    inside &= ~seen.spared
    density, omega = seen.density[inside], omega[inside]
    shapes = np.stack([order[k].shape for k in members], axis=1)
    directions = _directions(density, shapes)
    unit, middle = float(-poles.real.max()), float(np.median(poles.imag))
    beside = np.array([start.pole for start in held], dtype=complex) - seen.decay
    scaled = (np.append(poles, beside) - 1j * middle) / unit
    turned = directions.conj().T @ density @ directions
    data = _grouped(turned, (omega - middle) / unit, scaled, seen.number)
    shapes = np.column_stack([shapes, *(start.shape for start in held)])
    start = directions.conj().T @ shapes
    start = start / np.maximum(np.linalg.norm(start, axis=0), 1e-9)
    return FadingWindow(data, scaled, start, unit, middle, directions, inside, len(held))


def _directions(density: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Those of the candidate shapes first, then of the strongest rest."""
    number = min(density.shape[1], shapes.shape[1] + SPARE, MOST_DIRECTIONS)
    basis, strength, _ = np.linalg.svd(shapes / np.linalg.norm(shapes, axis=0))
    basis = basis[:, : min(number, int(np.count_nonzero(strength > 0.05 * strength[0])))]
    across = np.eye(len(basis)) - basis @ basis.conj().T
    rest = across @ density.mean(axis=0) @ across
    more = np.linalg.eigh((rest + rest.conj().T) / 2)[1][:, ::-1]
    return np.concatenate([basis, more[:, : number - basis.shape[1]]], axis=1)


def _grouped(
    density: np.ndarray, omega: np.ndarray, poles: np.ndarray, worth: float
) -> BandData:
    """Average neighbouring ordinates where the density cannot change between them."""
    distance = np.sqrt((omega[:, None] - poles.imag) ** 2 + poles.real**2).min(axis=1)
    size = np.maximum(GROUPED * distance / float(omega[1] - omega[0]), 1.0)
    _, starts = np.unique(np.floor(np.cumsum(1.0 / size)).astype(int), return_index=True)
    number = np.diff([*starts, len(omega)]).astype(float)
    mean = np.add.reduceat(density, starts, axis=0) / number[:, None, None]
    mean = (mean + mean.conj().transpose(0, 2, 1)) / 2
    power = np.trace(mean, axis1=1, axis2=2).real / mean.shape[1]
    mean = mean + QUIET * np.median(power) * np.eye(mean.shape[1])
    first, last = omega[starts], omega[np.append(starts[1:], len(omega)) - 1]
    width = np.where(number > 1, last - first + omega[1] - omega[0], 0.0)
    return BandData((first + last) / 2, mean, number * worth, width=width)
