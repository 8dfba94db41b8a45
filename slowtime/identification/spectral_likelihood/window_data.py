"""Data and initial values of the likelihood for one frequency window."""

import dataclasses

import numpy as np

from .likelihood import initial_model
from .model import BandData, BandModel
from .shape_complement import Ordinates
from .windows import SpectralWindow, Spectrum

SPARE = 1
"""Channel combinations beyond the number of modes."""

MOST_DIRECTIONS = 5
"""Largest number of channel combinations."""

QUIET = 1e-3
"""Least noise density, relative to the median density [1]."""

GROUPED = 0.3
"""Width of the averages, relative to the distance from the nearest pole [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class WindowUnits:
    """Unit of frequency, middle, scale of the channels and directions kept of them."""

    unit: float
    middle: float
    scale: np.ndarray
    directions: np.ndarray

    def pole(self, pole: np.ndarray) -> np.ndarray:
        """Pole in the units of the window."""
        return np.asarray((pole - 1j * self.middle) / self.unit)

    def back(self, pole: complex) -> complex:
        """Pole in physical units [rad/s]."""
        return complex(pole * self.unit + 1j * self.middle)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class WindowData:
    """One window made ready: data, and where poles and shapes are thought to be."""

    data: BandData
    poles: np.ndarray
    shapes: np.ndarray
    held: int
    ordinates: Ordinates

    @property
    def price(self) -> float:
        """Half the Bayesian penalty per parameter times the parameters of one mode."""
        directions = self.data.density.shape[1]
        return float(2.0 * directions * np.log(self.data.number.sum()))

    @property
    def modes(self) -> int:
        """How many are in the window."""
        return len(self.poles) - self.held

    def start(self, which: list[int]) -> BandModel:
        """Model of some of the modes and of all that are beside the window."""
        all_of = [*which, *range(self.modes, len(self.poles))]
        return initial_model(self.data, self.poles[all_of], self.shapes[:, all_of], self.held)


def prepare_window(
    spectrum: Spectrum, window: SpectralWindow, poles: np.ndarray, shapes: np.ndarray
) -> tuple[WindowUnits, WindowData]:
    """Prepare data and initial values of a window."""
    index = np.arange(window.first, window.last + 1)
    index = index[~spectrum.spared[index]]
    coefficients = spectrum.coefficients[index]
    omega = 2 * np.pi * spectrum.spacing_hz * index
    frame = _frame(coefficients, omega, poles, shapes, len(window.modes))
    projected = (coefficients / frame.scale) @ frame.directions.conj()
    guess = frame.pole(poles)
    data, group = _grouped(projected, (omega - frame.middle) / frame.unit, guess)
    seconds = 1.0 / spectrum.spacing_hz
    turn = complex(np.exp(1j * frame.middle * seconds))
    data = dataclasses.replace(
        data, number=data.number * spectrum.worth, length=frame.unit * seconds, turn=turn
    )
    start = frame.directions.conj().T @ (shapes / frame.scale[:, None])
    start = start / np.maximum(np.linalg.norm(start, axis=0), 1e-9)
    ordinates = Ordinates(coefficients / frame.scale, group)
    return frame, WindowData(data, guess, start, len(window.beside), ordinates)


def _frame(
    coefficients: np.ndarray,
    omega: np.ndarray,
    poles: np.ndarray,
    shapes: np.ndarray,
    modes: int,
) -> WindowUnits:
    """Directions of the candidate shapes first, then of the strongest rest."""
    scale = np.sqrt(np.mean(np.abs(coefficients) ** 2, axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = coefficients / scale
    number = min(len(scale), modes + SPARE, MOST_DIRECTIONS)
    seen = shapes[:, :modes] / scale[:, None]
    basis, strength, _ = np.linalg.svd(seen / np.linalg.norm(seen, axis=0))
    basis = basis[:, : min(number, int(np.count_nonzero(strength > 0.05 * strength[0])))]
    seen = scaled @ basis.conj()
    rest = scaled - seen @ basis.T
    # Singular vectors of a long matrix, strongest first, by its small Gram matrix.
    more = np.linalg.eigh(rest.T @ rest.conj())[1][:, ::-1][:, : number - basis.shape[1]]
    # Channels that say the same, but for rounding, have directions in which nothing is left.
    parts = np.concatenate([seen, rest @ more.conj()], axis=1)
    power = np.median(np.abs(parts) ** 2, axis=0)
    directions = np.concatenate([basis, more], axis=1)[:, power >= QUIET * power.max()]
    unit = float(-poles[:modes].real.max())
    middle = float(np.median(poles[:modes].imag))
    return WindowUnits(unit, middle, scale, directions)


def _grouped(
    projected: np.ndarray, omega: np.ndarray, poles: np.ndarray
) -> tuple[BandData, np.ndarray]:
    """Average neighbouring ordinates where the density hardly changes; group of each."""
    distance = np.abs(1j * omega[:, None] - poles).min(axis=1)
    spacing = float(omega[1] - omega[0])
    size = np.maximum(GROUPED * distance / spacing, 1.0)
    group = np.floor(np.cumsum(1.0 / size)).astype(int)
    _, starts, group = np.unique(group, return_index=True, return_inverse=True)
    number = np.diff([*starts, len(omega)]).astype(float)
    outer = projected[:, :, None] * projected[:, None, :].conj()
    density = np.add.reduceat(outer, starts, axis=0) / number[:, None, None]
    power = np.trace(density, axis1=1, axis2=2).real / density.shape[1]
    density = density + QUIET * np.median(power) * np.eye(density.shape[1])
    first, last = omega[starts], omega[np.append(starts[1:], len(omega)) - 1]
    width = np.where(number > 1, last - first + spacing, 0.0)
    return BandData((first + last) / 2, density, number, width=width), group
