r"""Modal state-space model of a band, and the spectral density that it predicts.

.. math:: S(\omega) = \sum_j \left( \phi_j g_j^H \, h_j(\omega) +
          g_j \phi_j^H \, \bar h_j(\omega) \right) + R_0 + R_1 \omega

with the shape, the force and the mean response of each mode, and a background that may slope.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Complex, Float

DAMPING_SD = 1.0
"""Prior standard deviation of the log decay rate."""

FREQUENCY_SD = 2.0
"""Prior standard deviation of the frequency [half-bandwidths]. Without a prior, a narrow pole
fits a single ordinate, or moves to where another is missing."""


Width = Float[np.ndarray, " group"] | float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandData:
    """Mean spectral matrices of groups of neighbouring ordinates.

    Parameters
    ----------
    omega, width
        Middle and width of each group, scaled angular frequency [1]; 0 for a single ordinate.
    length, turn
        Of the record, in the inverse of the unit of `omega`, and the phase in which it leaves
        what turns at the frequency that was moved to zero. Without them leakage is neglected.
    """

    omega: Float[np.ndarray, " group"]
    density: Complex[np.ndarray, "group direction direction"]
    number: Float[np.ndarray, " group"]
    length: float = np.inf
    turn: complex = 1.0 + 0.0j
    width: Width = 0.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandModel:
    """Parameters of the density, poles in the unit of `omega`.

    The last `held` modes are beyond the band: their poles and shapes are known well enough
    for the skirts that they send into it, and stay; where the model is `still`, all poles do.
    `expected` is about where each pole is thought to lie.
    """

    pole: Complex[np.ndarray, " mode"]
    shape: Complex[np.ndarray, "direction mode"]
    force: Complex[np.ndarray, "direction mode"]
    level: Complex[np.ndarray, "direction direction"]
    slope: Complex[np.ndarray, "direction direction"]
    expected: Complex[np.ndarray, " mode"]
    held: int = 0
    still: bool = False
    length: float = np.inf
    turn: complex = 1.0 + 0.0j

    def free(self) -> np.ndarray:
        """Which of all real parameters are to be found."""
        directions, modes = self.shape.shape
        free = np.ones(2 * modes + 4 * modes * directions + 2 * directions**2, dtype=bool)
        first = modes - self.held
        free[0 if self.still else 2 * first : 2 * modes] = False
        free[2 * modes + 2 * directions * first : 2 * modes * (1 + directions)] = False
        return free

    def gain(
        self, omega: Float[np.ndarray, " group"], width: Width = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        r"""Mean response of each mode in a periodogram, and its slope, ["mode group"].

        .. math:: \int_0^T (1 - \tau / T) \, e^{(s - i \omega) \tau} \, d\tau
                  = \frac{1}{i \omega - s} - \frac{1 - e^{s T}}{(i \omega - s)^2 T}

        at the frequencies of a transform over T, with all the leakage of a finite record, and
        averaged over the width of each group.
        """
        plain, square, cube = _averaged(1j * omega - self.pole[:, None], width)
        if np.isinf(self.length):
            return plain, square
        left = (self.turn * np.exp(self.pole * self.length))[:, None]
        leak = (1.0 - left) / self.length
        return plain - leak * square, (1.0 + left) * square - 2.0 * leak * cube

    def resonances(self, omega: Float[np.ndarray, " group"], width: Width = 0.0) -> np.ndarray:
        """Part of each mode in the density, ["mode group direction direction"]."""
        gain, _ = self.gain(omega, width)
        half = np.einsum("im,mk,jm->mkij", self.shape, gain, self.force.conj())
        return np.asarray(half + half.conj().transpose(0, 1, 3, 2))

    def background(self, omega: Float[np.ndarray, " group"]) -> np.ndarray:
        """Part of the density that is no resonance of the band."""
        return np.asarray(self.level + self.slope * omega[:, None, None])

    def density(self, omega: Float[np.ndarray, " group"], width: Width = 0.0) -> np.ndarray:
        """Predicted spectral matrices."""
        gain, _ = self.gain(omega, width)
        return self.density_of_gain(omega, gain)

    def density_of_gain(
        self, omega: Float[np.ndarray, " group"], gain: Complex[np.ndarray, "mode group"]
    ) -> np.ndarray:
        """Predicted spectral matrices, from the response of the modes."""
        return density_of(self.shape, self.force, self.background(omega), gain)

    def predicted(self, data: BandData) -> np.ndarray:
        """Predicted spectral matrices of the data."""
        return self.density(data.omega, data.width)

    def prominence(self, mode: int) -> float:
        """Largest ratio, over directions, of a mode to everything else at its peak."""
        at = np.array([self.pole[mode].imag])
        parts = self.resonances(at)[:, 0]
        rest = parts.sum(axis=0) - parts[mode] + self.background(at)[0]
        own = (parts[mode] + parts[mode].conj().T) / 2
        power, directions = np.linalg.eigh((rest + rest.conj().T) / 2)
        least = max(1e-9 * float(np.linalg.norm(own)), np.finfo(float).tiny)
        root = directions / np.sqrt(np.maximum(power, least))
        return float(np.linalg.eigvalsh(root.conj().T @ own @ root)[-1])

    def without(self, mode: int) -> "BandModel":
        """Model without one mode."""
        keep = np.arange(len(self.pole)) != mode
        return dataclasses.replace(
            self,
            pole=self.pole[keep],
            shape=self.shape[:, keep],
            force=self.force[:, keep],
            expected=self.expected[keep],
        )

    def ties(self) -> tuple[np.ndarray, np.ndarray]:
        """Log decay rates and frequencies less what was expected, and prior deviations."""
        wide = -self.expected.real
        away = [np.log(-self.pole.real / wide), self.pole.imag - self.expected.imag]
        return np.stack(away), np.stack([np.full_like(wide, DAMPING_SD), FREQUENCY_SD * wide])

    def with_modes(self, expected: np.ndarray, shape: np.ndarray) -> "BandModel":
        """Model with additional modes of zero force.

        New modes precede those that are held.
        """
        at = len(self.pole) - self.held
        before = [at] * len(expected)
        return dataclasses.replace(
            self,
            pole=np.insert(self.pole, before, expected),
            shape=np.insert(self.shape, before, shape, axis=1),
            force=np.insert(self.force, before, 0.0, axis=1),
            expected=np.insert(self.expected, before, expected),
        )


def density_of(
    shape: Complex[np.ndarray, "direction mode"],
    force: Complex[np.ndarray, "direction mode"],
    background: Complex[np.ndarray, "*group direction direction"],
    gain: Complex[np.ndarray, "mode group"],
) -> Complex[np.ndarray, "group direction direction"]:
    """Density of modes over a background, one matrix product for all groups."""
    directions = len(shape)
    outer = (shape.T[:, :, None] * force.conj().T[:, None]).reshape(-1, directions**2)
    half = (gain.T @ outer).reshape(-1, directions, directions)
    return np.asarray(half + half.conj().transpose(0, 2, 1) + background)


def _averaged(a: np.ndarray, width: Width) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of 1 / a, of its square and of its cube, over a width along the imaginary axis."""
    square = 1.0 / (a**2 + 0.25 * np.square(width))
    wide = np.where(width == 0, 1.0, width)
    logarithm = np.log((a + 0.5j * wide) / (a - 0.5j * wide)) / (1j * wide)
    return np.where(width == 0, 1.0 / a, logarithm), square, a * square**2


