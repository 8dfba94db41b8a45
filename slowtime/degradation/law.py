"""The protocol of a degradation law, and what every law gives once it has learnt."""

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from .fleet import FleetPrior
from .history import History, Series


@dataclasses.dataclass(frozen=True, slots=True)
class Drawn:
    """Sampled paths of one law.

    Parameters
    ----------
    paths
        The quantity at each future time, in the unit of the readings.
    roughness
        Of each path, the variance that its diffusion gains over one unit of slow time; 0 for
        a path that is smooth or jumps. First passages of a rough path need a bridge between
        grid points.
    """

    paths: Float[np.ndarray, "path later"]
    roughness: Float[np.ndarray, " path"]


@runtime_checkable
class Posterior(Protocol):
    """What a law believes after the readings so far."""

    @property
    def log_evidence(self) -> float:
        """Logarithm of the probability density of all readings so far under the law."""
        ...

    @property
    def p_value(self) -> float:
        """Posterior predictive probability of a misfit as large as the one seen [1]."""
        ...

    def follow(self, time: Series, value: Series, sd: Series) -> "Posterior":
        """Update the belief by further readings, at a constant cost each.

        Parameters
        ----------
        time, value, sd
            Slow time, value, and standard deviation of each reading; NaN readings are left out.

        Returns
        -------
        Belief after the readings.
        """
        ...

    def draw(
        self, later: Float[np.ndarray, " later"], count: int, rng: np.random.Generator
    ) -> Drawn:
        """Sample paths at future slow times, the first of which is the last reading's.

        Parameters
        ----------
        later
            Slow times, ascending; the first is that of the last reading.
        count
            Number of paths.
        rng
            Generator of the draws.

        Returns
        -------
        Paths in the unit of the readings, and the roughness of each.
        """
        ...

    def hyperparameters(self) -> FleetPrior | None:
        """Give mean and covariance of the law's parameters, for assets of the same kind."""
        ...


@runtime_checkable
class DegradationLaw(Protocol):
    """A degradation law: how a quantity may change over slow time."""

    @property
    def name(self) -> str:
        """The name by which weights are told."""
        ...

    def learn(self, history: History, fleet: FleetPrior | None = None) -> Posterior:
        """Learn the parameters from readings.

        Parameters
        ----------
        history
            The readings, with their scales and events.
        fleet
            What sister assets say of the parameters; None for the weakly informative prior.

        Returns
        -------
        Belief after the readings.
        """
        ...
