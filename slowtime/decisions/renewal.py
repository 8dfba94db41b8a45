r"""Age replacement: the long-run cost per time of repairing at an age, or never before failure.

.. math:: C(\tau) = \frac{c_p S(\tau) + c_f F(\tau)}{\int_0^\tau S(u)\,du}
"""

import dataclasses

import numpy as np
from jaxtyping import Float

FLAT = 1e-9
"""Relative saving [1] over running to failure below which an age is no better: rounding."""


@dataclasses.dataclass(frozen=True, slots=True)
class AgePolicy:
    """When to replace by age.

    Parameters
    ----------
    age
        Best age of a planned repair; infinite where none is better than running to failure.
    cost_rate
        Long-run cost at that age [currency/time].
    never_rate
        Long-run cost of running to failure, c_f / E[T] [currency/time].
    ages, cost_rates
        C of every age on the grid.
    """

    age: float
    cost_rate: float
    never_rate: float
    ages: Float[np.ndarray, " age"]
    cost_rates: Float[np.ndarray, " age"]

    def words(self) -> str:
        """Say it in a sentence.

        Examples
        --------
        >>> AgePolicy(np.inf, 2.0, 2.0, np.ones(1), np.ones(1)).words()
        'Never repair by age: running to failure costs 2 per time, and no age costs less.'
        """
        if np.isfinite(self.age):
            return (
                f"Repair at age {self.age:.4g}: it costs {self.cost_rate:.4g} per time, "
                f"running to failure {self.never_rate:.4g}."
            )
        return (
            f"Never repair by age: running to failure costs {self.never_rate:.4g} per time, "
            "and no age costs less."
        )


def age_policy(
    age: Float[np.ndarray, " age"],
    survival: Float[np.ndarray, " age"],
    *,
    repair: float,
    failure: float,
    mean_life: float | None = None,
) -> AgePolicy:
    """Find the age of least cost per time by the renewal reward theorem, without discount.

    Parameters
    ----------
    age, survival
        Ages from 0 upward [time], and the probability S to survive each. They should reach to
        where S is small: beyond the last age nothing is looked for.
    repair, failure
        c_p and c_f [currency].
    mean_life
        E[T]; by default the integral of S with an exponential tail behind the last age.

    Returns
    -------
    The best age, its cost per time, and the cost per time at every age.

    Raises
    ------
    ValueError
        Where ages do not ascend from 0, S is no survival function, or a cost is not above 0.

    References
    ----------
    .. [1] R. E. Barlow and F. Proschan, "Mathematical Theory of Reliability", Wiley (1965),
       section 4.2: for an increasing failure rate there is one minimum at most.
    """
    if age[0] != 0.0 or np.any(np.diff(age) <= 0):
        raise ValueError("Ages do not ascend from 0. Give an ascending grid that begins at 0.")
    if np.any(np.diff(survival) > 1e-12) or survival[0] > 1 + 1e-12 or survival[-1] < -1e-12:
        raise ValueError("A survival function falls from at most 1 to at least 0. Give one.")
    if not (repair > 0 and failure > 0):
        raise ValueError(f"Costs {repair=:g} and {failure=:g} must be above 0.")
    lived = np.concatenate(
        [[0.0], np.cumsum(np.diff(age) * (survival[1:] + survival[:-1]) / 2)]
    )
    life = _mean_life(age, survival, lived) if mean_life is None else mean_life
    never = failure / life if np.isfinite(life) else 0.0
    rates = np.full(len(age), np.inf)
    rates[1:] = (repair * survival[1:] + failure * (1.0 - survival[1:])) / lived[1:]
    best = int(np.argmin(rates))
    if rates[best] < never * (1.0 - FLAT) and survival[best] > FLAT:
        return AgePolicy(float(age[best]), float(rates[best]), never, age, rates)
    return AgePolicy(np.inf, never, never, age, rates)


def _mean_life(
    age: Float[np.ndarray, " age"],
    survival: Float[np.ndarray, " age"],
    lived: Float[np.ndarray, " age"],
) -> float:
    """Integral of S, with the last hazard kept behind the grid."""
    if survival[-1] <= FLAT:
        return float(lived[-1])
    half = len(age) // 2
    hazard = np.log(survival[half] / survival[-1]) / (age[-1] - age[half])
    return float(lived[-1] + survival[-1] / hazard) if hazard > 0 else np.inf
