r"""Failure probability, survival and hazard over slow time, from futures of the changes.

Changes are epistemic: futures are drawn from what readings allow. Loads are aleatory: drawn
anew at each event. With events of rate :math:`\lambda` and a capacity R that stays,

.. math:: S(t) = E\left[\exp\left(-\lambda \int_0^t p(x(s), R)\, ds\right)\right],

the mean over futures and capacities taken last: :math:`E[e^{-A}] \ge e^{-E[A]}`. Where the
state itself fails, S is the share of futures that have not failed so far.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from .states import LimitState, normal_index

BAND = (0.05, 0.95)
"""Shares of the futures between which the band of a probability lies."""

Times = Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True)
class Assessment:
    """One limit state over slow time.

    Parameters
    ----------
    slow_time
        From now on.
    probability
        Of failure at the moment, or at an event at that moment; mean over the futures.
    lo, hi
        5 % and 95 % of the futures' own probabilities: what more readings could change.
    survival
        Probability of no failure from now until then.
    survival_lo, survival_hi
        5 % and 95 % over the futures.
    """

    slow_time: Times
    probability: Times
    lo: Times
    hi: Times
    survival: Times
    survival_lo: Times
    survival_hi: Times

    @property
    def beta(self) -> Times:
        """Reliability index of the probability."""
        return normal_index(self.probability)

    @property
    def failure(self) -> Times:
        """Probability of failure from now until then."""
        return np.asarray(1.0 - self.survival)

    @property
    def hazard(self) -> Times:
        """Failures per slow time among those that have survived."""
        log = np.log(np.maximum(self.survival, 1e-300))
        if len(log) < 2:
            return np.zeros_like(log)
        return np.asarray(np.maximum(-np.gradient(log, self.slow_time), 0.0))

    def when(self, accepted: float) -> float:
        """Slow time at which the probability of failure so far reaches an accepted one.

        Interpolated linearly between the instants.

        Parameters
        ----------
        accepted
            Accepted probability of failure [1].

        Returns
        -------
        Slow time; infinite where the probability is not reached.
        """
        failed = self.failure
        if failed[0] >= accepted:
            return float(self.slow_time[0])
        later = np.flatnonzero(failed >= accepted)
        if not len(later):
            return float("inf")
        k = int(later[0])
        share = (accepted - failed[k - 1]) / (failed[k] - failed[k - 1])
        step = self.slow_time[k] - self.slow_time[k - 1]
        return float(self.slow_time[k - 1] + share * step)


def assess(
    state: LimitState, slow_time: Times, futures: Mapping[str, Float[np.ndarray, "path time"]]
) -> Assessment:
    """Assess a limit state over slow time, from futures of the changes.

    Parameters
    ----------
    state
        What fails.
    slow_time
        Now and later, ascending.
    futures
        Quantity → its change along each future; rows of one number belong together.

    Returns
    -------
    Failure probability and survival over slow time.

    Raises
    ------
    ValueError
        Where a quantity of the limit state has no futures.
    """
    missing = [name for name in state.quantities if name not in futures]
    if missing:
        raise ValueError(
            f"{', '.join(missing)}: not estimated by this twin. It estimates: "
            f"{', '.join(futures) or 'nothing yet'}."
        )
    used = {name: futures[name] for name in state.quantities}
    given, weights = state.given(used)  # [capacity path time]
    each = np.einsum("cpt,c->pt", given, weights)
    lo, hi = np.quantile(each, BAND, axis=0)
    rate = state.events
    if rate is None:
        alive = np.minimum.accumulate(1.0 - given, axis=2)
    else:
        step = np.diff(slow_time)
        middle = 0.5 * (given[:, :, 1:] + given[:, :, :-1])
        exposure = np.concatenate(
            [np.zeros((*given.shape[:2], 1)), np.cumsum(middle * step, axis=2)], axis=2
        )
        alive = np.exp(-rate * exposure)
    surviving = np.einsum("cpt,c->pt", alive, weights)
    below, above = np.quantile(surviving, BAND, axis=0)
    return Assessment(
        slow_time, each.mean(axis=0), lo, hi, surviving.mean(axis=0), below, above
    )


def history(
    state: LimitState,
    value: Mapping[str, Times],
    sd: Mapping[str, Times],
    *,
    paths: int = 400,
    seed: int = 0,
) -> tuple[Times, Times, Times]:
    """Probability of failure at past readings, with its band.

    Parameters
    ----------
    state
        Limit state.
    value, sd
        Quantity → its change at each reading, and the standard deviation.
    paths
        Number of draws of the changes.
    seed
        Seed of the draws.

    Returns
    -------
    Mean, 5 % and 95 % at each reading.
    """
    rng = np.random.default_rng(seed)
    drawn = {
        name: value[name] + sd[name] * rng.standard_normal((paths, 1))
        for name in state.quantities
    }
    given, weights = state.given(drawn)
    each = np.einsum("cpt,c->pt", given, weights)
    lo, hi = np.quantile(each, BAND, axis=0)
    return each.mean(axis=0), lo, hi
