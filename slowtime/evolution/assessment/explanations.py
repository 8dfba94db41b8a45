r"""Sets of changed members with their evidence.

Under the hypothesis that the members S have lost the shares a of their stiffness, uniform
between 0 and 1, the difference of the modes is
:math:`N(d(a), R + \Sigma(a))`. Its evidence is Laplace's about the likeliest losses, at which
the model is solved again, with the part of the Gaussian that lies between no loss and all. Sets
of k members share the prior probability :math:`2^{-k}`, so that many members do not make a
change likelier.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy.optimize import lsq_linear
from scipy.special import chdtrc, log_ndtr

from .change_model import ChangeModel, PredictedChange

_MOST_LOSS = 0.99
"""Share [1] of the stiffness that a member loses at most; without any it may be a mechanism."""

_FIRST_LOSS = 0.05
"""Loss [1] from which the fit of a further member begins."""

_ITERATIONS, _CLOSE, _HALVINGS = 12, 1e-3, 4
"""Steps of a fit, step [1] at which it has arrived, and halvings of a step that is no gain."""

_ENUMERATED, _FITTED = 40, 10
"""Members, the likeliest ones, of which all sets are compared to first order, and sets that are
fitted then. Source: judgement; 40 members have 9,880 sets of three."""

_LARGE = 0.8
"""Loss [1] beyond which first order does not lead a fit to start."""

_HOPELESS = 8.0
"""Logarithm of odds to the best [1] from which a set is not looked at: 1 in 3,000."""

_NONLINEAR = 0.3
"""Share [1] of the gain in log-likelihood by which first order may err, for losses of 30 %."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """One set of members, and the losses that explain the difference best.

    Parameters
    ----------
    members
        Positions of the members, ascending.
    loss
        Losses of these members [1].
    predicted
        Change of the modes by these losses.
    residual, slope
        What is left of the difference, and its slope by the loss of each member, both made
        white.
    log_likelihood
        At these losses.
    """

    members: tuple[int, ...]
    loss: Float[np.ndarray, " changed"]
    predicted: PredictedChange
    residual: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row member"]
    log_likelihood: float

    @property
    def covariance(self) -> Float[np.ndarray, "changed changed"]:
        """Covariance of the losses."""
        own = self.slope[:, [*self.members]]
        return np.asarray(np.linalg.inv(own.T @ own + 1e-9 * np.eye(len(self.members))))

    @property
    def sd(self) -> Float[np.ndarray, " changed"]:
        """Standard deviations of the losses [1]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def log_evidence(self) -> float:
        """Logarithm of evidence times prior probability."""
        covariance, size, count = self.covariance, len(self.members), self.slope.shape[1]
        pull = self.slope[:, [*self.members]].T @ self.residual
        mean = self.loss + covariance @ pull
        within = sum(map(_log_within, mean.tolist(), self.sd.tolist()))
        volume = 0.5 * (size * math.log(2 * math.pi) + np.linalg.slogdet(covariance)[1])
        prior = -size * math.log(2.0) - math.log(math.comb(count, size))
        top = self.log_likelihood + 0.5 * float(pull @ covariance @ pull)
        return float(top + volume + within + prior)

    @property
    def p_value(self) -> float:
        """Probability of a misfit as large, were it right [1]."""
        free = max(len(self.residual) - len(self.members), 1)
        return float(chdtrc(free, self.residual @ self.residual))


def _log_within(mean: float, sd: float) -> float:
    """Logarithm of the probability that a Gaussian lies between 0 and 1."""
    far = max(mean, 1.0 - mean) / sd
    near = (max(mean, 1.0 - mean) - 1.0) / sd
    more, less = float(log_ndtr(-near)), float(log_ndtr(-far))
    return more + math.log1p(-min(math.exp(less - more), 1.0 - 1e-12))


