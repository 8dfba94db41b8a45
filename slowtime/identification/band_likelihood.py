r"""Spectral matrices of a band in; the state-space model that makes them likeliest, out.

Within a band a structure under random force, or under forces that come all from one place,
with modes beyond the band and noise besides, has the density

.. math:: S(\omega) = \sum_j \left( \frac{\phi_j g_j^H}{i \omega - s_j} +
          \frac{g_j \phi_j^H}{-i \omega - \bar s_j} \right) + R_0 + R_1 \omega ,

that of a state-space model with a background which may slope. Periodograms scatter about it
like :math:`\chi^2` (Whittle), so that the likeliest parameters, found by Fisher scoring, are as
good as any, and the inverse of the information is their covariance.

References
----------
.. [1] P. Whittle, "Estimation and information in stationary time series", Arkiv för Matematik
   2 (1953).
.. [2] T. McKelvey, H. Akçay, L. Ljung, "Subspace-based multivariable system identification from
   frequency response data", IEEE Trans. Automatic Control 41 (1996) for the class of models.
"""

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Complex, Float

MOST_STEPS = 25
FEW_STEPS = 8
"""With poles that stay, or where more modes are to come, more steps are of no use."""

CONVERGED = 0.03
ROUGHLY = 1.0
"""Steps end once they promise less than so much of log-likelihood; the latter where it only
matters whether a model is better by dozens."""

FREELY = 0.05
"""Damping of a step, relative to the information, below which it is a free one."""

GAUGE = 1e-9
"""Directions of less information than this share of the most belong to no parameter."""

DAMPING_SD = 1.0
FREQUENCY_SD = 2.0
"""Of log decay, and of frequency in half-bandwidths, about what is expected: a pole narrower
than one ordinate explains it alone, and one without ties goes where another is missing."""

