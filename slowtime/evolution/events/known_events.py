r"""Repairs, replacements and inspections, and their effect on the state estimate.

With :math:`x` the relative change of a quantity (0 as built, -0.1 once a tenth is gone) and
:math:`D = -x` its damage, a repair that restores the share :math:`\rho` leaves

.. math:: x^+ = (1 - \rho) x^-, \qquad
          \operatorname{var} x^+ = (1 - \rho)^2 \operatorname{var} x^-
          + \sigma_\rho^2 \operatorname{E} (x^-)^2 + \sigma_0^2 .

That is the virtual age :math:`v^+ = (1 - \rho) v^-` of Kijima's second model, for damage that
is proportional to age. What is known of the rate of change before a repair informs the rate
after it; a replacement forgets it.

References
----------
.. [1] M. Kijima, "Some results for repairable systems with general repair", Journal of Applied
   Probability 26 (1989), 89-102.
.. [2] U.S. Department of Defense, MIL-HDBK-1823A, "Nondestructive evaluation system reliability
   assessment" (2009): hit/miss data, probit link on the logarithm of the size.
"""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from slowtime.estimation.state_space import Belief, StateSpace

NOMINAL_SD = 0.02
"""Standard deviation of a relative change just after it was restored [1]: how far workmanship
and the nominal model may be off. Small against damage worth a repair, and large against the
error of a mean of a few readings, so that these overrule a repair that was told wrongly."""

RATE_SD = 0.5
"""Standard deviation of the change of a rate by a repair, over the rate before it [1]: damage
that slows down as it grows runs faster after a repair, damage that speeds up runs slower."""

UNKNOWN_SHARE = 0.5, 12.0**-0.5
"""Mean and standard deviation of a restored share that is not told [1]: uniform on 0 to 1."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(256)
_REACH = 8.0
"""Standard deviations about the mean over which a likelihood of detection is integrated."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Repair:
    """A repair between two readings.

    Parameters
    ----------
    time
        Slow time of the last reading before it.
    share, share_sd
        Restored share of the damage [1], and its standard deviation; 1 for a perfect repair.
    level_sd
        Standard deviation of the change that is left beside [1].
    """

    time: float
    share: float = 1.0
    share_sd: float = 0.0
    level_sd: float = NOMINAL_SD

    def met(self, process: StateSpace, belief: Belief) -> Belief:
        """Belief just after the repair.

        Parameters
        ----------
        belief
            Belief just before it.
        """
        mean, covariance = belief.mean.copy(), belief.covariance
        seen = _observation_row(process, belief)
        level, variance = _value(belief, seen)
        # The level takes up the jump; what sways about it goes on as before.
        size = mean.shape[-1]
        change = np.broadcast_to(np.eye(size), covariance.shape).copy()
        change[..., 0, :] -= self.share * seen
        moved = change @ covariance @ np.swapaxes(change, -1, -2)
        slope = mean[..., 1] ** 2 + covariance[..., 1, 1]
        moved[..., 0, 0] += self.share_sd**2 * (level**2 + variance) + self.level_sd**2
        moved[..., 1, 1] += RATE_SD**2 * slope
        mean[..., 0] -= self.share * level
        return Belief(belief.time, mean, moved)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Replacement:
    """A part that was replaced by another between two readings.

    Parameters
    ----------
    time
        Slow time of the last reading before it.
    level
        Relative change of the new part [1]; None where only readings can tell.
    level_sd
        Standard deviation of that [1].
    """

    time: float
    level: float | None = 0.0
    level_sd: float = NOMINAL_SD

    def met(self, process: StateSpace, belief: Belief) -> Belief:
        """Belief before any reading of the new part.

        Parameters
        ----------
        belief
            Belief just before the replacement.
        """
        begun = process.start(belief.time)
        mean = np.broadcast_to(begun.mean, belief.mean.shape).copy()
        covariance = np.broadcast_to(begun.covariance, belief.covariance.shape).copy()
        begun = Belief(belief.time, mean, covariance)
        if self.level is None:
            return begun
        change = np.broadcast_to(np.eye(mean.shape[-1]), covariance.shape).copy()
        change[..., 0, :] -= _observation_row(process, begun)
        moved = change @ covariance @ np.swapaxes(change, -1, -2)
        moved[..., 0, 0] += self.level_sd**2
        mean = (change @ mean[..., None])[..., 0]
        mean[..., 0] += self.level
        return Belief(belief.time, mean, moved)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A relative change that an inspection has measured.

    Parameters
    ----------
    time
        Slow time of the last reading before it.
    value, sd
        The change, and its standard deviation [1].
    """

    time: float
    value: float
    sd: float

    def met(self, process: StateSpace, belief: Belief) -> Belief:
        """Belief after the inspection.

        Parameters
        ----------
        belief
            Belief just before it.
        """
        seen = _observation_row(process, belief)
        mean, variance = _value(belief, seen)
        share = variance / (variance + self.sd**2)
        return _conditioned_belief(
            belief, seen, mean + share * (self.value - mean), (1.0 - share) * variance
        )


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class DetectionCurve:
    r"""Probability of detection of damage of a size.

    Either :math:`\Phi(s \ln(a / a_{50}))`, or straight between points.

    Parameters
    ----------
    a50
        Damage that is found with probability one half [1].
    slope
        :math:`s`, rise of the probit over one unit of :math:`\ln a` [1].
    points
        Damages, ascending, and the probability of each [1]; instead of the other two.

    Examples
    --------
    >>> DetectionCurve(a50=0.1, slope=2.0).probability(np.array([0.0, 0.1])).tolist()
    [0.0, 0.5]
    """

    a50: float | None = None
    slope: float | None = None
    points: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Refuse what is no curve."""
        formula = self.a50 is not None and self.slope is not None
        if formula == bool(self.points):
            raise ValueError(
                f"a50={self.a50}, slope={self.slope} and {len(self.points)} points were given. "
                "Give a50 and slope, or points, for one curve."
            )

    def probability(self, damage: Float[np.ndarray, "*size"]) -> Float[np.ndarray, "*size"]:
        """Probability that damage of each size is found [1]; of none, as of damage 0.

        Parameters
        ----------
        damage
            Sizes of damage, relative [1].

        Returns
        -------
        Probability of detection of each.
        """
        size = np.maximum(damage, 0.0)
        if self.points:
            at, share = np.array(self.points).T
            return np.asarray(np.interp(size, at, share))
        assert self.a50 is not None
        assert self.slope is not None
        with np.errstate(divide="ignore"):
            return np.asarray(ndtr(self.slope * (np.log(size) - np.log(self.a50))))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """Whether an inspection has found damage.

    Parameters
    ----------
    time
        Slow time of the last reading before it.
    detected
        Whether damage was found.
    curve
        With which probability damage of a size is found.
    """

    time: float
    detected: bool
    curve: DetectionCurve

    def met(self, process: StateSpace, belief: Belief) -> Belief:
        """Belief after the inspection: mean and variance by quadrature of Bayes' rule.

        Parameters
        ----------
        belief
            Belief just before it.
        """
        seen = _observation_row(process, belief)
        mean, variance = _value(belief, seen)
        sd = np.sqrt(np.maximum(variance, 0.0))
        points = mean[..., None] + _REACH * sd[..., None] * _NODES
        found = self.curve.probability(-points)
        likelihood = found if self.detected else 1.0 - found
        weights = likelihood * np.exp(-0.5 * (_REACH * _NODES) ** 2) * _WEIGHTS
        total = weights.sum(axis=-1)
        # Of what cannot be, as finding damage that is not there, nothing is learnt.
        known = total > 1e-12
        weights = weights / np.where(known, total, 1.0)[..., None]
        after = np.sum(weights * points, axis=-1)
        spread = np.sum(weights * (points - after[..., None]) ** 2, axis=-1)
        return _conditioned_belief(
            belief, seen, np.where(known, after, mean), np.where(known, spread, variance)
        )


