r"""Likelihood of the Fourier coefficients of one mode, with their leakage correlations.

A record begins and ends in the middle of a vibration. The jump from its end to its beginning
leaks into every Fourier coefficient alike, so that with few half-bandwidths in the record the
ordinates are not independent, as Whittle's likelihood takes them. For an oscillator of pole s
under white force, with :math:`dz = s z \, dt + dw` its mode, the coefficients are exactly

.. math:: Y_k = H(\omega_k) W_k + \frac{r}{\sqrt T (i \omega_k - s)} \, d
          + \frac{\bar r}{\sqrt T (i \omega_k - \bar s)} \, \bar d + \text{noise} ,
          \qquad d = z(0) - z(T) ,

with independent :math:`W_k` of density 1 and

.. math:: \mathrm{E} |d|^2 = (1 - \mathrm{Re}\, e^{sT}) / \alpha, \quad
          \mathrm{E} d^2 = -(1 - e^{sT}) / s, \quad
          \mathrm{E} W_k \bar d = \frac{1 - e^{\bar s T}}{\sqrt T (i \omega_k + \bar s)} ,

:math:`\alpha = -\mathrm{Re}\, s`: their covariance is diagonal but for a matrix of rank four,
and their likelihood costs as little as Whittle's.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from .whittle import (
    COLOUR,
    COLOUR_PRIOR,
    DAMPING,
    FLOOR,
    FLOOR_PRIOR,
    FREQUENCY,
    PEAK,
    PosteriorMaximum,
)

ROWS, COLUMNS = np.triu_indices(4)
"""Products of the jumps and leaks of a mode and of its conjugate that are not alike."""

STEP = 0.25
"""Step of the finite differences [standard deviations]."""

STEPS = 20
"""Newton steps, at most."""

FARTHEST = 1.5
"""Longest Newton step of one parameter [standard deviations]."""

CONVERGED = 0.02
"""Expected gain of log-likelihood below which the search stops."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FourierCoefficients:
    """Fourier coefficients of a band; |value|² is a one-sided density."""

    frequency_hz: Float[np.ndarray, " frequency"]
    value: Complex[np.ndarray, " frequency"]
    duration_s: float
    derivatives: int
    floor: float

    def log_posterior(
        self, parameters: Float[np.ndarray, "case parameter"]
    ) -> Float[np.ndarray, " case"]:
        """Log-posterior of (ln f, ln zeta, ln peak, ln floor, colour), up to a constant.

        The prior is flat but for that of the floor and of the colour of the force.

        Each row of parameters is f [Hz], zeta [1], peak and floor of the one-sided density, and
        the exponent of the force spectrum.
        """
        # Of the cases of a difference few differ in more than levels: only levels are a case's.
        place: dict[tuple[float, ...], int] = {}
        rows = parameters[:, [FREQUENCY, DAMPING, COLOUR]].tolist()
        of_case = np.array([place.setdefault(tuple(row), len(place)) for row in rows])
        poles = np.array(list(place))
        response, products, size = self._unit_mode(poles)
        peak, floor = np.exp(parameters[:, [PEAK, FLOOR]]).T
        level = peak * (2 * np.exp(parameters[:, DAMPING])) ** 2
        own = level[:, None] * response[of_case] + floor[:, None]
        summed = np.empty((len(parameters), products.shape[2]), dtype=complex)
        for mode, terms in enumerate(products):
            own_cases = of_case == mode
            summed[own_cases] = (1 / own[own_cases] @ terms.view(float)).view(complex)
        height = _log_density(np.abs(self.value) ** 2, own, level, summed, size[of_case])
        return height - 0.5 * (
            FLOOR_PRIOR * (parameters[:, FLOOR] - self.floor) ** 2
            + COLOUR_PRIOR * parameters[:, COLOUR] ** 2
        )

    def _unit_mode(
        self, poles: Float[np.ndarray, "mode 3"]
    ) -> tuple[
        Float[np.ndarray, "mode frequency"],
        Complex[np.ndarray, "mode frequency 14"],
        Complex[np.ndarray, "mode 2 2"],
    ]:
        """Density of modes of unit level; products of jumps, leaks, values; sizes of jumps."""
        seconds, omega = self.duration_s, 2 * np.pi * self.frequency_hz
        omega0 = 2 * np.pi * np.exp(poles[:, :1])
        damping, ratio = np.exp(poles[:, 1:2]), omega / omega0
        pole = omega0 * (-damping + 1j * np.sqrt(np.maximum(1 - damping**2, 1e-12)))
        response = (1j * ratio) ** self.derivatives * np.exp(0.5 * poles[:, 2:] * np.log(ratio))
        response = response / (1 - ratio**2 + 2j * damping * ratio)
        residue = omega0**2 * (pole / omega0) ** self.derivatives / (2j * pole.imag)
        jumps, leaks = [], []
        # Both poles of the pair: the mode and its conjugate jump by d and its conjugate.
        for one, left in ((pole, residue), (pole.conj(), residue.conj())):
            kept = (1 - np.exp(one.conj() * seconds)) / np.sqrt(seconds)
            jumps.append(response * (kept / (1j * omega + one.conj())))
            leaks.append(left / np.sqrt(seconds) / (1j * omega - one))
        both = np.stack([*jumps, *leaks])
        against = both.conj()
        products = np.concatenate([against[ROWS] * both[COLUMNS], against * self.value])
        products = np.ascontiguousarray(products.transpose(1, 2, 0))
        return np.abs(response) ** 2, products, _jumps(pole[:, 0], seconds)