WARM_UP = 8
"""Rounds of expectation-maximisation at fixed poles, from which scoring starts."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandData:
    """Mean spectral matrices of groups of neighbouring ordinates.

    Parameters
    ----------
    omega
        Scaled angular frequency of each group [1].
    density
        Mean of :math:`Y Y^H` over the group.
    number
        How many ordinates are in it.
    length, turn
        Of the record, in the inverse of the unit of `omega`, and the phase in which it leaves
        what turns at the frequency that was moved to zero. Without them leakage is neglected.
    """

    omega: Float[np.ndarray, " group"]
    density: Complex[np.ndarray, "group direction direction"]
    number: Float[np.ndarray, " group"]
    length: float = np.inf
    turn: complex = 1.0


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
    turn: complex = 1.0

    def free(self) -> np.ndarray:
        """Which of all real parameters are to be found."""
        directions, modes = self.shape.shape
        free = np.ones(2 * modes + 4 * modes * directions + 2 * directions**2, dtype=bool)
        first = modes - self.held
        free[0 if self.still else 2 * first : 2 * modes] = False
        free[2 * modes + 2 * directions * first : 2 * modes * (1 + directions)] = False
        return free

    def gain(self, omega: Float[np.ndarray, " group"]) -> tuple[np.ndarray, np.ndarray]:
        r"""Mean response of each mode in a periodogram, and its slope, ["mode group"].

        .. math:: \int_0^T (1 - \tau / T) \, e^{(s - i \omega) \tau} \, d\tau
                  = \frac{1}{i \omega - s} - \frac{1 - e^{s T}}{(i \omega - s)^2 T}

        at the frequencies of a transform over T, with all the leakage of a finite record.
        """
        plain = 1.0 / (1j * omega - self.pole[:, None])
        if np.isinf(self.length):
            return plain, plain**2
        left = (self.turn * np.exp(self.pole * self.length))[:, None]
        leak = (1.0 - left) * plain**2 / self.length
        return plain - leak, plain**2 * (1.0 + left) - 2.0 * plain * leak

    def resonances(self, omega: Float[np.ndarray, " group"]) -> np.ndarray:
        """Part of each mode in the density, ["mode group direction direction"]."""
        gain, _ = self.gain(omega)
        half = np.einsum("im,mk,jm->mkij", self.shape, gain, self.force.conj())
        return np.asarray(half + half.conj().transpose(0, 1, 3, 2))

    def background(self, omega: Float[np.ndarray, " group"]) -> np.ndarray:
        """Part of the density that is no resonance of the band."""
        return np.asarray(self.level + self.slope * omega[:, None, None])

    def density(self, omega: Float[np.ndarray, " group"]) -> np.ndarray:
        """Model of the spectral matrices."""
        return np.asarray(self.resonances(omega).sum(axis=0) + self.background(omega))

    def without(self, mode: int) -> "BandModel":
        """Model with one mode less."""
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
        """Model with more modes, of no force as yet, before those that are held."""
        at = len(self.pole) - self.held
        before = [at] * len(expected)
        return dataclasses.replace(
            self,
            pole=np.insert(self.pole, before, expected),
            shape=np.insert(self.shape, before, shape, axis=1),
            force=np.insert(self.force, before, 0.0, axis=1),
            expected=np.insert(self.expected, before, expected),
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandFit:
    """Likeliest model, and covariance of (log decay, frequency) of the poles and shapes.

    `covariance` is that of the real parameters: for each mode the logarithm of the decay rate
    and the angular frequency, then real and imaginary parts of the shape components.
    """

    model: BandModel
    log_likelihood: float
    covariance: Float[np.ndarray, "parameter parameter"]
    converged: bool

    def pole_covariance(self, mode: int) -> Float[np.ndarray, "2 2"]:
        """Of log decay rate and angular frequency."""
        at = slice(2 * mode, 2 * mode + 2)
        return self.covariance[at, at]

    def shape_covariance(self, mode: int) -> Complex[np.ndarray, "direction direction"]:
        """Covariance of the complex shape at fixed length and phase."""
        directions, modes = self.model.shape.shape
        first = 2 * modes + 2 * directions * mode
        block = self.covariance[first : first + 2 * directions, first : first + 2 * directions]
        whole = np.concatenate([np.eye(directions), 1j * np.eye(directions)], axis=1)
        order = np.concatenate(
            [np.arange(0, 2 * directions, 2), np.arange(1, 2 * directions, 2)]
        )
        shape = self.model.shape[:, mode]
        across = np.eye(directions) - np.outer(shape, shape.conj()) / np.vdot(shape, shape).real
        moved = across @ whole @ block[np.ix_(order, order)] @ whole.conj().T @ across.conj().T
        return np.asarray(moved)


def log_likelihood(data: BandData, density: np.ndarray) -> float:
    """Whittle's, up to a constant; minus infinity where the density is not positive."""
    try:
        root = np.linalg.cholesky(density)
        misfit = np.trace(np.linalg.solve(density, data.density), axis1=1, axis2=2).real
    except np.linalg.LinAlgError:
        return -np.inf
    logarithm = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2).real).sum(axis=1)
    return float(-np.sum(data.number * (logarithm + misfit)))


def started(
    data: BandData,
    pole: Complex[np.ndarray, " mode"],
    shape: Complex[np.ndarray, "direction mode"],
    held: int = 0,
) -> BandModel:
    """Positive model with the given poles and shapes, by expectation-maximisation."""
    none = np.zeros((len(shape), len(shape)), dtype=complex)
    model = BandModel(pole, shape, 0 * shape, none, none, pole, held)
    return restarted(data, dataclasses.replace(model, length=data.length, turn=data.turn))


