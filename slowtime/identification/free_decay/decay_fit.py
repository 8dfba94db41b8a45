r"""Maximum-likelihood fit of a sum of decaying oscillations, started by ESPRIT.

.. math:: y_n = \sum_k e^{-\alpha_k t_n} (a_k \cos \omega_k t_n + b_k \sin \omega_k t_n)
          + \text{drift} + \text{noise}

Amplitudes and drift are linear and are solved for exactly at every step (variable projection);
Gauss-Newton with damping moves only the poles.
"""

import dataclasses

import numpy as np
import scipy.linalg as la
from jaxtyping import Complex, Float

STEPS = 40
"""Gauss–Newton steps, at most."""

CONVERGED = 1e-3
"""Length of a step at which the search stops [standard deviations]."""

NEARLY = 0.1
"""Length of the last step below which a search that was cut short counts as converged [standard
deviations]."""

BLOCK = 32
"""Times of a block of exponentials [samples], about the root of the length of a series."""

WIDEST_PENCIL = 96
"""Largest number of columns of the Hankel matrix."""

MOST_DIRECTIONS = 6
"""Largest dimension of the signal subspace."""


@dataclasses.dataclass(frozen=True, slots=True)
class DecayFit:
    r"""Fitted poles :math:`-\alpha_k + i \omega_k` [1/s, rad/s], amplitudes, what is left."""

    poles: Complex[np.ndarray, " mode"]
    amplitudes: Complex[np.ndarray, " mode"]
    residual: Float[np.ndarray, " time"]
    unit_covariance: Float[np.ndarray, "part part"]
    """Of (Re poles, Im poles), amplitudes marginalised, per unit of noise variance."""
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)


def drift_basis(count: int, terms: int) -> Float[np.ndarray, "time term"]:
    """Orthonormal cosines over the record: a constant, then rising frequencies."""
    instants = (np.arange(count) + 0.5) / count
    basis = np.cos(np.pi * np.outer(instants, np.arange(terms)))
    return np.asarray(basis / np.linalg.norm(basis, axis=0))


