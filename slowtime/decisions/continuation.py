r"""Expected discounted cost of what follows a renewal, within the time that remains.

An asset is renewed at the end of a cycle (planned repair or failure). With :math:`a_k` the
expected discounted items paid at the k-th time of a cycle and :math:`p_k` the probability that
the cycle ends there, what is paid until the n-th time after a renewal is

.. math:: V_n = \sum_{k \le n} \left( a_k + p_k e^{-r t_k} V_{n-k} \right) .

A repair that restores only the share :math:`\rho` of a damage D leaves :math:`(1 - \rho) D`;
what follows is interpolated between a new asset and one repaired from :math:`D = 1`.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .costs import FAILURE, INSPECTION, REPAIR, Costs, discount
from .ensemble import Ensemble

Values = Float[np.ndarray, "time item"]


@dataclasses.dataclass(frozen=True, slots=True)
class Cycle:
    """How each future goes until its asset is renewed, under some rule.

    Parameters
    ----------
    end
        Index of the time of the renewal; the count of times where there is none.
    failed
        Whether a failure ends it, rather than a planned repair.
    inspected
        Number of inspections at each time.
    ordered
        Index of the time at which the planned repair was ordered; None where none is planned.
    """

    end: Int[np.ndarray, " path"]
    failed: Bool[np.ndarray, " path"]
    inspected: Float[np.ndarray, "path time"] | None = None
    ordered: Int[np.ndarray, " path"] | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Follow:
    """V by remaining time: of a new asset, and of one just repaired from a damage of 1."""

    new: Values
    worn: Values

    def after_repair(
        self, damage: Float[np.ndarray, " path"], remaining: Int[np.ndarray, " path"]
    ) -> Float[np.ndarray, "path item"]:
        """V after a repair from each damage, with so many steps remaining.

        Parameters
        ----------
        damage
            Damage before the repair [1].
        remaining
            Number of steps that remain.

        Returns
        -------
        Expected discounted items.
        """
        share = np.clip(damage, 0.0, 1.0)[:, None]
        mixed = (1.0 - share) * self.new[remaining] + share * self.worn[remaining]
        return np.asarray(mixed)


@dataclasses.dataclass(frozen=True, slots=True)
class Payments:
    """Expected discounted items at each time of a cycle, and how it ends.

    Parameters
    ----------
    items
        a_k.
    new, worn
        Discounted probability that the cycle ends at each time with an asset that is new, or
        as if repaired from a damage of 1.
    """

    items: Values
    new: Float[np.ndarray, " time"]
    worn: Float[np.ndarray, " time"]

    def from_first_step(self) -> "Payments":
        """Move what happens at once to the first step, so that a cycle takes time."""
        moved = []
        for each in (self.items, self.new, self.worn):
            later = each.copy()
            later[1] += later[0]
            later[0] = 0.0
            moved.append(later)
        return Payments(*moved)

    def until_horizon(self, follow: Follow) -> Float[np.ndarray, " item"]:
        """Give the last row of `until`."""
        found: Float[np.ndarray, " item"] = (
            self.items.sum(axis=0) + self.new @ follow.new[::-1] + self.worn @ follow.worn[::-1]
        )
        return found

    def until(self, follow: Follow) -> Values:
        """Give expected discounted items until every time, with V after the first renewal."""
        found = np.cumsum(self.items, axis=0)
        for n in range(len(found)):
            back = slice(n, None, -1)
            found[n] += self.new[: n + 1] @ follow.new[back]
            found[n] += self.worn[: n + 1] @ follow.worn[back]
        return found


def payments(cycle: Cycle, futures: Ensemble, costs: Costs) -> Payments:
    """Give what the cycles of some futures pay, on average."""
    count, weights = len(futures.time), futures.weights
    weight = discount(futures.time, costs.discount_rate)
    ended = cycle.end < count
    at = np.minimum(cycle.end, count - 1)
    failures = np.bincount(at, weights * (ended & cycle.failed), count) * weight
    planned = weights * (ended & ~cycle.failed)
    repairs = np.bincount(at, planned, count) * weight
    share = np.clip(futures.damage[np.arange(len(at)), at], 0.0, 1.0)
    worn = np.bincount(at, planned * share, count) * weight
    items = failures[:, None] * costs.event(FAILURE) + repairs[:, None] * costs.event(REPAIR)
    if cycle.inspected is not None:
        inspections = (weights @ cycle.inspected) * weight
        items = items + inspections[:, None] * costs.event(INSPECTION)
    return Payments(items, failures + repairs - worn, worn)


def follow_of(new: Payments, worn: Payments | None) -> Follow:
    """Solve the renewal equations of a rule.

    Parameters
    ----------
    new, worn
        What its cycles pay that begin with a new asset, and with one repaired from a damage of
        1; None where repairs restore all.

    Returns
    -------
    V by remaining time.
    """
    first = new.from_first_step()
    second = first if worn is None else worn.from_first_step()
    spent = [np.cumsum(each.items, axis=0) for each in (first, second)]
    if worn is None:
        whole = first.new + first.worn
        value = spent[0].copy()
        for n in range(1, len(value)):
            value[n] += whole[1 : n + 1] @ value[n - 1 :: -1][:n]
        return Follow(value, value)
    found = Follow(spent[0].copy(), spent[1].copy())
    for n in range(1, len(found.new)):
        back = slice(n - 1, None, -1)
        for target, each in ((found.new, first), (found.worn, second)):
            target[n] += each.new[1 : n + 1] @ found.new[back][:n]
            target[n] += each.worn[1 : n + 1] @ found.worn[back][:n]
    return found


def per_path(
    cycle: Cycle, futures: Ensemble, costs: Costs, follow: Follow
) -> Float[np.ndarray, "path item"]:
    """Discounted items of each future until the horizon, with V after its renewal."""
    count = len(futures.time)
    weight = discount(futures.time, costs.discount_rate)
    ended = cycle.end < count
    at = np.minimum(cycle.end, count - 1)
    remaining = count - 1 - at
    damage = futures.damage[np.arange(len(at)), at]
    repaired = costs.event(REPAIR) + follow.after_repair(damage, remaining)
    renewed = costs.event(FAILURE) + follow.new[remaining]
    event = np.where(cycle.failed[:, None], renewed, repaired)
    items = (weight[at] * ended)[:, None] * event
    if cycle.inspected is not None:
        items = items + (cycle.inspected @ weight)[:, None] * costs.event(INSPECTION)
    return np.asarray(items)
