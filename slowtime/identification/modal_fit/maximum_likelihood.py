r"""Maximum likelihood of poles and residues in spectra with Gaussian noise.

Given the poles, residues and residual terms are a linear least-squares problem for each entry;
the poles alone are iterated on (variable projection). The error of the poles is the inverse of
the Fisher information where the noise of different entries is independent. It need not be:
what shakes a structure besides the measured inputs is seen by all sensors. The covariance is
therefore a sandwich of the information and of the covariance of the score, with the coherence
of the residuals of the entries in it.

References
----------
.. [1] P. Guillaume, P. Verboven, S. Vanlanduit, "Frequency-domain maximum likelihood
   identification of modal parameters with confidence intervals", ISMA 23 (1998).
.. [2] G. H. Golub, V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least
   squares problems whose variables separate", SIAM J. Numerical Analysis 10 (1973); L. Kaufman,
   BIT 15 (1975).
.. [3] R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed.
   (2012), sections 9.11 (maximum likelihood) and 6.3.2 (transients).
"""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from .basis import (
    END_POWERS,
    POWER,
    RESIDUAL_POWERS,
    modal_columns,
    pole_derivatives,
    residual_columns,
    response_columns,
)
from .spectral_data import SpectralData

ROUNDS = 40
"""Steps of Levenberg and Marquardt, at most."""

SETTLED = 1e-4
"""[standard deviations] A step of all poles below this ends the iteration."""

LONGEST_STEP = 0.5
"""[decay rates of the pole] Longest move of a pole in one step: beyond, the spectrum near it is
no longer linear in it."""

COHERENCE_ROWS = 40
"""[rows] Over which the coherence of the residuals of entries is averaged: its random error is
then 0.16, with either sign."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoleFit:
    """Poles and residues of greatest likelihood.

    Parameters
    ----------
    covariance
        Of their real parts, then of their imaginary parts [(rad/s)^2].
    residue_sd
        Standard deviation of the complex error of each residue, the poles given.
    residue_slope
        Derivatives of the residues by real, then imaginary parts of the poles.
    information
        Share of each row in what is known of each pole [1]; sums to 1 over rows.
    leverage
        Share of each row in what was fitted, 0 to 1: expected loss of its residual power.
    fitted
        Frequency response of each row, entry and input by the model.
    chi_square
        Sum of squared residuals over the variance of the noise, two for each row and entry.
    freedom
        Real residuals less real parameters.
    """

    poles: Complex[np.ndarray, " mode"]
    covariance: Float[np.ndarray, "parameter parameter"]
    residues: Complex[np.ndarray, "entry input mode"]
    residue_sd: Float[np.ndarray, "entry input mode"]
    residue_slope: Complex[np.ndarray, "entry input mode parameter"]
    information: Float[np.ndarray, "row mode"]
    terms: Float[np.ndarray, "entry input term"]
    residuals: Complex[np.ndarray, "row entry"]
    leverage: Float[np.ndarray, "row entry"]
    fitted: Complex[np.ndarray, "row entry input"]
    chi_square: float
    freedom: int


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Projection:
    """Linear least squares of one entry, and what is left of its derivatives by the poles."""

    coefficients: np.ndarray
    coefficient_variance: np.ndarray
    coefficient_slope: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    leverage: np.ndarray


def fit_poles(
    data: SpectralData, poles: Complex[np.ndarray, " mode"], *, rounds: int = ROUNDS
) -> PoleFit:
    """Fit poles and residues, from starting values of the poles.

    Starting values have positive frequency and negative real part; with 0 rounds, residues are
    those at the given poles. Raises `ValueError` where there are fewer rows than parameters.
    """
    _check(data, poles)
    poles = np.asarray(poles, dtype=complex)
    parts = _project(data, poles)
    cost = _cost(parts)
    damping = 1e-3
    for _ in range(rounds):
        normal, gradient = _normal_equations(parts)
        scale = np.sqrt(np.diag(normal))
        step = _step(normal, gradient, scale, damping)
        moved = _moved(poles, step)
        tried = _project(data, moved)
        found = _cost(tried)
        if found < cost:
            small = float(np.max(np.abs(step) * scale)) < SETTLED
            poles, parts, cost = moved, tried, found
            damping = max(damping / 5, 1e-9)
            if small:
                break
        else:
            damping *= 8
            if damping > 1e8:
                break
    return _finished(data, poles, parts, cost)


def _check(data: SpectralData, poles: np.ndarray) -> None:
    columns = len(_sizes(data, len(poles))[0]) if len(poles) else 0
    if len(poles) == 0:
        raise ValueError("No pole was given. Give starting values, such as those of pLSCF.")
    if 2 * len(data.s) <= columns + 2 * len(poles):
        raise ValueError(
            f"{len(data.s)} frequencies were given for {len(poles)} modes and "
            f"{columns} coefficients. Give a wider band, a longer record or fewer modes."
        )


def _sizes(data: SpectralData, modes: int) -> tuple[np.ndarray, int, int]:
    """Return indices of all columns, columns of an input and columns of an end."""
    of_input = 2 * modes + len(RESIDUAL_POWERS[data.kind])
    of_end = 2 * modes + len(END_POWERS)
    total = of_input * data.inputs.shape[1] + of_end * data.ends.shape[1]
    return np.arange(total), of_input, of_end


def _design(data: SpectralData, poles: np.ndarray) -> np.ndarray:
    """Complex columns of all coefficients, the same for every entry."""
    own = response_columns(data.s, poles, data.kind)
    blocks = [own * factor[:, None] for factor in data.inputs.T]
    if data.ends.shape[1]:
        end = np.concatenate(
            [modal_columns(data.s, poles, 0), residual_columns(data.s, END_POWERS)], axis=1
        )
        blocks += [end * factor[:, None] for factor in data.ends.T]
    return np.concatenate(blocks, axis=1)


def _stacked(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _project(data: SpectralData, poles: np.ndarray) -> list[_Projection]:
    design = _design(data, poles)
    return [_entry(data, poles, design, entry) for entry in range(data.values.shape[1])]


def _entry(
    data: SpectralData, poles: np.ndarray, design: np.ndarray, entry: int
) -> _Projection:
    weight = np.sqrt(2.0) / data.sd[:, entry]
    left = _stacked(design * weight[:, None])
    size = np.linalg.norm(left, axis=0)
    q, r = scipy.linalg.qr(left / size, mode="economic", check_finite=False)
    right = _stacked(data.values[:, entry] * weight)
    inner = q.T @ right
    coefficients = scipy.linalg.solve_triangular(r, inner, check_finite=False) / size
    inverse = scipy.linalg.solve_triangular(r, np.eye(len(r)), check_finite=False)
    derivative = _stacked(_derivatives(data, poles, coefficients) * weight[:, None])
    rows = len(data.s)
    power = np.sum(q**2, axis=1)
    along = q.T @ derivative
    return _Projection(
        coefficients=coefficients,
        coefficient_variance=np.sum(inverse**2, axis=1) / size**2,
        coefficient_slope=-(inverse @ along) / size[:, None],
        residual=right - q @ inner,
        jacobian=derivative - q @ along,
        leverage=0.5 * (power[:rows] + power[rows:]),
    )


def _derivatives(data: SpectralData, poles: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Return derivatives of one entry by real and imaginary parts of the poles."""
    _, of_input, of_end = _sizes(data, len(poles))
    derivative = np.zeros((len(data.s), 2 * len(poles)), dtype=complex)
    at = 0
    for factors, power, width in (
        (data.inputs, POWER[data.kind], of_input),
        (data.ends, 0, of_end),
    ):
        for factor in factors.T:
            residues = _complex(coefficients[at : at + width], len(poles))
            derivative += factor[:, None] * pole_derivatives(data.s, poles, power, residues)
            at += width
    return derivative


