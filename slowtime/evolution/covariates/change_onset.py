r"""Posterior of the onset and size of a change of level.

The bet on an onset k holds the likelihood ratio of all residuals since, for a lasting step of
unknown size :math:`\delta \sim N(0, \tau^2)`, one-sided if asked for. With b and I the score
and the information of :math:`\delta`,

.. math:: \Lambda_k = \frac{2 \, \Phi(\pm m / s)}{\sqrt{1 + \tau^2 I}} \,
          e^{m^2 / 2 s^2}, \qquad s^2 = \frac{\tau^2}{1 + \tau^2 I}, \quad m = s^2 b

and a capital of :math:`w_k \Lambda_k` with :math:`w_k` the time between readings (the procedure
of Shiryaev and Roberts). As long as nothing changes, each :math:`\Lambda_k` is a fair game, so
the mean of all capital R is the time gone by; and an alarm at :math:`R \ge A` has a mean time
to the first false one of at least A, whatever the correlation of residuals was. Merging two
bets hands over the capital as it is, which no fair game minds.

References
----------
.. [1] M. Pollak, "Average run lengths of an optimal method of detecting a change in
   distribution", Annals of Statistics 15 (1987).
"""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr

Entered = Literal["loss", "gain", "either"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Onsets:
    """Bets on instants at which a level may have changed, oldest first.

    Parameters
    ----------
    time
        The instants.
    log_capital
        Logarithm of each capital, in units of time.
    score, information
        Of the size of the step.
    response
        How far the filter has followed a step of size one, by its whole state.
    """

    time: Float[np.ndarray, " onset"]
    log_capital: Float[np.ndarray, " onset"]
    score: Float[np.ndarray, " onset"]
    information: Float[np.ndarray, " onset"]
    response: Float[np.ndarray, "onset state"]

    @property
    def log_total(self) -> float:
        """Logarithm of all capital together, in units of time."""
        return float(np.logaddexp.reduce(self.log_capital, initial=-np.inf))


def no_onsets(states: int) -> Onsets:
    """Empty set of candidate onsets.

    Parameters
    ----------
    states
        Number of states of the filter.

    Returns
    -------
    Candidates.
    """
    empty = np.zeros(0)
    return Onsets(empty, empty, empty, empty, np.zeros((0, states)))


def update_onsets(
    onsets: Onsets,
    time: float,
    elapsed: float,
    *,
    seen: Float[np.ndarray, " state"],
    gain: Float[np.ndarray, " state"],
    residual: float,
    variance: float,
    size: float,
    entered: Entered,
) -> Onsets:
    """Add a candidate onset at `time`, and update the capital of all by one residual.

    Parameters
    ----------
    onsets
        Candidate onsets before the reading.
    time
        Slow time of the reading.
    elapsed
        Slow time since the reading before.
    seen
        Row that maps the state of the filter to the reading.
    gain
        Gain of the filter.
    residual
        Reading minus its prediction [unit of the readings].
    variance
        Variance of the residual [its square].
    size
        Prior standard deviation of the step [unit of the readings].
    entered
        Sign of the step, if only one is asked for.

    Returns
    -------
    Candidate onsets after the reading.
    """
    count = len(onsets.time)
    score, information = np.append(onsets.score, 0.0), np.append(onsets.information, 0.0)
    response = np.concatenate([onsets.response, np.zeros((1, onsets.response.shape[1]))])
    before = _log_ratio(score, information, size, entered)
    left = 1.0 - response @ seen
    score = score + left * residual / variance
    information = information + left**2 / variance
    paid = _log_ratio(score, information, size, entered) - before
    started = np.log(elapsed) if elapsed > 0.0 else -np.inf
    capital = np.append(onsets.log_capital, started) + paid
    return Onsets(
        np.append(onsets.time[:count], time),
        capital,
        score,
        information,
        response + left[:, None] * gain,
    )


def merge_onsets(onsets: Onsets, most: int) -> Onsets:
    """Merge the candidates closest to each other for their age, down to `most`.

    Parameters
    ----------
    onsets
        Candidate onsets with their evidence.
    most
        Largest number of candidates.

    Returns
    -------
    Remaining candidates.
    """
    while len(onsets.time) > most:
        age = onsets.time[-1] - onsets.time
        gap = np.diff(onsets.time) / (age[:-1] + np.median(np.diff(onsets.time)))
        gap[onsets.log_capital[:-1].argmax()] = np.inf
        gone = int(gap.argmin())
        capital = onsets.log_capital.copy()
        capital[gone + 1] = np.logaddexp(capital[gone], capital[gone + 1])
        keep = np.arange(len(capital)) != gone
        onsets = Onsets(
            onsets.time[keep],
            capital[keep],
            onsets.score[keep],
            onsets.information[keep],
            onsets.response[keep],
        )
    return onsets


def onset_posterior(
    onsets: Onsets, size: float
) -> tuple[
    Float[np.ndarray, " onset"], Float[np.ndarray, " onset"], Float[np.ndarray, " onset"]
]:
    """Posterior of the onset, and mean and standard deviation of the step at each.

    Parameters
    ----------
    onsets
        Candidate onsets with their evidence.
    size
        Prior standard deviation of the change, relative [1].

    Returns
    -------
    Probability, mean and standard deviation of each candidate.
    """
    weight = np.exp(onsets.log_capital - onsets.log_total)
    variance = size**2 / (1.0 + size**2 * onsets.information)
    return weight, variance * onsets.score, np.sqrt(variance)


def _log_ratio(
    score: np.ndarray, information: np.ndarray, size: float, entered: Entered
) -> np.ndarray:
    widened = 1.0 + size**2 * information
    sd = size / np.sqrt(widened)
    both = 0.5 * (sd * score) ** 2 - 0.5 * np.log(widened)
    if entered == "either":
        return np.asarray(both)
    side = -1.0 if entered == "loss" else 1.0
    return np.asarray(both + np.log(2.0) + log_ndtr(side * sd * score))