KnownEvent: TypeAlias = Repair | Replacement | Measurement | Detection


def is_jump(event: KnownEvent) -> bool:
    """Whether an event may change the quantity itself.

    Returns
    -------
    True for repairs and replacements.
    """
    return isinstance(event, Repair | Replacement)


def apply_event(process: StateSpace, belief: Belief, event: KnownEvent) -> Belief:
    """Belief just after an event, carried on to its time first.

    Parameters
    ----------
    process
        A process or a family of them, with the level first in its state and its slope second.
    belief
        Of a time no later than that of the event.
    event
        Event, with its time and effect.
    """
    apart = event.time - belief.time
    if apart > 0.0:
        move, noise = process.advance(np.array([apart]))
        mean = (move[0] @ belief.mean[..., None])[..., 0]
        covariance = move[0] @ belief.covariance @ np.swapaxes(move[0], -1, -2) + noise[0]
        belief = Belief(event.time, mean, covariance)
    after = event.met(process, belief)
    covariance = 0.5 * (after.covariance + np.swapaxes(after.covariance, -1, -2))
    return Belief(after.time, after.mean, covariance)


def _observation_row(process: StateSpace, belief: Belief) -> np.ndarray:
    """Give what of the state a reading would see now."""
    return np.asarray(process.observation_row(np.array([belief.time]))[0])


def _value(belief: Belief, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the quantity of each member."""
    mean = np.sum(belief.mean * seen, axis=-1)
    variance = np.sum((belief.covariance @ seen[..., None])[..., 0] * seen, axis=-1)
    return mean, variance


def _conditioned_belief(
    belief: Belief, seen: np.ndarray, mean: np.ndarray, variance: np.ndarray
) -> Belief:
    """Belief whose quantity has this mean and variance, all else following by regression."""
    before, spread = _value(belief, seen)
    gain = (belief.covariance @ seen[..., None])[..., 0]
    gain = gain / np.where(spread > 0.0, spread, 1.0)[..., None]
    shift = gain * (mean - before)[..., None]
    outer = gain[..., :, None] * gain[..., None, :]
    covariance = belief.covariance + outer * (variance - spread)[..., None, None]
    return Belief(belief.time, belief.mean + shift, covariance)