def restarted(data: BandData, model: BandModel) -> BandModel:
    """Positive model with the same poles and shapes, by expectation-maximisation.

    White forces on the modes and white background are drawn jointly with a covariance W; each
    round replaces W by its mean given data and W, and no round lowers the likelihood.
    """
    pole, shape = model.pole, model.shape
    modes, directions = len(pole), len(shape)
    gain = 1.0 / (1j * data.omega[:, None] - pole)
    unit = np.broadcast_to(np.eye(directions), (len(gain), directions, directions))
    seen = np.concatenate([shape * gain[:, None, :], unit], axis=2)
    weight = data.number / data.number.sum()
    power = np.real(np.diagonal(data.density, axis1=1, axis2=2))
    drawn = np.zeros((modes + directions, modes + directions), dtype=complex)
    drawn[modes:, modes:] = np.diag(np.quantile(power, 0.2, axis=0) + 1e-6 * power.mean(axis=0))
    inverse = np.linalg.pinv(shape)
    for j in range(modes):
        nearest = np.argsort(np.abs(data.omega - pole[j].imag))[:3]
        own = inverse[j] @ data.density[nearest].mean(axis=0) @ inverse[j].conj()
        drawn[j, j] = 0.5 * max(own.real, 1e-9) * pole[j].real ** 2
    for _ in range(WARM_UP):
        spread = seen @ drawn
        density = spread @ seen.conj().transpose(0, 2, 1)
        gather = np.linalg.solve(density, spread).conj().transpose(0, 2, 1)
        surprise = gather @ (data.density - density) @ gather.conj().transpose(0, 2, 1)
        drawn = drawn + np.tensordot(weight, surprise, axes=1)
        drawn = (drawn + drawn.conj().T) / 2
    share = -drawn[:modes, :modes] / (pole[:, None] + pole.conj())
    force = (share @ shape.conj().T + drawn[:modes, modes:]).conj().T
    level = drawn[modes:, modes:]
    return dataclasses.replace(model, force=force, level=level, slope=0 * level)


def fit(data: BandData, model: BandModel, *, enough: float = CONVERGED) -> BandFit:
    """Climb from a positive model to the likeliest one near by.

    Poles stay at first; while forces are far off, they would leave for where one is missing.
    """
    model, density, converged = _climbed(data, forced(data, model), enough)
    free = model.free()
    information, _ = _information(data, model, density)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = _inverse(information)
    return BandFit(model, log_likelihood(data, density), covariance, converged)


def forced(data: BandData, model: BandModel) -> BandModel:
    """Fit forces, shapes and background, roughly, to poles that stay."""
    still = dataclasses.replace(model, still=True)
    found, *_ = _climbed(data, still, ROUGHLY, most=FEW_STEPS)
    return dataclasses.replace(found, still=model.still)


def _climbed(
    data: BandData, model: BandModel, enough: float, most: int = MOST_STEPS
) -> tuple[BandModel, np.ndarray, bool]:
    """Fisher scoring, damped where a step would not climb; model, density, and whether done."""
    density = model.density(data.omega)
    best = _posterior(data, model, density)
    damping, converged = 1e-3, False
    free = model.free()
    whole = np.zeros(len(free))
    for _ in range(most):
        information, score = _information(data, model, density)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        scaled, slope = information / scale[:, None] / scale, score / scale
        accepted = False
        for _ in range(12):
            step = np.linalg.solve(scaled + damping * np.eye(len(scaled)), slope)
            promised = float(slope @ step)
            whole[free] = step / scale
            trial = _moved(model, whole)
            trial_density = trial.density(data.omega)
            likelihood = _posterior(data, trial, trial_density)
            if likelihood >= best - 1e-10 * abs(best):
                accepted = True
                break
            damping = max(damping, 1e-4) * 6.0
        if not accepted:
            converged = promised < 1.0
            break
        model, density, best = trial, trial_density, likelihood
        # A step kept short by a wall, where no density is left, promises little by itself.
        if promised < enough and damping < FREELY:
            converged = True
            break
        damping /= 8.0
    return model, density, converged


def _posterior(data: BandData, model: BandModel, density: np.ndarray) -> float:
    away, wide = model.ties()
    return log_likelihood(data, density) - 0.5 * float(np.sum((away / wide) ** 2))


