"""Weighted processes and jump laws that a history supports."""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.estimation.matern import SlowProcess
from slowtime.estimation.processes import Process, Sum
from slowtime.estimation.state_space import Jump
from slowtime.evolution.change import Series

Usable: TypeAlias = Float[np.ndarray, " usable"]


@dataclasses.dataclass(frozen=True, slots=True)
class JumpLaw:
    """Jumps at random: a compound Poisson process with sizes of a Gaussian law.

    Parameters
    ----------
    rate
        Jumps over one unit of slow time.
    mean, sd
        Of their sizes, in the unit of the readings.
    count
        Of how many jumps this is known.
    """

    rate: float
    mean: float
    sd: float
    count: int

    def moments(self, ahead: Series) -> tuple[Series, Series, Series, Series]:
        """Compute the moments of the jumps within a time from now.

        Parameters
        ----------
        ahead
            Times from now, in the unit of slow time.

        Returns
        -------
        Mean and variance of their sum, in which the mean size is uncertain; then the
        probability that there is none, and the mean number where there is any.
        """
        number = self.rate * np.maximum(ahead, 0.0)
        square = self.mean**2 + self.sd**2
        variance = number * square + (number * self.sd) ** 2 / self.count
        none = np.exp(-number)
        return number * self.mean, variance, none, number / np.maximum(1.0 - none, 1e-300)


@dataclasses.dataclass(frozen=True, slots=True)
class Outlook:
    """Processes that the history allows, and the weight of each.

    Parameters
    ----------
    family
        A `SlowProcess` whose parameters are arrays, one entry per member.
    weights
        Posterior probability of each member among them; they sum to one.
    wave, wave_weights
        Likewise a family of processes that repeat themselves; None where none is likely.
    wave_share
        Posterior probability of the processes with a wave, all together [1].
    jumps
        Slow times after which the level of the history has gone elsewhere, and how far it may
        have gone.
    further
        How further jumps come, as far as those so far tell; None where there were too few.
    log_evidence
        Logarithm of the probability density of the readings under all of these processes,
        less the penalty for the jumps that were selected.
    """

    family: SlowProcess
    weights: Float[np.ndarray, " family"]
    wave: Sum | None = None
    wave_weights: Float[np.ndarray, " wave"] | None = None
    wave_share: float = 0.0
    jumps: tuple[Jump, ...] = ()
    further: "JumpLaw | None" = None
    log_evidence: float = -np.inf

    @property
    def likeliest(self) -> SlowProcess:
        """The most probable process without a wave, to watch by (`ChangeDetector`)."""
        found = member(self.family, int(self.weights.argmax()))
        assert isinstance(found, SlowProcess)
        return found

    @property
    def period(self) -> float | None:
        """Likeliest period, in the unit of slow time; None where nothing repeats itself."""
        if self.wave is None or self.wave_weights is None or self.wave_share < 0.5:
            return None
        place = list(self.wave.free).index("period")
        return float(np.exp(self.wave_weights @ self.wave.logs[:, place]))


def history(slow_time: Series, value: Series, sd: Series) -> tuple[Usable, Usable, Usable]:
    """Usable readings of a history, in ascending order of slow time.

    Parameters
    ----------
    slow_time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.

    Returns
    -------
    Times, readings, standard deviations.
    """
    usable = np.isfinite(slow_time) & np.isfinite(value) & np.isfinite(sd) & (sd >= 0.0)
    order = np.argsort(slow_time[usable], kind="stable")
    return slow_time[usable][order], value[usable][order], sd[usable][order]


def member(process: SlowProcess | Sum, number: int) -> SlowProcess | Process:
    """One process of a family.

    Parameters
    ----------
    process
        Family of processes.
    number
        Index of the member.
    """
    if isinstance(process, Sum):
        return process.member(number)
    own = {
        name: float(np.broadcast_to(getattr(process, name), np.shape(process.length))[number])
        for name in ("length", "sd", "slope_drift")
    }
    return dataclasses.replace(process, **own)
