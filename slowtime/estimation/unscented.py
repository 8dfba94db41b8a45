r"""Nonlinear state, parameters, or both: the unscented filter in square-root form.

.. math:: x_k = f(x_{k-1}, u_k) + w_k, \quad z_k = h(x_k, u_k) + \nu_k

Moments are carried through f and h by :math:`2 n + 1` points at :math:`m \pm c S_j`,
:math:`c^2 = \alpha^2 (n + \kappa)` (Julier and Uhlmann, 2004). With the half-sums and
half-differences of a pair about the centre,

.. math:: o_j = (y^+_j - y^-_j) / 2, \quad e_j = (y^+_j + y^-_j) / 2 - y_0,

the transformed covariance is

.. math:: P = \frac{1}{c^2} \Big[ O O^T + E (I - \gamma 1 1^T) E^T \Big],
          \qquad \gamma = (\alpha^2 - \beta) / c^2,

where :math:`\gamma n \le 1` for all :math:`\alpha > 0`, :math:`\beta \ge 0`,
:math:`\kappa \ge 0`: a sum of squares. The usual form of it has a weight near
:math:`-\alpha^{-2}` at the centre and downdates a root by it, which is where filters lose
their covariance. Here nothing is subtracted, at the same result.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .gaussian import FilterStep, Gaussian, root_of, smooth, take_in, triangular

__all__ = ["FilterStep", "Gaussian", "Unscented", "smooth"]

Through = Callable[[np.ndarray, Any], np.ndarray]
"""(points, known) to what becomes of each: the last axis changes, those before it do not."""

Noise = Float[np.ndarray, "... state noise"] | Callable[[np.ndarray, Any], np.ndarray]

_SHORTER = (1.0, 0.1, 0.01)
"""Shares of the reach tried where points leave what can be computed."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Unscented:
    """An unscented filter.

    Parameters
    ----------
    move
        f: (points, known) to the points one step later, without noise.
    read
        h: (points, known) to what would be read at each, without noise.
    process_root
        Root of the covariance of process noise, with as many columns as there are
        noises; or a function (mean, known) that gives it, where it depends on the state.
    reading_noise
        Covariance of the noise of a reading.
    alpha, beta, kappa
        Reach of the points, weight of what bends, and more reach. The default has points at
        sqrt(n) standard deviations, exact to third order in Gaussian states.
    gate
        Probability below which a reading is rejected as none of this model; None takes all.

    Examples
    --------
    A square is read; what is asked is its side:

    >>> side = Unscented(move=lambda x, known: x, read=lambda x, known: x**2,
    ...                  process_root=np.zeros((1, 1)), reading_noise=1e-4 * np.eye(1))
    >>> belief = side.start(np.array([2.5]), np.array([[0.25]]))
    >>> for _ in range(20):
    ...     belief, _ = side.step(belief, np.array([9.0]))
    >>> bool(abs(belief.mean[0] - 3.0) < 0.01)
    True
    """

    move: Through
    read: Through
    process_root: Noise
    reading_noise: Float[np.ndarray, "... reading reading"]
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    gate: float | None = None
    _reading_root: np.ndarray = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (self.alpha > 0.0 and self.beta >= 0.0 and self.kappa >= 0.0):
            raise ValueError(
                f"alpha={self.alpha}, beta={self.beta}, kappa={self.kappa}: with these a "
                "covariance need not be positive. Give alpha above 0, beta and kappa not below."
            )
        object.__setattr__(self, "_reading_root", root_of(self.reading_noise))

    def start(
        self,
        mean: Float[np.ndarray, "*twins state"],
        covariance: Float[np.ndarray, "*twins state state"],
    ) -> Gaussian:
        """Belief one step before the first reading.

        Parameters
        ----------
        mean
            Mean of the state.
        covariance
            Covariance of the state.

        Returns
        -------
        The belief.
        """
        return Gaussian.of(mean, covariance)

    def step(
        self,
        belief: Gaussian,
        reading: Float[np.ndarray, "*twins reading"],
        known: Any = None,
    ) -> tuple[Gaussian, FilterStep]:
        """Predict one step, and update by one reading.

        A twin for which f or h has no finite value near its mean stays where it was, and its
        reading counts as rejected.

        Parameters
        ----------
        belief
            Belief after the reading before.
        reading
            Reading; NaN entries are missing.
        known
            Input that is passed to f and h.

        Returns
        -------
        Belief after the reading, and the details of the step.
        """
        mean, moved, fine = self._carry(self.move, belief, known)
        stays = np.concatenate([belief.root, np.zeros_like(belief.root)], axis=-1)
        if not fine.all():
            mean = np.where(fine[..., None], mean, belief.mean)
            moved = np.where(fine[..., None, None], moved, stays)
        noise = self._noise(belief.mean, known)
        noise = np.broadcast_to(noise, (*mean.shape[:-1], *noise.shape[-2:]))
        after = np.concatenate([moved, noise], axis=-1)
        before = np.concatenate([stays, np.zeros_like(noise)], axis=-1)
        predicted = Gaussian(mean, triangular(after))
        expected, seen, clear = self._carry(self.read, predicted, known)
        fine = fine & clear
        if not fine.all():
            expected = np.where(fine[..., None], expected, 0.0)
            seen = np.where(fine[..., None, None], seen, 0.0)
            lost = ~fine & ~np.isnan(reading).all(axis=-1)
            reading = np.where(fine[..., None], reading, np.nan)
        updated, rest = take_in(
            predicted, expected, predicted.root, seen, reading, self._reading_root, self.gate
        )
        if not fine.all():
            rest["rejected"] = rest["rejected"] | lost
        return updated, FilterStep(predicted, updated, before, after, **rest)

    def run(
        self,
        belief: Gaussian,
        readings: Float[np.ndarray, "time *twins reading"],
        known: Sequence[Any] | np.ndarray | None = None,
    ) -> list[FilterStep]:
        """Filter a whole series.

        Parameters
        ----------
        belief
            Belief one step before the first reading.
        readings
            Readings; NaN entries are missing.
        known
            Input of each step, which is passed to f and h.

        Returns
        -------
        Details of every step.
        """
        steps = []
        for k, reading in enumerate(readings):
            belief, step = self.step(belief, reading, None if known is None else known[k])
            steps.append(step)
        return steps

    def _noise(self, mean: np.ndarray, known: Any) -> np.ndarray:
        if callable(self.process_root):
            return np.asarray(self.process_root(mean, known))
        return self.process_root

    def _carry(
        self, through: Through, belief: Gaussian, known: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean, deviations, and for which twins they are finite."""
        mean, deviations, fine = self._transform(through, belief, known, _SHORTER[0])
        for share in _SHORTER[1:]:
            if fine.all():
                break
            again, nearer, now = self._transform(through, belief, known, share)
            use = now & ~fine
            mean = np.where(use[..., None], again, mean)
            deviations = np.where(use[..., None, None], nearer, deviations)
            fine = fine | now
        return mean, deviations, fine

    def _transform(
        self, through: Through, belief: Gaussian, known: Any, share: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        size = belief.mean.shape[-1]
        alpha = share * self.alpha
        reach = alpha * np.sqrt(size + self.kappa)
        away = reach * np.swapaxes(belief.root, -1, -2)
        centre = belief.mean[..., None, :]
        points = np.concatenate([centre, centre + away, centre - away], axis=-2)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = through(points, known)
            first, up, down = np.split(found, [1, 1 + size], axis=-2)
            odd, even = 0.5 * (up - down), 0.5 * (up + down) - first
            bent = even.sum(axis=-2, keepdims=True)
            mean = (first + bent / reach**2)[..., 0, :]
            left = 1.0 - (alpha**2 - self.beta) * size / reach**2
            even = even - (1.0 - np.sqrt(max(left, 0.0))) / size * bent
            deviations = np.concatenate([odd, even], axis=-2) / reach
        fine = np.isfinite(deviations).all(axis=(-1, -2)) & np.isfinite(mean).all(axis=-1)
        return mean, np.swapaxes(deviations, -1, -2), np.asarray(fine)
