"""Sensors and errors → the smallest loss of each member that an assessment will find."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.special import ndtri

from .change_model import ChangeModel
from .member_test import MemberTest

TOLD_APART = 2.0
"""Standard deviations [1] between two predicted changes up to which members are not told
apart: the wrong one is likelier than the right one with probability 16 % (half the distance
is exceeded)."""

_SCANNED = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 0.98)
"""Losses [1] between which a limit is sought. Where modes exchange their shapes, scores fall
again, and the difference as a whole raises the alarm instead."""

_EXACT = 1e-3
"""Error of a limit [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class DetectionLimit:
    """The smallest loss of one member that is found.

    Parameters
    ----------
    name
        Of the member.
    loss
        Smallest loss that raises the alarm and is in the named set, with the probability that
        was asked for [1]; NaN where even the loss of all is not found.
    alike
        Other members whose predicted change is within two standard deviations of the one at
        this loss.
    """

    name: str
    loss: float
    alike: tuple[str, ...]


def detection_limits(
    model: ChangeModel, test: MemberTest, *, level: float, power: float, coverage: float
) -> tuple[DetectionLimit, ...]:
    r"""Find the smallest loss of each member that an assessment finds.

    The score of the member is :math:`N(m(a), s^2(a))` at the loss a, with the change and the
    errors of the model solved for at a. A loss is found where the score exceeds the threshold
    of the test with probability `power` / `coverage`, as the named set holds the member with
    probability `coverage`.

    Parameters
    ----------
    model
        Of the state before.
    test
        Scores of the members.
    level
        Probability of a false alarm [1].
    power
        Probability with which a loss is found [1].
    coverage
        Probability of the named set [1], above `power`.

    Returns
    -------
    One limit for each member.
    """
    threshold, quantile = test.threshold(level), float(ndtri(power / coverage))

    def excess(loss: float, which: int) -> float:
        change = model.change(loss * np.eye(len(model.theta))[which])
        along = test.signatures[:, which]
        spread = test.whiten(test.whiten(change.covariance).T)
        sd = math.sqrt(1.0 + float(along @ spread @ along))
        return float(along @ test.whiten(change.rows)) - threshold - quantile * sd

    found = []
    for which, name in enumerate(model.structure.names):
        loss = _smallest(functools.partial(excess, which=which))
        alike = () if math.isnan(loss) else members_alike(model, test, which, loss)
        names = tuple(model.structure.names[j] for j in alike)
        found.append(DetectionLimit(name, loss, names))
    return tuple(found)


def _smallest(excess: Callable[[float], float]) -> float:
    """Find the smallest loss at which an excess is positive; NaN where it nowhere is."""
    below = 0.0
    for above in _SCANNED:
        if excess(above) > 0.0:
            return float(brentq(excess, below, above, xtol=_EXACT))
        below = above
    return math.nan


def members_alike(model: ChangeModel, test: MemberTest, which: int, loss: float) -> list[int]:
    """Find the members whose change is not told apart from that of a loss of one.

    Parameters
    ----------
    model
        Of the state before.
    test
        With the covariance of the difference.
    which
        The member that loses stiffness.
    loss
        What it loses [1].

    Returns
    -------
    Positions of others that come within `TOLD_APART` of its change, each with its own loss, to
    first order.
    """
    change = model.change(loss * np.eye(len(model.theta))[which])
    errors = dataclasses.replace(test, covariance=test.covariance + change.covariance)
    white = errors.whiten(change.rows)
    along = np.maximum(errors.signatures.T @ white, 0.0)
    away: Float[np.ndarray, " member"] = np.sqrt(np.maximum(white @ white - along**2, 0.0))
    return [int(j) for j in np.flatnonzero(away <= TOLD_APART) if j != which]
