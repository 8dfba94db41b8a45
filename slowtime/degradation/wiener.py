r"""Wiener process with drift: :math:`dx = \mu\,dt + \sigma\,dW`, read with noise.

Given :math:`\sigma`, level and drift are Gaussian: a Kalman filter for each of a net of
:math:`\sigma` is exact.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, logsumexp

from .fleet import FleetPrior
from .history import LEVEL_WIDTH, History, Series
from .law import Drawn

NODES = 33
"""Values of sigma over the prior [1]: a fifth of a natural logarithm apart."""

WIDTH = 1.2
"""Prior sd of the logarithm of sigma [1]; it is centred on a quarter of the scatter."""


@dataclasses.dataclass(frozen=True, slots=True)
class WienerLaw:
    """Wiener process with drift as a law that learns: see `law.Law`."""

    name: str = "Wiener"

    def learn(self, history: History, fleet: FleetPrior | None = None) -> "WienerPosterior":
        """Filter level and drift for each sigma of a net; see `law.Law.learn`."""
        return self.begin(history, fleet).follow(history.time, history.value, history.sd)

    def begin(self, history: History, fleet: FleetPrior | None = None) -> "WienerPosterior":
        """Give what is believed before the first reading."""
        normal = np.linspace(-2.8, 2.8, NODES)
        sigma = 0.25 * history.scatter * np.exp(WIDTH * normal) / np.sqrt(history.span)
        prior = -0.5 * normal**2
        prior = prior - logsumexp(prior)
        wide = LEVEL_WIDTH * history.scatter
        mean, covariance = np.zeros((NODES, 2)), np.zeros((NODES, 2, 2))
        mean[:, 0] = history.centre
        covariance[:, 0, 0], covariance[:, 1, 1] = wide**2, (wide / history.span) ** 2
        if fleet is not None:
            mean[:, 1], covariance[:, 1, 1] = fleet.mean[0], fleet.covariance[0, 0]
        zero = np.zeros(NODES)
        return WienerPosterior(
            history, sigma, prior, float(history.time[0]), mean, covariance, zero, zero, 0
        )


@dataclasses.dataclass(frozen=True, slots=True)
class WienerPosterior:
    """What is believed of a Wiener process: see `law.Posterior`.

    Parameters
    ----------
    history
        The readings that fixed the scales.
    sigma, log_prior
        Values of sigma [reading / root of time], and their log prior probabilities.
    time
        Slow time of the last reading.
    mean, covariance
        Of level and drift, for each sigma.
    log_likelihood, misfit, count
        As for `curve_posterior.CurvePosterior`.
    """

    history: History
    sigma: Float[np.ndarray, " node"]
    log_prior: Float[np.ndarray, " node"]
    time: float
    mean: Float[np.ndarray, "node 2"]
    covariance: Float[np.ndarray, "node 2 2"]
    log_likelihood: Float[np.ndarray, " node"]
    misfit: Float[np.ndarray, " node"]
    count: int

    @property
    def log_evidence(self) -> float:
        """See `law.Posterior`."""
        return float(logsumexp(self.log_prior + self.log_likelihood))

    @property
    def weights(self) -> Float[np.ndarray, " node"]:
        """Posterior probability of each sigma."""
        log = self.log_prior + self.log_likelihood
        weight = np.exp(log - log.max())
        return np.asarray(weight / weight.sum())

    @property
    def p_value(self) -> float:
        """See `law.Posterior`."""
        return float(self.weights @ chdtrc(max(self.count - 2, 1), self.misfit))

    def follow(self, time: Series, value: Series, sd: Series) -> "WienerPosterior":
        """Update the belief by further readings, at a constant cost each.

        Parameters
        ----------
        time, value, sd
            Slow time, value, and standard deviation of each reading; NaN readings are left out.

        Returns
        -------
        Belief after the readings.
        """
        mean, covariance = self.mean.copy(), self.covariance.copy()
        total, misfit, now = self.log_likelihood.copy(), self.misfit.copy(), self.time
        count, floor = self.count, 1e-6 * self.history.scatter
        for at, seen, spread_sd in zip(time.tolist(), value.tolist(), sd.tolist(), strict=True):
            if not (np.isfinite(seen) and np.isfinite(spread_sd)):
                continue
            for event in self.history.events:
                if now < event.time <= at:
                    mean, covariance = self._advanced(mean, covariance, event.time - now)
                    mean, covariance = self._restored(mean, covariance, event.restored)
                    covariance[:, 0, 0] += event.sd**2
                    now = event.time
            mean, covariance = self._advanced(mean, covariance, at - now)
            now = at
            spread = covariance[:, 0, 0] + max(spread_sd, floor) ** 2
            residual = seen - mean[:, 0]
            square = residual**2 / spread
            total -= 0.5 * (square + np.log(2.0 * np.pi * spread))
            if count >= 2:
                misfit += square
            count += 1
            reach = covariance[:, :, 0].copy()
            gain = reach / spread[:, None]
            mean += gain * residual[:, None]
            covariance -= gain[:, :, None] * reach[:, None, :]
        return dataclasses.replace(
            self, mean=mean, covariance=covariance, log_likelihood=total, misfit=misfit,
            time=now, count=count,
        )  # fmt: skip

    def _advanced(
        self, mean: np.ndarray, covariance: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        moved, spread = mean.copy(), covariance.copy()
        moved[:, 0] += step * mean[:, 1]
        cross = covariance[:, 0, 1] + step * covariance[:, 1, 1]
        spread[:, 0, 0] += step * (covariance[:, 0, 1] + cross) + self.sigma**2 * step
        spread[:, 0, 1] = spread[:, 1, 0] = cross
        return moved, spread

    def _restored(
        self, mean: np.ndarray, covariance: np.ndarray, share: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take away a share of the damage: of the distance from the first level seen."""
        left, base = 1.0 - share, float(self.history.value[0])
        moved, spread = mean.copy(), covariance.copy()
        moved[:, 0] = base + left * (mean[:, 0] - base)
        spread[:, 0, :] *= left
        spread[:, :, 0] *= left
        return moved, spread

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
        owners = rng.choice(len(self.sigma), size=count, p=self.weights)
        shocks = rng.standard_normal((count, 2))
        factor = np.linalg.cholesky(self.covariance[owners] + 1e-300 * np.eye(2))
        start = self.mean[owners] + np.einsum("pij,pj->pi", factor, shocks)
        ahead = later - later[0]
        steps = rng.standard_normal((count, len(later))) * np.sqrt(np.diff(ahead, prepend=0.0))
        wander = self.sigma[owners, None] * np.cumsum(steps, axis=1)
        paths = start[:, :1] + start[:, 1:] * ahead + wander
        return Drawn(paths, self.sigma[owners] ** 2)

    def hyperparameters(self) -> FleetPrior | None:
        """Give the drift over slow time."""
        mean, variance = self.mean[:, 1], self.covariance[:, 1, 1]
        centre = self.weights @ mean
        spread = self.weights @ (variance + (mean - centre) ** 2)
        return FleetPrior("Wiener", np.array([centre]), np.array([[spread]]))