class Prospects:
    """What one more mode would add to a model, to first order (half a score statistic)."""

    def __init__(self, data: BandData, model: BandModel) -> None:
        density = model.density(data.omega)
        self._data, self._density = data, density
        self._root = _whitener(data, density)
        self._rows = _slopes(model, data.omega, self._root)
        self._left = _misfit(data, density, self._root)
        information, score = _tied(model, self._rows @ self._rows.T, self._rows @ self._left)
        self._inverse = _inverse(information)
        self._step = self._inverse @ score

    def gain(
        self, pole: complex, shape: Complex[np.ndarray, " direction"]
    ) -> tuple[float, Complex[np.ndarray, " direction"]]:
        """Log-likelihood gained by a mode at a pole, and with which shape.

        The better of two: the shape given, and that which the data ask for there.
        """
        shapes = shape, self._asked_for(pole)
        gains = [self._gain(pole, each) for each in shapes]
        return max(gains), shapes[int(np.argmax(gains))]

    def _gain(self, pole: complex, shape: np.ndarray) -> float:
        # With no force as yet, neither pole nor shape of the new mode makes a difference.
        gain = 1.0 / (1j * self._data.omega - pole)
        seen = gain[:, None] * (self._root @ shape)
        own = _pairs(seen[None], self._root.transpose(2, 0, 1))
        across = self._rows @ own.T
        known = own @ own.T - across.T @ self._inverse @ across
        left = own @ self._left - across.T @ self._step
        return float(0.5 * left @ _inverse((known + known.T) / 2) @ left)

    def _asked_for(self, pole: complex) -> np.ndarray:
        """Shape along which a little power at a pole would raise the likelihood most."""
        weight = self._data.number / np.abs(1j * self._data.omega - pole) ** 2
        inverse = np.linalg.inv(self._density)
        slope = inverse @ (self._data.density - self._density) @ inverse
        size, slope = (np.tensordot(weight, each, axes=1) for each in (inverse, slope))
        root = np.linalg.inv(np.linalg.cholesky(size))
        directions = np.linalg.eigh(root @ slope @ root.conj().T)[1]
        shape = root.conj().T @ directions[:, -1]
        return np.asarray(shape / np.linalg.norm(shape))


