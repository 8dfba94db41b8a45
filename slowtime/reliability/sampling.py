"""Monte Carlo, importance and directional simulation."""

import numpy as np
from jaxtyping import Float
from scipy import stats

from .design_point import DesignPoint, design_points
from .probability import LEVEL, LimitState, Probability, lognormal

HEAVY = 0.1
"""Share of one weight in all at which an importance sample is not to be trusted."""

BISECTIONS = 12


def monte_carlo(
    limit_state: LimitState,
    inputs: int,
    rng: np.random.Generator,
    *,
    calls: int = 100_000,
    batch: int = 20_000,
) -> Probability:
    r"""Share of failures among random points (eq. 4.10), its interval exact (Clopper–Pearson).

    For a coefficient of variation :math:`\delta` it takes :math:`(1 - P) / (P \delta^2)`
    points: a hundred million for one in a million to 10 %.

    Examples
    --------
    >>> found = monte_carlo(lambda u: 2.0 - u[:, 0], 1, np.random.default_rng(0))
    >>> found.lo < 0.02275 < found.hi
    True
    """
    failed, left = 0, calls
    while left > 0:
        count = min(batch, left)
        failed += int(np.sum(limit_state(rng.standard_normal((count, inputs))) < 0.0))
        left -= count
    value = failed / calls
    tail = 0.5 * (1.0 - LEVEL)
    lo = float(stats.beta.ppf(tail, failed, calls - failed + 1)) if failed else 0.0
    # With none failed one end is known, and it takes the whole of the doubt.
    above = tail if failed else 2.0 * tail
    hi = float(stats.beta.isf(above, failed + 1, calls - failed)) if failed < calls else 1.0
    variation = float(np.sqrt((1.0 - value) / (calls * value))) if failed else np.inf
    said = () if failed >= 10 else (f"{failed} of {calls} points failed: too few to count on.",)
    return Probability(value, variation, lo, hi, calls, said)


def importance(
    limit_state: LimitState,
    inputs: int,
    rng: np.random.Generator,
    *,
    calls: int = 5000,
    points: list[DesignPoint] | None = None,
) -> Probability:
    r"""Random points about the design points, weighted back (eq. 4.11).

    .. math:: P = \frac1N \sum \frac{\phi(u)}{h(u)} [g(u) < 0], \quad
              h = \sum_k \pi_k \, \phi(u - u_k^*)

    Parameters
    ----------
    points
        Where to draw; found by `design_points` if None. Shares go with first-order
        probabilities, none below a tenth of an even share.
    """
    about = design_points(limit_state, inputs, rng) if points is None else points
    centres = np.array([one.point for one in about])
    share = np.array([one.first_order for one in about])
    share = np.maximum(share / share.sum(), 0.1 / len(about))
    share /= share.sum()
    which = rng.choice(len(about), size=calls, p=share)
    drawn = centres[which] + rng.standard_normal((calls, inputs))
    away = drawn @ centres.T - 0.5 * np.sum(centres**2, axis=1)
    weight = np.exp(-np.logaddexp.reduce(np.log(share) + away, axis=1))
    counted = np.where(limit_state(drawn) < 0.0, weight, 0.0)
    value = float(counted.mean())
    total = calls + about[0].calls
    if value == 0.0:
        return lognormal(0.0, np.inf, total, ("No point failed: the design points are wrong.",))
    heaviest = float(counted.max() / counted.sum())
    said: tuple[str, ...] = ()
    if heaviest > HEAVY:
        said = (
            f"One point of {calls} carries {100 * heaviest:.0f} % of the probability: failures "
            "lie where few points were drawn. Give more starts or use subset simulation.",
        )
    variation = float(counted.std(ddof=1) / np.sqrt(calls) / value)
    return lognormal(value, variation, total, said)


def directional(
    limit_state: LimitState,
    inputs: int,
    rng: np.random.Generator,
    *,
    directions: int = 500,
    reach: float = 8.0,
    rings: int = 32,
) -> Probability:
    r"""Random directions; along each, the probability of every radius that fails, exactly.

    .. math:: P = E_a \Big[ \sum_{\text{failed } (r_1, r_2)} Q_n(r_1) - Q_n(r_2) \Big], \quad
              Q_n(r) = P(\chi_n^2 > r^2)

    One direction does for a sphere; for a plane in many inputs it is poor, and its coefficient
    of variation says so.

    Parameters
    ----------
    reach
        Largest radius beyond that of probability one half; what fails only farther out is
        not seen.
    rings
        Radii at which each direction is looked at; two crossings between neighbours are missed.
    """
    normal = rng.standard_normal((directions, inputs))
    ways = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    # Beyond the reach less is left than a plane at that distance would leave.
    radii = np.linspace(0.0, np.sqrt(stats.chi2.median(inputs)) + reach, rings)
    values = limit_state((ways[:, None, :] * radii[:, None]).reshape(-1, inputs))
    fails = values.reshape(directions, rings) < 0.0
    which, ring = np.nonzero(fails[:, 1:] != fails[:, :-1])
    lo, hi = radii[ring].copy(), radii[ring + 1].copy()
    at_lo = fails[which, ring]
    for _ in range(BISECTIONS):
        middle = 0.5 * (lo + hi)
        same = (limit_state(ways[which] * middle[:, None]) < 0.0) == at_lo
        lo, hi = np.where(same, middle, lo), np.where(same, hi, middle)
    beyond = stats.chi2.sf((0.5 * (lo + hi)) ** 2, inputs)
    # Into failure adds what lies beyond, out of it takes that away again.
    each = np.where(fails[:, 0], 1.0, 0.0)
    np.add.at(each, which, np.where(at_lo, -beyond, beyond))
    calls = directions * rings + BISECTIONS * len(which)
    return _averaged(each, calls)


def _averaged(each: Float[np.ndarray, " direction"], calls: int) -> Probability:
    value = float(each.mean())
    if value == 0.0:
        said = ("No direction meets failure. Give more directions or a longer reach.",)
        return lognormal(0.0, np.inf, calls, said)
    variation = float(each.std(ddof=1) / np.sqrt(len(each)) / value)
    return lognormal(value, variation, calls)
