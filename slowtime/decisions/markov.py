r"""Markov decision processes, seen and partly seen, of few states.

Value iteration solves :math:`V(s) = \min_a [c(s, a) + \gamma \sum_{s'} P_a(s, s') V(s')]`. A
partly seen process is solved over beliefs by point-based iteration: its value is the least of
planes (one each per belief), which are upper bounds at every sweep.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float, Int

TOLERANCE = 1e-10
"""Change of the value [relative to the largest cost / (1 - discount)] at which sweeps end."""

MOST_SWEEPS = 100_000


@dataclasses.dataclass(frozen=True, slots=True)
class MarkovDecisionProcess:
    """A Markov decision process, partly seen where `observation` is given.

    Parameters
    ----------
    cost
        Of an action in a state, per step [currency].
    transition
        Probability of the next state.
    discount
        γ, factor of one step, in [0, 1).
    observation
        Probability of what is seen after an action, given the next state; None where the state
        is seen.

    Raises
    ------
    ValueError
        Where probabilities are negative or do not sum to 1, or γ is outside [0, 1).
    """

    cost: Float[np.ndarray, "state action"]
    transition: Float[np.ndarray, "action state next"]
    discount: float
    observation: Float[np.ndarray, "action next seen"] | None = None

    def __post_init__(self) -> None:
        for name, given in (("transition", self.transition), ("observation", self.observation)):
            if given is None:
                continue
            sums = given.sum(axis=-1)
            wrong = (given < 0).any(axis=-1) | ~np.isclose(sums, 1.0, atol=1e-9)
            if wrong.any():
                row = tuple(np.argwhere(wrong)[0].tolist())
                raise ValueError(
                    f"Row {list(row)} of {name}, {given[row].tolist()}, has a negative entry "
                    f"or sums to {sums[row]:g}, not 1. Give probabilities that sum to 1 over "
                    "the last index; check that the array is not transposed."
                )
        if not 0.0 <= self.discount < 1.0:
            raise ValueError(f"A discount of {self.discount:g} is outside [0, 1).")


@dataclasses.dataclass(frozen=True, slots=True)
class Solution:
    """Value and best action of each state [currency]."""

    value: Float[np.ndarray, " state"]
    action: Int[np.ndarray, " state"]


def value_iteration(process: MarkovDecisionProcess) -> Solution:
    """Solve a process whose state is seen."""
    value = np.zeros(len(process.cost))
    scale = max(float(np.abs(process.cost).max()) / (1.0 - process.discount), 1e-300)
    for _ in range(MOST_SWEEPS):
        of_each = process.cost + process.discount * (process.transition @ value).T
        new = of_each.min(axis=1)
        done = np.abs(new - value).max() <= TOLERANCE * scale * (1.0 - process.discount)
        value = new
        if done:
            break
    return Solution(value, of_each.argmin(axis=1))


@dataclasses.dataclass(frozen=True, slots=True)
class BeliefSolution:
    """Planes over beliefs; the least of them at a belief is an upper bound of its value.

    Parameters
    ----------
    planes
        Cost from each state on.
    actions
        What each plane does first.
    """

    planes: Float[np.ndarray, "plane state"]
    actions: Int[np.ndarray, " plane"]

    def value(self, belief: Float[np.ndarray, " state"]) -> float:
        """Upper bound of the expected discounted cost from a belief on.

        Parameters
        ----------
        belief
            Probability of each state [1].

        Returns
        -------
        Cost [currency].
        """
        return float((self.planes @ belief).min())

    def action(self, belief: Float[np.ndarray, " state"]) -> int:
        """Best action at a belief.

        Parameters
        ----------
        belief
            Probability of each state [1].

        Returns
        -------
        Index of the action.
        """
        return int(self.actions[(self.planes @ belief).argmin()])


def beliefs_on_grid(states: int, steps: int) -> Float[np.ndarray, "belief state"]:
    """All beliefs whose probabilities are multiples of 1 / steps.

    Examples
    --------
    >>> beliefs_on_grid(2, 2)
    array([[0. , 1. ],
           [0.5, 0.5],
           [1. , 0. ]])
    """
    bars = itertools.combinations(range(steps + states - 1), states - 1)
    edges = [(-1, *each, steps + states - 1) for each in bars]
    return (np.diff(np.array(edges), axis=1) - 1) / steps


def solve_beliefs(
    process: MarkovDecisionProcess, *, steps: int = 20, sweeps: int = 2000
) -> BeliefSolution:
    """Solve a partially observed process by point-based value iteration on a grid of beliefs.

    Parameters
    ----------
    process
        Partly observed process.
    steps
        Of the grid; beliefs grow as steps^(states - 1).
    sweeps
        At most.

    Returns
    -------
    Planes over beliefs, an upper bound of the cost.

    References
    ----------
    .. [1] J. Pineau, G. Gordon and S. Thrun, "Point-based value iteration", IJCAI (2003).
    """
    if process.observation is None:
        raise ValueError("The process has no observation. Give one, or use value_iteration.")
    states, actions = process.cost.shape
    beliefs = beliefs_on_grid(states, steps)
    worst = float(process.cost.max()) / (1.0 - process.discount)
    planes, chosen = np.full((1, states), worst), np.zeros(1, dtype=int)
    # From a next state, what is seen and its plane back to the state before: [a, s, s', o].
    seen = process.transition[..., None] * process.observation[:, None, :, :]
    value = np.full(len(beliefs), worst)
    scale = max(abs(worst), 1e-300)
    for _ in range(sweeps):
        back = np.einsum("asno,pn->aops", seen, planes)
        best = np.einsum("aops,bs->abop", back, beliefs).argmin(axis=-1)
        picked = back[np.arange(actions)[:, None, None], np.arange(back.shape[1]), best]
        each = process.cost.T[:, None, :] + process.discount * picked.sum(axis=2)
        of_each = np.einsum("abs,bs->ab", each, beliefs)
        act = of_each.argmin(axis=0)
        planes = each[act, np.arange(len(beliefs))]
        new = of_each.min(axis=0)
        planes, first = np.unique(planes, axis=0, return_index=True)
        chosen = act[first]
        done = np.abs(new - value).max() <= TOLERANCE * scale
        value = new
        if done:
            break
    return BeliefSolution(planes, chosen)