def step_parameters(model: BandModel, step: Float[np.ndarray, " parameter"]) -> BandModel:
    """Change all real parameters of a model, in the order of `BandModel.free`."""
    directions, modes = model.shape.shape
    of_poles = np.clip(step[: 2 * modes : 2], -1.0, 1.0), step[1 : 2 * modes : 2]
    pole = model.pole.real * np.exp(of_poles[0]) + 1j * (model.pole.imag + of_poles[1])
    parts = step[2 * modes :]
    size = 2 * directions * modes
    shape, force = (
        (part[::2] + 1j * part[1::2]).reshape(modes, directions).T
        for part in (parts[:size], parts[size : 2 * size])
    )
    basis = hermitian_basis(directions).reshape(directions**2, -1)
    level, slope = np.split(parts[2 * size :], 2)
    return dataclasses.replace(
        model,
        pole=pole,
        shape=model.shape + shape,
        force=model.force + force,
        level=model.level + (level @ basis).reshape(directions, directions),
        slope=model.slope + (slope @ basis).reshape(directions, directions),
    )


@functools.cache
def hermitian_basis(size: int) -> np.ndarray:
    """Basis of the Hermitian matrices with real coefficients.

    It is kept, and not to be written to.
    """
    basis = np.zeros((size**2, size, size), dtype=complex)
    at = 0
    for i in range(size):
        for j in range(i):
            basis[at, i, j] = basis[at, j, i] = 1.0
            basis[at + 1, i, j], basis[at + 1, j, i] = 1j, -1j
            at += 2
        basis[at, i, i] = 1.0
        at += 1
    basis.setflags(write=False)
    return basis