def _jumps(pole: np.ndarray, seconds: float) -> np.ndarray:
    """Covariance of the jump of a mode and of its conjugate."""
    own = (1 - np.exp(pole * seconds)).real / -pole.real
    both = -(1 - np.exp(pole * seconds)) / pole
    found = np.empty((len(pole), 2, 2), dtype=complex)
    found[:, 0, 0] = found[:, 1, 1] = own
    found[:, 0, 1], found[:, 1, 0] = both, both.conj()
    return found


def _log_density(
    square: np.ndarray, own: np.ndarray, level: np.ndarray, summed: np.ndarray, size: np.ndarray
) -> np.ndarray:
    """Of complex Gaussians with covariance diag(own) + level (h c* + c h* + c size c*)."""
    # `summed` are the products of h and c, and those with the values, over `own`.
    inner = np.empty((len(own), 4, 4), dtype=complex)
    inner[:, ROWS, COLUMNS] = level[:, None] * summed[:, :10]
    inner[:, COLUMNS, ROWS] = inner[:, ROWS, COLUMNS].conj()
    # Inverse of [[0, 1], [1, size]], whose determinant is 1.
    inner[:, :2, :2] -= size
    inner[:, [0, 1], [2, 3]] += 1.0
    inner[:, [2, 3], [0, 1]] += 1.0
    seen = summed[:, 10:]
    solved = np.linalg.solve(inner, seen[..., None])[..., 0]
    explained = level * (seen.conj() * solved).sum(axis=1).real
    volume = np.abs(np.linalg.det(inner))
    quadratic = (1 / own) @ square - explained
    result = -np.log(own).sum(axis=1) - np.log(volume) - quadratic
    return np.asarray(np.where(np.isfinite(result), result, -np.inf))


def maximise_posterior(
    data: FourierCoefficients,
    start: Float[np.ndarray, " parameter"],
    sd: Float[np.ndarray, " parameter"],
    *,
    held: tuple[int, ...] = (),
) -> PosteriorMaximum:
    """Find the maximum of the posterior by Newton steps with finite differences.

    Differences are scaled by `sd`, about the standard deviations. Parameters at the places
    `held` stay where they are; their covariance is 0.
    """
    free = np.array([k for k in range(len(start)) if k not in held])
    theta, damping = start.copy(), 0.0
    best, slope, curvature = _expanded(data, theta, sd, free)
    for _ in range(STEPS):
        values, vectors = np.linalg.eigh(curvature)
        inverse = (vectors / (np.maximum(values, 0.05) + damping)) @ vectors.T
        step = inverse @ slope
        step = step * min(1.0, FARTHEST / np.abs(step).max())
        if float(slope @ step) < CONVERGED:
            # The expansion knows the top that is so near: no need to look there.
            theta[free] += step * sd[free]
            best += float(slope @ step - 0.5 * step @ curvature @ step)
            break
        trial = theta.copy()
        trial[free] += step * sd[free]
        reached = float(data.log_posterior(trial[None])[0])
        if reached < best - 1e-6:
            damping = max(4.0 * damping, 0.5)
            if damping > 1e4:
                break
            continue
        theta, damping = trial, damping / 8.0
        best, slope, curvature = _expanded(data, theta, sd, free)
    values, vectors = np.linalg.eigh(curvature)
    covariance = np.zeros((len(start), len(start)))
    inverse = (vectors / np.maximum(values, 0.05)) @ vectors.T
    covariance[np.ix_(free, free)] = inverse * np.outer(sd[free], sd[free])
    return PosteriorMaximum(theta, covariance, best)


def _expanded(
    data: FourierCoefficients, theta: np.ndarray, sd: np.ndarray, free: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Value, slopes and negative curvature in units of `sd`."""
    count = len(free)
    first, second = np.triu_indices(count, 1)
    moves = [np.zeros(count)]
    eye = STEP * np.eye(count)
    moves += [*eye, *-eye]
    moves += [*(eye[first] + eye[second]), *(-eye[first] - eye[second])]
    cases = np.repeat(theta[None], len(moves), axis=0)
    cases[:, free] += np.array(moves) * sd[free]
    value = data.log_posterior(cases)
    middle, up, down = value[0], value[1 : 1 + count], value[1 + count : 1 + 2 * count]
    both = value[1 + 2 * count :].reshape(2, -1)
    slope = (up - down) / (2 * STEP)
    curvature = np.diag((2 * middle - up - down) / STEP**2)
    mixed = up[first] + up[second] + down[first] + down[second] - 2 * middle - both.sum(axis=0)
    curvature[first, second] = curvature[second, first] = mixed / (2 * STEP**2)
    return float(middle), slope, curvature