def _complex(coefficients: np.ndarray, modes: int) -> np.ndarray:
    return np.asarray(coefficients[:modes] + 1j * coefficients[modes : 2 * modes])


def _cost(parts: list[_Projection]) -> float:
    return float(sum(part.residual @ part.residual for part in parts))


def _normal_equations(parts: list[_Projection]) -> tuple[np.ndarray, np.ndarray]:
    normal = sum(part.jacobian.T @ part.jacobian for part in parts)
    gradient = sum(part.jacobian.T @ part.residual for part in parts)
    return np.asarray(normal), np.asarray(gradient)


def _step(
    normal: np.ndarray, gradient: np.ndarray, scale: np.ndarray, damping: float
) -> np.ndarray:
    scaled = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
    return np.asarray(scipy.linalg.solve(scaled, gradient / scale, assume_a="pos") / scale)


def _moved(poles: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Poles after a step, none of them further than its decay rate allows."""
    move = step[: len(poles)] + 1j * step[len(poles) :]
    most = LONGEST_STEP * np.abs(poles.real)
    return np.asarray(poles + move * np.minimum(1.0, most / np.maximum(np.abs(move), 1e-300)))


def _finished(
    data: SpectralData, poles: np.ndarray, parts: list[_Projection], cost: float
) -> PoleFit:
    normal, _ = _normal_equations(parts)
    scale = np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True)
    inverse = inverse / np.outer(scale, scale)
    leverage = _leverage(parts, inverse)
    covariance = _sandwich(data, parts, inverse, leverage)
    # Noise that entries have in common moves the poles further, and is absorbed by them more.
    leverage = _leverage(parts, covariance)
    modes, (count, of_input, _) = len(poles), _sizes(data, len(poles))
    inputs, entries = data.inputs.shape[1], len(parts)
    shape = (entries, inputs, of_input)
    own = np.stack([p.coefficients[: inputs * of_input] for p in parts]).reshape(shape)
    variance = np.stack([p.coefficient_variance[: inputs * of_input] for p in parts])
    variance = variance.reshape(shape)
    slope = np.stack([p.coefficient_slope[: inputs * of_input] for p in parts])
    slope = slope.reshape(*shape, 2 * modes)
    columns = response_columns(data.s, poles, data.kind)
    rows = len(data.s)
    residual = np.stack([p.residual[:rows] + 1j * p.residual[rows:] for p in parts], axis=1)
    order = np.argsort(poles.imag)
    both = np.concatenate([order, modes + order])
    return PoleFit(
        poles=poles[order],
        covariance=covariance[np.ix_(both, both)],
        residues=(own[..., :modes] + 1j * own[..., modes : 2 * modes])[..., order],
        residue_sd=np.sqrt(variance[..., :modes] + variance[..., modes : 2 * modes])[
            ..., order
        ],
        residue_slope=(slope[:, :, :modes] + 1j * slope[:, :, modes : 2 * modes])[:, :, order][
            ..., both
        ],
        information=_information(parts, rows)[:, order],
        terms=own[..., 2 * modes :],
        residuals=residual * data.sd / np.sqrt(2.0),
        leverage=leverage,
        fitted=np.einsum("rc,eic->rei", columns, own),
        chi_square=cost,
        freedom=entries * (2 * rows - len(count)) - 2 * modes,
    )


def _information(parts: list[_Projection], rows: int) -> np.ndarray:
    """Share of each row in the information on each pole."""
    power = np.asarray(sum(p.jacobian[:rows] ** 2 + p.jacobian[rows:] ** 2 for p in parts))
    modes = power.shape[1] // 2
    power = power[:, :modes] + power[:, modes:]
    return np.asarray(power / np.maximum(power.sum(axis=0), 1e-300))


def _leverage(parts: list[_Projection], covariance: np.ndarray) -> np.ndarray:
    """Share of each row and entry in what was fitted, that of the poles included."""
    found = []
    for part in parts:
        rows = len(part.leverage)
        of_poles = np.einsum("rp,pq,rq->r", part.jacobian, covariance, part.jacobian)
        found.append(part.leverage + 0.5 * (of_poles[:rows] + of_poles[rows:]))
    return np.asarray(np.clip(np.stack(found, axis=1), 0.0, 0.95))


def _sandwich(
    data: SpectralData, parts: list[_Projection], inverse: np.ndarray, leverage: np.ndarray
) -> np.ndarray:
    """Covariance of the poles, with what the noise of entries and of rows has in common."""
    lags = data.line_correlation
    if len(parts) == 1 and len(lags) == 1:
        return inverse
    rows = len(leverage)
    jacobian = np.stack([p.jacobian[:rows] + 1j * p.jacobian[rows:] for p in parts], axis=1)
    if data.common is not None:
        meat = _common_meat(jacobian, data.common / data.sd[:, :, None])
    else:
        left = np.stack([p.residual[:rows] + 1j * p.residual[rows:] for p in parts], axis=1)
        meat = _coherent_meat(jacobian, left / np.sqrt(2.0 * (1.0 - leverage)), lags)
    return np.asarray(inverse @ meat @ inverse)


def _common_meat(jacobian: np.ndarray, common: np.ndarray) -> np.ndarray:
    """Covariance of the score where the common noise is known."""
    own = np.sqrt(np.maximum(1.0 - np.sum(np.abs(common) ** 2, axis=2), 0.0))
    meat = np.einsum(
        "rep,req->pq", (own[..., None] * jacobian).conj(), own[..., None] * jacobian
    )
    shared = np.einsum("rek,rep->rkp", common.conj(), jacobian)
    return np.asarray((meat + np.einsum("rkp,rkq->pq", shared.conj(), shared)).real)


def _coherent_meat(jacobian: np.ndarray, left: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Covariance of the score by the coherence of the residuals of entries."""
    rows, parameters = len(left), jacobian.shape[2]
    meat = np.zeros((parameters, parameters))
    for piece in np.array_split(np.arange(rows), max(1, rows // COHERENCE_ROWS)):
        power = left[piece].T @ left[piece].conj() / len(piece)
        size = np.sqrt(np.maximum(np.diag(power).real, 1e-300))
        coherence = power / np.outer(size, size)
        for lag, shared in enumerate(lags):
            later = piece[piece + lag < rows] + lag
            mixed = np.einsum("ef,rfp->rep", shared * coherence, jacobian[later])
            part = np.einsum("rep,req->pq", jacobian[piece[: len(later)]].conj(), mixed).real
            meat += part if lag == 0 else part + part.T
    return meat
