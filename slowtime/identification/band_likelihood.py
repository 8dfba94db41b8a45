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

import numpy as np
from jaxtyping import Complex, Float

MOST_STEPS = 25
CONVERGED = 0.03
"""Steps end once they promise less than so much of log-likelihood."""

GAUGE = 1e-9
"""Directions of less information than this share of the most belong to no parameter."""

DAMPING_SD = 1.0
"""Of log decay about where it started: a pole narrower than one ordinate explains it alone."""

WARM_UP = 25
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
    """

    omega: Float[np.ndarray, " group"]
    density: Complex[np.ndarray, "group direction direction"]
    number: Float[np.ndarray, " group"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandModel:
    """Parameters of the density, poles in the unit of `omega`.

    The last `held` modes are beyond the band: their poles and shapes are known well enough
    for the skirts that they send into it, and stay. `expected` is the logarithm of the decay
    rate about which each pole is thought to lie.
    """

    pole: Complex[np.ndarray, " mode"]
    shape: Complex[np.ndarray, "direction mode"]
    force: Complex[np.ndarray, "direction mode"]
    level: Complex[np.ndarray, "direction direction"]
    slope: Complex[np.ndarray, "direction direction"]
    expected: Float[np.ndarray, " mode"]
    held: int = 0

    def free(self) -> np.ndarray:
        """Which of all real parameters are to be found."""
        directions, modes = self.shape.shape
        free = np.ones(2 * modes + 4 * modes * directions + 2 * directions**2, dtype=bool)
        first = modes - self.held
        free[2 * first : 2 * modes] = False
        free[2 * modes + 2 * directions * first : 2 * modes * (1 + directions)] = False
        return free

    def resonances(self, omega: Float[np.ndarray, " group"]) -> np.ndarray:
        """Part of each mode in the density, ["mode group direction direction"]."""
        gain = 1.0 / (1j * omega[:, None] - self.pole)
        half = np.einsum("im,km,jm->mkij", self.shape, gain, self.force.conj())
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

    def surprise(self) -> np.ndarray:
        """Log decay rates less what was expected, in standard deviations of the prior."""
        return np.asarray((np.log(-self.pole.real) - self.expected) / DAMPING_SD)

    def with_modes(self, pole: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poles and shapes with more of them, those that are held last."""
        at = len(self.pole) - self.held
        return (
            np.insert(self.pole, [at] * len(pole), pole),
            np.insert(self.shape, [at] * len(pole), shape, axis=1),
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
    """Positive model with the given poles and shapes, by expectation-maximisation.

    White forces on the modes and white background are drawn jointly with a covariance W; each
    round replaces W by its mean given data and W, and no round lowers the likelihood.
    """
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
    expected = np.log(-pole.real)
    return BandModel(pole, shape, np.asarray(force), level, 0 * level, expected, held)


def fit(data: BandData, model: BandModel) -> BandFit:
    """Climb from a positive model to the likeliest one near by."""
    density = model.density(data.omega)
    best = _posterior(data, model, density)
    damping, converged = 1e-3, False
    free = model.free()
    whole = np.zeros(len(free))
    for _ in range(MOST_STEPS):
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
        damping /= 8.0
        if promised < CONVERGED:
            converged = True
            break
    information, _ = _information(data, model, density)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = _inverse(information)
    return BandFit(model, log_likelihood(data, density), covariance, converged)


def _posterior(data: BandData, model: BandModel, density: np.ndarray) -> float:
    return log_likelihood(data, density) - 0.5 * float(np.sum(model.surprise() ** 2))


def promise(
    data: BandData,
    model: BandModel,
    pole: complex,
    shape: Complex[np.ndarray, " direction"],
) -> float:
    """Log-likelihood that one more mode would add, to first order (half a score statistic)."""
    # With no force as yet, neither pole nor shape of the new mode makes a difference.
    added = dataclasses.replace(
        model,
        pole=np.append(model.pole, pole),
        shape=np.column_stack([model.shape, shape]),
        force=np.column_stack([model.force, np.zeros_like(shape)]),
        expected=np.append(model.expected, np.log(-pole.real)),
        held=model.held + 1,
    )
    information, score = _information(data, added, model.density(data.omega))
    directions = len(shape)
    own = len(score) - 2 * directions**2 - 2 * directions + np.arange(2 * directions)
    rest = np.setdiff1d(np.arange(len(score)), own)
    known, across = _left_over(information, own, rest)
    left = score[own] - across @ score[rest]
    return float(0.5 * left @ _inverse(known) @ left)


def _information(
    data: BandData, model: BandModel, density: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fisher information and score of all parameters."""
    slopes = _slopes(model, data.omega)[model.free()]
    inverse = np.linalg.inv(np.linalg.cholesky(density)) * data.number[:, None, None] ** 0.25
    turned = inverse.conj().transpose(0, 2, 1)
    whitened = (inverse @ slopes @ turned).reshape(len(slopes), -1)
    rest = (inverse @ (data.density - density) @ turned).reshape(-1)
    columns = np.concatenate([whitened.real, whitened.imag], axis=1)
    information = columns @ columns.T
    score = columns @ np.concatenate([rest.real, rest.imag])
    modes = len(model.pole) - model.held
    decays = np.arange(0, 2 * modes, 2)
    information[decays, decays] += DAMPING_SD**-2
    score[decays] -= model.surprise()[:modes] / DAMPING_SD
    return information, score


def _slopes(model: BandModel, omega: np.ndarray) -> np.ndarray:
    """Differentiate the density, ["parameter group direction direction"]."""
    directions, modes = model.shape.shape
    groups = len(omega)
    gain = 1.0 / (1j * omega[:, None] - model.pole)
    half = np.zeros(
        (2 * modes + 4 * modes * directions, groups, directions, directions), complex
    )
    for j in range(modes):
        bent = np.einsum(
            "i,k,o->kio", model.shape[:, j], gain[:, j] ** 2, model.force[:, j].conj()
        )
        half[2 * j], half[2 * j + 1] = model.pole[j].real * bent, 1j * bent
        first = 2 * modes + 2 * directions * j
        second = first + 2 * directions * modes
        for i in range(directions):
            seen = gain[:, j, None] * model.force[:, j].conj()
            half[first + 2 * i, :, i], half[first + 2 * i + 1, :, i] = seen, 1j * seen
            seen = gain[:, j, None] * model.shape[:, j]
            half[second + 2 * i, :, :, i] = seen
            half[second + 2 * i + 1, :, :, i] = -1j * seen
    whole = half + half.conj().transpose(0, 1, 3, 2)
    basis = np.broadcast_to(
        _hermitian_basis(directions)[:, None], (directions**2, groups, directions, directions)
    )
    return np.concatenate([whole, basis, basis * omega[:, None, None]])


def _hermitian_basis(size: int) -> np.ndarray:
    """Matrices that span the Hermitian ones, with real coefficients."""
    basis = np.zeros((size**2, size, size), dtype=complex)
    at = 0
    for i in range(size):
        basis[at, i, i] = 1.0
        at += 1
        for j in range(i):
            basis[at, i, j] = basis[at, j, i] = 1.0
            basis[at + 1, i, j], basis[at + 1, j, i] = 1j, -1j
            at += 2
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
    return BandModel(
        pole,
        model.shape + shape,
        model.force + force,
        model.level + np.tensordot(level, basis, axes=1),
        model.slope + np.tensordot(slope, basis, axes=1),
        model.expected,
        model.held,
    )


def _left_over(
    information: np.ndarray, own: np.ndarray, rest: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information on some parameters with the rest unknown, and their regression on it."""
    across = information[np.ix_(own, rest)] @ _inverse(information[np.ix_(rest, rest)])
    known = information[np.ix_(own, own)] - across @ information[np.ix_(rest, own)]
    return (known + known.T) / 2, across


def _inverse(information: np.ndarray) -> np.ndarray:
    """Inverse on what the data tell of; length and phase of the shapes are not among it."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    power, directions = np.linalg.eigh(information / scale[:, None] / scale)
    keep = power > GAUGE * power[-1]
    inverse = (directions[:, keep] / power[keep]) @ directions[:, keep].T
    return np.asarray(inverse / scale[:, None] / scale)