class ExplanationSearch:
    """Search over sets of members, each of which is fitted once.

    All members are fitted alone. Of larger sets, all are compared to first order about the best
    one so far, and the likeliest are fitted, until none is better. Then each member of the best
    set is exchanged for all others that may do as well.

    Parameters
    ----------
    model
        Predicts the change by losses.
    covariance
        Of the difference without a change.
    most
        Largest number of changed members.
    """

    def __init__(
        self, model: ChangeModel, covariance: Float[np.ndarray, "row row"], most: int = 3
    ) -> None:
        self.model = model
        self.covariance = covariance
        self.most = min(most, len(model.structure.names))
        self.nothing = self._at((), np.zeros(0))
        self._found: dict[tuple[int, ...], Explanation] = {(): self.nothing}

    def run(self) -> list[Explanation]:
        """Fit sets of one member and more; return them, likeliest first."""
        self._exchanged(self.nothing)
        for size in range(2, self.most + 1):
            smaller = self._ranked(size - 1)
            if smaller[0].log_evidence < self._ranked()[0].log_evidence - _HOPELESS:
                break
            self._until_best(functools.partial(self._enumerated, size=size))
        self._until_best(self._members_exchanged)
        return self._ranked()

    def _ranked(self, size: int | None = None) -> list[Explanation]:
        found = [
            one for one in self._found.values() if one.members and size in (None, len(one.loss))
        ]
        return sorted(found, key=lambda one: (-one.log_evidence, one.members))

    def _until_best(self, improve: Callable[[Explanation], None]) -> None:
        """Improve the best set until it stays the best."""
        done = None
        while (best := self._ranked()[0]) is not done:
            improve(best)
            done = best

    def _enumerated(self, about: Explanation, size: int) -> None:
        """Fit the likeliest sets of a size, all of which are compared to first order."""
        gram = about.slope.T @ about.slope
        own = [*about.members]
        along = about.slope.T @ (about.residual + about.slope[:, own] @ about.loss)
        alone = np.maximum(along, 0.0) / np.sqrt(np.maximum(np.diag(gram), 1e-12))
        few = np.sort(np.argsort(-alone, kind="stable")[:_ENUMERATED])
        few = np.union1d(few, np.array(own, dtype=int))
        sets = np.array([*itertools.combinations(few.tolist(), size)])
        inner = gram[sets[:, :, None], sets[:, None, :]] + 1e-6 * np.eye(size)
        losses = np.linalg.solve(inner, along[sets][:, :, None])[:, :, 0]
        gain = np.where((losses > 0.0).all(axis=1), (along[sets] * losses).sum(axis=1), -1.0)
        for k in np.argsort(-gain, kind="stable")[:_FITTED]:
            if gain[k] > 0.0:
                start = np.clip(losses[k], 0.0, _LARGE)
                self._fitted(tuple(sets[k].tolist()), start)

    def _members_exchanged(self, best: Explanation) -> None:
        for i in best.members:
            rest = [k for k, j in enumerate(best.members) if j != i]
            members = tuple(best.members[k] for k in rest)
            self._exchanged(self._fitted(members, best.loss[rest]))

    def _exchanged(self, base: Explanation) -> None:
        """Fit a set with each further member that may explain the rest, to first order."""
        own = [*base.members]
        inside = np.linalg.qr(base.slope[:, own])[0]
        slope = base.slope - inside @ (inside.T @ base.slope)
        size = np.maximum(np.linalg.norm(slope, axis=0), 1e-12)
        gain = 0.5 * np.maximum(slope.T @ base.residual / size, 0.0) ** 2
        gain[own] = -np.inf
        reach = _HOPELESS + _NONLINEAR * max(float(gain.max()), 0.0)
        for j in np.flatnonzero(gain >= gain.max() - reach).tolist():
            pairs = sorted([*zip(own, base.loss.tolist(), strict=True), (j, _FIRST_LOSS)])
            members, start = zip(*pairs, strict=True)
            self._fitted(members, np.array(start))

    def _fitted(
        self, members: tuple[int, ...], start: Float[np.ndarray, " changed"]
    ) -> Explanation:
        """Find the likeliest losses of a set, from a start."""
        if members in self._found:
            return self._found[members]
        here, own = self._at(members, start), [*members]
        for _ in range(_ITERATIONS):
            slope = here.slope[:, own]
            aim = lsq_linear(slope, here.residual + slope @ here.loss, (0.0, _MOST_LOSS)).x
            for halving in range(_HALVINGS):
                there = self._at(members, here.loss + 0.5**halving * (aim - here.loss))
                if there.log_likelihood >= here.log_likelihood:
                    break
            else:
                break
            step, here = np.abs(there.loss - here.loss).max(), there
            if step < _CLOSE:
                break
        self._found[members] = here
        return here

    def _at(self, members: tuple[int, ...], loss: Float[np.ndarray, " changed"]) -> Explanation:
        whole = np.zeros(len(self.model.structure.names))
        whole[[*members]] = loss
        predicted = self.model.change(whole)
        root = scipy.linalg.cholesky(self.covariance + predicted.covariance, lower=True)
        left = self.model.difference.values - predicted.rows
        white = scipy.linalg.solve_triangular(
            root, np.column_stack([left, predicted.slope]), lower=True
        )
        height = -0.5 * float(white[:, 0] @ white[:, 0]) - float(np.log(np.diag(root)).sum())
        return Explanation(members, loss, predicted, white[:, 0], white[:, 1:], height)