def _information(
    data: BandData, model: BandModel, density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fisher information and score of all parameters."""
    root = _whitener(data, density)
    rows = _slopes(model, data.omega, root)
    return _tied(model, rows @ rows.T, rows @ _misfit(data, density, root))


def _tied(
    model: BandModel, information: np.ndarray, score: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Add what is known beforehand."""
    modes = 0 if model.still else len(model.pole) - model.held
    away, wide = (each[:, :modes].T.reshape(-1) for each in model.ties())
    own = np.arange(2 * modes)
    information[own, own] += wide**-2
    score[own] -= away / wide**2
    return information, score


def _whitener(data: BandData, density: np.ndarray) -> np.ndarray:
    """Inverse roots of the density, weighted by the number of ordinates."""
    weight = data.number[:, None, None] ** 0.25
    return np.asarray(np.linalg.inv(np.linalg.cholesky(density)) * weight)


def _misfit(data: BandData, density: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Density of the data less that of the model, whitened and packed."""
    left = root @ (data.density - density) @ root.conj().transpose(0, 2, 1)
    row, column = _triangle(left.shape[-1])
    packed = np.empty((len(left), left.shape[-1] ** 2))
    _pack(left[:, row, column], packed)
    return packed.reshape(-1)


def _slopes(model: BandModel, omega: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Differentiate the density by free parameters; whitened, packed, one a row.

    All derivatives are outer products, so that vectors are whitened rather than matrices.
    """
    directions, free = len(model.shape), len(model.pole) - model.held
    gain, bent = (each[:, :, None] for each in model.gain(omega))
    unit = root.transpose(2, 0, 1)
    plain = (root @ model.shape).transpose(2, 0, 1)
    shape = gain * plain
    force = (root @ model.force).transpose(2, 0, 1)
    heard = gain.conj() * force
    moving = 0 if model.still else free
    of_poles = _pairs(bent[:moving] * plain[:moving], force[:moving])
    of_poles[::2] *= model.pole[:moving].real[:, None]
    of_shapes = _pairs(unit, heard[:free, None])
    of_forces = _pairs(shape[:, None], unit)
    of_forces[1::2] *= -1.0
    level = _hermitian_pairs(unit)
    slope = level.reshape(directions**2, len(omega), -1) * omega[:, None]
    return np.concatenate([of_poles, of_shapes, of_forces, level, slope.reshape(level.shape)])


def _pairs(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Outer products of vectors plus their adjoints, and the same of i times the first.

    Packed, ["2 * pair", "group * direction ** 2"].
    """
    directions = one.shape[-1]
    row, column = _triangle(directions)
    forth = one[..., row] * other.conj()[..., column]
    back = other[..., row] * one.conj()[..., column]
    packed = np.empty((*forth.shape[:-2], 2, forth.shape[-2], directions**2))
    _pack(forth + back, packed[..., 0, :, :])
    _pack(1j * (forth - back), packed[..., 1, :, :])
    return packed.reshape(-1, forth.shape[-2] * directions**2)


def _hermitian_pairs(unit: np.ndarray) -> np.ndarray:
    """Whitened matrices of the basis of Hermitian ones, packed."""
    directions = len(unit)
    low, high = np.tril_indices(directions)
    both = _pairs(unit[low], unit[high])
    own = 2 * np.flatnonzero(low == high)
    both[own] *= 0.5
    return np.delete(both, own + 1, axis=0)


def _pack(upper: np.ndarray, packed: np.ndarray) -> None:
    """Upper triangles of Hermitian matrices as real vectors with the same inner products."""
    directions = math.isqrt(packed.shape[-1])
    packed[..., :directions] = upper.real[..., :directions]
    size = math.sqrt(2.0)
    middle = upper.shape[-1]
    packed[..., directions:middle] = size * upper.real[..., directions:]
    packed[..., middle:] = size * upper.imag[..., directions:]


@functools.cache
def _triangle(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the diagonal, then of what is above it."""
    own, (row, column) = np.arange(size), np.triu_indices(size, 1)
    return np.concatenate([own, row]), np.concatenate([own, column])


def _hermitian_basis(size: int) -> np.ndarray:
    """Matrices that span the Hermitian ones, with real coefficients."""
    basis = np.zeros((size**2, size, size), dtype=complex)
    at = 0
    for i in range(size):
        for j in range(i):
            basis[at, i, j] = basis[at, j, i] = 1.0
            basis[at + 1, i, j], basis[at + 1, j, i] = 1j, -1j
            at += 2
        basis[at, i, i] = 1.0
        at += 1
    return basis


def _moved(model: BandModel, step: np.ndarray) -> BandModel:
    directions, modes = model.shape.shape
    of_poles = np.clip(step[: 2 * modes : 2], -1.0, 1.0), step[1 : 2 * modes : 2]
    pole = model.pole.real * np.exp(of_poles[0]) + 1j * (model.pole.imag + of_poles[1])
    parts = step[2 * modes :]
    size = 2 * directions * modes
    shape, force = (
        (part[::2] + 1j * part[1::2]).reshape(modes, directions).T
        for part in (parts[:size], parts[size : 2 * size])
    )
    basis = _hermitian_basis(directions)
    level, slope = np.split(parts[2 * size :], 2)
    return dataclasses.replace(
        model,
        pole=pole,
        shape=model.shape + shape,
        force=model.force + force,
        level=model.level + np.tensordot(level, basis, axes=1),
        slope=model.slope + np.tensordot(slope, basis, axes=1),
    )


def _inverse(information: np.ndarray) -> np.ndarray:
    """Inverse on what the data tell of; length and phase of the shapes are not among it."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    power, directions = np.linalg.eigh(information / scale[:, None] / scale)
    keep = power > GAUGE * power[-1]
    inverse = (directions[:, keep] / power[keep]) @ directions[:, keep].T
    return np.asarray(inverse / scale[:, None] / scale)