def fit_decays(
    series: Float[np.ndarray, " time"],
    rate_hz: float,
    poles: Complex[np.ndarray, " mode"],
    drift: Float[np.ndarray, "time term"],
    *,
    steps: int = STEPS,
) -> DecayFit:
    """Least squares over poles, amplitudes and drift: maximum likelihood in white noise.

    The series begins at t = 0. Poles to start from have positive imaginary parts, and none may
    coincide. With 0 steps only amplitudes are solved for.
    """
    times = np.arange(len(series)) / rate_hz
    target = series - drift @ (drift.T @ series)
    state = _solve(target, times, poles, drift)
    rounding = 1e-15 * float(target @ target)
    damping, expected = 0.0, 0.0
    for _ in range(steps):
        step, expected = _step(state, damping)
        if expected <= max(CONVERGED**2 * state.variance, rounding):
            break
        if _rings(state.poles + step, times):
            trial = _solve(target, times, state.poles + step, drift)
            if trial.cost <= state.cost * (1 + 1e-12):
                state, damping = trial, damping / 10 if damping > 1e-6 else 0.0
                continue
        damping = max(10 * damping, 1e-3)
        if damping > 1e6:
            break
    return DecayFit(
        state.poles,
        state.amplitudes,
        state.residual,
        np.asarray(np.linalg.pinv(state.normal, hermitian=True)),
        expected <= max(NEARLY**2 * state.variance, rounding) or damping > 1e6,
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _State:
    """Amplitudes solved for at given poles, with what a step needs."""

    poles: np.ndarray
    amplitudes: np.ndarray
    residual: np.ndarray
    normal: np.ndarray
    gradient: np.ndarray
    cost: float

    @property
    def variance(self) -> float:
        return self.cost / max(len(self.residual) - len(self.gradient), 1)


def _solve(
    target: np.ndarray, times: np.ndarray, poles: np.ndarray, drift: np.ndarray
) -> _State:
    """Linear amplitudes, and slopes of the model in real and imaginary part of each pole."""
    waves = _waves(times, poles)
    columns = _clear(np.concatenate([waves.real, -waves.imag], axis=1), drift)
    basis, triangle = np.linalg.qr(columns)
    diagonal = np.abs(np.diag(triangle))
    if diagonal.min() < 1e-9 * diagonal.max():
        triangle = triangle + 1e-9 * (diagonal.max() + 1e-300) * np.eye(len(triangle))
    projected = basis.T @ target
    linear = la.solve_triangular(triangle, projected)
    modes = len(poles)
    amplitudes = linear[:modes] + 1j * linear[modes:]
    residual = target - basis @ projected
    moved = times[:, None] * waves * amplitudes
    slopes = _clear(np.concatenate([moved.real, -moved.imag], axis=1), drift)
    slopes = slopes - basis @ (basis.T @ slopes)
    return _State(
        poles,
        amplitudes,
        residual,
        slopes.T @ slopes,
        slopes.T @ residual,
        float(residual @ residual),
    )


def _waves(times: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Exponentials at equally spaced times from 0 on, a column for each pole.

    Products of those of every `BLOCK`-th time and of the first block: exponentials of complex
    numbers are most of the cost of a step.
    """
    rows = np.exp(np.multiply.outer(poles, times[::BLOCK]))[:, :, None]
    waves = (rows * np.exp(np.multiply.outer(poles, times[:BLOCK]))[:, None, :]).reshape(
        len(poles), -1
    )
    return np.asarray(waves[:, : len(times)].T)


def _rings(poles: np.ndarray, times: np.ndarray) -> bool:
    """Whether poles oscillate below Nyquist, neither dying nor exploding at once."""
    spacing = times[1] - times[0]
    return bool(
        np.all(poles.imag > 0)
        and np.all(poles.imag * spacing < np.pi)
        and np.all(poles.real > -poles.imag)
        and np.all(poles.real * times[-1] < 3.0)
    )


def _clear(columns: np.ndarray, drift: np.ndarray) -> np.ndarray:
    return np.asarray(columns - drift @ (drift.T @ columns))


def _step(state: _State, damping: float) -> tuple[np.ndarray, float]:
    """Gauss-Newton step of the poles, and the fall of the cost that it promises."""
    scale = np.diag(np.diag(state.normal))
    move = np.linalg.lstsq(state.normal + damping * scale, state.gradient, rcond=None)[0]
    modes = len(state.poles)
    return move[:modes] + 1j * move[modes:], float(move @ state.gradient)


def signal_subspace(series: Float[np.ndarray, " time"]) -> Float[np.ndarray, "lag direction"]:
    """Leading directions of the Hankel matrix of a series, the strongest first."""
    window = min(len(series) // 3, WIDEST_PENCIL)
    # A copy: BLAS takes no view whose rows overlap, and the plain loops are ten times as slow.
    hankel = np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(series, window))
    strongest = la.eigh(
        hankel.T @ hankel,
        subset_by_index=(max(window - MOST_DIRECTIONS, 0), window - 1),
        driver="evx",
    )
    return np.asarray(strongest[1][:, ::-1])


def matrix_pencil(
    space: Float[np.ndarray, "lag direction"], rate_hz: float, order: int
) -> Complex[np.ndarray, " mode"]:
    """Poles with positive frequency of the `order` strongest real oscillations (ESPRIT)."""
    # Rotational invariance of the leading directions of the Hankel matrix; good enough to start
    # from, and free of starting values itself.
    vectors = space[:, : 2 * order]
    shift = np.linalg.lstsq(vectors[:-1], vectors[1:], rcond=None)[0]
    ratios = np.linalg.eigvals(shift)
    poles = np.log(ratios[np.abs(ratios) > 1e-6].astype(complex)) * rate_hz
    return np.asarray(np.sort_complex(poles[poles.imag > 1e-9]))
