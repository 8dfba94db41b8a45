r"""Test of "no member has lost stiffness", of one-sided scores of all members.

With the slope s of the rows by the loss of a member, the covariance R of the difference and the
difference r, the score of a member is

.. math:: z = s^T R^{-1} r \,/\, \sqrt{s^T R^{-1} s}

which is N(0, 1) without a change. The largest of all members is compared with its distribution,
drawn from the correlation of the scores, so that many members raise no more false alarms.
"""

import dataclasses
import functools

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy.special import chdtrc, ndtr

_DRAWS = 20_000
"""Draws of the largest score [1]: the threshold errs by 0.01 standard deviations."""

_UNSEEN = 1e-6
"""Size of a change by the loss of all stiffness [sd] below which it is not seen at all."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MemberTest:
    """Scores of members, and what they are without a change.

    Parameters
    ----------
    slope
        Derivative of the rows by the loss of each member, without losses.
    covariance
        Of the difference without a change.
    seed
        Of the draws.
    """

    slope: Float[np.ndarray, "row member"]
    covariance: Float[np.ndarray, "row row"]
    seed: int = 0

    @functools.cached_property
    def signatures(self) -> Float[np.ndarray, "row member"]:
        """Unit directions of the members among differences made white; zero if unseen."""
        white = self.whiten(self.slope)
        size = np.linalg.norm(white, axis=0)
        return np.asarray(np.where(size > _UNSEEN, white / np.maximum(size, _UNSEEN), 0.0))

    @functools.cached_property
    def _factor(self) -> np.ndarray:
        return np.asarray(scipy.linalg.cholesky(self.covariance, lower=True))

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Differences over their errors made white."""
        return np.asarray(scipy.linalg.solve_triangular(self._factor, rows, lower=True))

    @functools.cached_property
    def _largest(self) -> Float[np.ndarray, " draw"]:
        """Ascending draws of the largest score without a change."""
        random = np.random.default_rng(self.seed)
        left, size, _ = np.linalg.svd(self.signatures.T, full_matrices=False)
        draws = (left * size) @ random.standard_normal((len(size), _DRAWS))
        return np.sort(draws.max(axis=0))

    def threshold(self, level: float) -> float:
        """Largest score that is exceeded without a change with probability `level` [sd]."""
        return float(np.quantile(self._largest, 1.0 - level))

    def scores(self, difference: Float[np.ndarray, " row"]) -> Float[np.ndarray, " member"]:
        """Score of each member [sd]."""
        return np.asarray(self.signatures.T @ self.whiten(difference))

    def p_value(self, difference: Float[np.ndarray, " row"]) -> float:
        """Probability of a score as large without a change, exact or at most [1]."""
        largest = float(self.scores(difference).max())
        drawn = float(np.mean(self._largest >= largest))
        bound = min(1.0, float(self.slope.shape[1] * ndtr(-largest)))
        return min(drawn, bound) if drawn > 0.0 else bound

    def misfit_p_value(self, difference: Float[np.ndarray, " row"]) -> float:
        """Probability of a difference as large as a whole without a change [1]."""
        white = self.whiten(difference)
        return float(chdtrc(len(white), white @ white))
