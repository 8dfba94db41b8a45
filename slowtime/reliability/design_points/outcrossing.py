r"""Time-variant reliability by outcrossing (PHI2).

The rate at which a process leaves the safe set is the probability of being safe at t and
failed a little later, over that time,

.. math:: \nu^+(t) = \Phi_2(\beta(t), -\beta(t + \Delta t); \rho) / \Delta t, \quad
          \rho = -\alpha(t)^T C \, \alpha(t + \Delta t)

with C the correlation of each input between the two instants: 1 for what is fixed in time.
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import DesignPoint

from .search import Search, find_design_points
from .system import joint

INCREMENT = 1e-3
"""Time step of the rate, over the correlation time given."""


@dataclasses.dataclass(frozen=True, slots=True)
class Outcrossing:
    r"""Failure over time.

    Parameters
    ----------
    times
        As given.
    rate
        Outcrossing rate [1 / unit of time].
    beta
        Point-in-time index.
    upper
        Upper bound of the probability of failure until each time,
        :math:`P_f(0) + \int \nu^+ dt`.
    poisson
        The same if crossings are independent of each other,
        :math:`1 - (1 - P_f(0)) \exp(-\int \nu^+ dt)`; too large where they come in clumps.
    calls
        Calls of the limit states.
    """

    times: Float[np.ndarray, " time"]
    rate: Float[np.ndarray, " time"]
    beta: Float[np.ndarray, " time"]
    upper: Float[np.ndarray, " time"]
    poisson: Float[np.ndarray, " time"]
    calls: int


def outcrossing(
    problem_at: Callable[[float], Problem],
    times: Float[np.ndarray, " time"],
    correlation: Mapping[str, Callable[[float], float]],
    *,
    correlation_time: float,
    seed: int = 0,
) -> Outcrossing:
    r"""Outcrossing rate, and the probability of failure until each time.

    Parameters
    ----------
    problem_at
        From a time to the problem at that time, with the same inputs at all times.
    times
        Rising; the integral is by the trapezoidal rule.
    correlation
        Input that is a process → its autocorrelation at a lag, in normal space; inputs left
        out are fixed in time.
    correlation_time
        Time in which the fastest process changes [unit of times]; the step of the rate is a
        thousandth of it.
    seed
        Seed of the search for design points.

    Returns
    -------
    Rate [1 / unit of times], index and probability of failure [1], for each time.

    References
    ----------
    .. [1] C. Andrieu-Renaud, B. Sudret and M. Lemaire, "The PHI2 method: a way to compute
       time-variant reliability", Reliab. Eng. Syst. Saf. 84 (2004) 75-86.
    """
    if len(times) < 2 or np.any(np.diff(times) <= 0.0):
        raise ValueError(
            "Times do not rise. Give at least two, each later than the one before."
        )
    unknown = set(correlation) - set(problem_at(float(times[0])).names)
    if unknown or not correlation or correlation_time <= 0.0:
        raise ValueError(
            f"Autocorrelations were given of {sorted(correlation)} with {correlation_time=:g}. "
            "Give one for at least one input, by name, and a positive time."
        )
    step = INCREMENT * correlation_time
    rng = np.random.default_rng(seed)
    rate, beta = np.empty(len(times)), np.empty(len(times))
    calls = 0
    for k, time in enumerate(times):
        problem = problem_at(float(time))
        now, spent = _nearest(problem, rng)
        later, more = _nearest(problem_at(float(time) + step), rng)
        calls += spent + more
        kept = np.array(
            [correlation[n](step) if n in correlation else 1.0 for n in problem.names]
        )
        alike = float(np.clip(now.alpha @ (kept * later.alpha), -1.0, 1.0))
        # Safe now and failed later: failed later, less failed at both instants.
        crossed = joint(-now.beta, later.beta, -alike)
        rate[k], beta[k] = crossed / step, now.beta
    steps = np.diff(times) * 0.5 * (rate[1:] + rate[:-1])
    crossings = np.concatenate([[0.0], np.cumsum(steps)])
    first = float(ndtr(-beta[0]))
    return Outcrossing(
        np.asarray(times),
        rate,
        beta,
        np.minimum(first + crossings, 1.0),
        1.0 - (1.0 - first) * np.exp(-crossings),
        calls,
    )


def _nearest(problem: Problem, rng: np.random.Generator) -> tuple[DesignPoint, int]:
    g = Evaluator(problem)
    found = find_design_points(g, rng, Search(rounds=0))
    if not found.points:
        raise ValueError(f"{found.warnings[0]} The outcrossing rate needs one at each time.")
    return found.points[0], g.calls
