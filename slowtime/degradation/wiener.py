r"""Walks about a drift, read with noise: a Wiener process, or one that reverts to its mean.

.. math:: dx = \mu\,dt + \sigma\,dW \quad\text{or}\quad x = b + \mu t + y, \;
          dy = -y\,dt / \tau + \sqrt{2 / \tau}\,s\,dW

Given :math:`\sigma`, or :math:`s` and :math:`\tau`, level, drift and y are Gaussian: a Kalman
filter for each of a net of these is exact.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, logsumexp

from slowtime.estimation.filtering import filtered
from slowtime.estimation.state_space import Advanced, Belief, lifted, step

from .fleet import FleetPrior
from .history import LEVEL_WIDTH, History, KnownChange, Series
from .law import Drawn

NODES = 33
"""Values of sigma over the prior [1]: a fifth of a natural logarithm apart."""

WIDTH = 1.2
"""Prior sd of the logarithm of sigma [1]; it is centred on `SIGMA` of the scatter."""

SIGMA = 0.8
"""Centre of the prior of sigma over the scatter of the readings and the root of the span [1]:
a walk without drift scatters by 0.41 of what it moves, one with drift by more."""

REVERTING_NODES = 7
"""Values of s, and of tau, over their priors [1]."""

REVERTING_WIDTH, MEMORY = 1.2, 0.1
"""Prior sd of the logarithms of s and tau, and the median of tau over the history [1]; s is
centred on half of the scatter about a parabola."""


@dataclasses.dataclass(frozen=True, slots=True)
class WienerLaw:
    """Walk about a drift as a law that learns: see `law.Law`.

    Parameters
    ----------
    name
        By which weights are told.
    reverts
        Whether it reverts to its mean, as an Ornstein-Uhlenbeck process.
    """

    name: str = "Wiener"
    reverts: bool = False

    def learn(self, history: History, fleet: FleetPrior | None = None) -> "WienerPosterior":
        """Filter level and drift for each sigma of a net; see `law.Law.learn`."""
        return self.begin(history, fleet).follow(history.time, history.value, history.sd)

    def begin(self, history: History, fleet: FleetPrior | None = None) -> "WienerPosterior":
        """Give what is believed before the first reading."""
        normal = np.linspace(-2.8, 2.8, REVERTING_NODES if self.reverts else NODES)
        prior = -0.5 * normal**2
        prior = prior - logsumexp(prior)
        if self.reverts:
            prior = np.add.outer(prior, prior).ravel()
            scale = np.exp(REVERTING_WIDTH * normal)
            around = np.repeat(0.5 * history.rough * scale, REVERTING_NODES)
            memory = np.tile(MEMORY * history.span * scale, REVERTING_NODES)
            sigma = np.zeros(len(prior))
        else:
            sigma = SIGMA * history.scatter * np.exp(WIDTH * normal) / np.sqrt(history.span)
            around, memory = np.zeros(NODES), np.full(NODES, np.inf)
        wide, number = LEVEL_WIDTH * history.scatter, len(prior)
        mean, covariance = np.zeros((number, 3)), np.zeros((number, 3, 3))
        mean[:, 0] = history.centre
        covariance[:, 0, 0], covariance[:, 1, 1] = wide**2, (wide / history.span) ** 2
        covariance[:, 2, 2] = around**2
        if fleet is not None:
            mean[:, 1], covariance[:, 1, 1] = fleet.mean[0], fleet.covariance[0, 0]
        zero = np.zeros(number)
        return WienerPosterior(
            history, self.name, sigma, around, memory, prior,
            Belief(float(history.time[0]), mean, covariance), zero, zero, 0,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True, slots=True)
class WienerPosterior:
    """What is believed of a walk: see `law.Posterior`.

    Parameters
    ----------
    sigma, around, memory
        Of each node: sigma [reading / root of time], and s and tau, which are zero and infinite
        where nothing reverts.
    belief
        Of level, drift, and distance from the level, for each node.
    log_likelihood, misfit, count
        As for `curve_posterior.CurvePosterior`.
    """

    history: History
    name: str
    sigma: Float[np.ndarray, " node"]
    around: Float[np.ndarray, " node"]
    memory: Float[np.ndarray, " node"]
    log_prior: Float[np.ndarray, " node"]
    belief: Belief
    log_likelihood: Float[np.ndarray, " node"]
    misfit: Float[np.ndarray, " node"]
    count: int

    @property
    def log_evidence(self) -> float:
        """See `law.Posterior`."""
        return float(logsumexp(self.log_prior + self.log_likelihood))

    @property
    def weights(self) -> Float[np.ndarray, " node"]:
        """Posterior probability of each node."""
        log = self.log_prior + self.log_likelihood
        weight = np.exp(log - log.max())
        return np.asarray(weight / weight.sum())

    @property
    def p_value(self) -> float:
        """See `law.Posterior`."""
        return float(self.weights @ chdtrc(max(self.count - 2, 1), self.misfit))

    def follow(self, time: Series, value: Series, sd: Series) -> "WienerPosterior":
        """Update the belief by further readings, at a constant cost each."""
        known = np.isfinite(value) & np.isfinite(sd)
        time, value = time[known], value[known]
        sd = np.maximum(sd[known], 1e-6 * self.history.scatter)
        belief, total, misfit = self.belief, self.log_likelihood, self.misfit
        count, first = self.count, 0
        for event in (*self.history.events, None):
            end = len(time)
            if event is not None:
                if not belief.time < event.time:
                    continue
                end = int(np.searchsorted(time, event.time))
            part = slice(first, end)
            passed = filtered(
                self, time[part], value[part], sd[part], belief=belief, innovations=True
            )
            belief, total = passed.belief, total + passed.log_likelihood
            # The first two readings only fix level and drift.
            judged = slice(max(2 - count, 0), None)
            squares = passed.residual[:, judged] ** 2 / passed.spread[:, judged]
            misfit = misfit + squares.sum(axis=1)
            count, first = count + end - first, end
            if event is None or end == len(time):
                break
            belief = self._restored(step(self, belief, event.time, np.nan, 0.0)[0], event)
        return dataclasses.replace(
            self, belief=belief, log_likelihood=total, misfit=misfit, count=count
        )

    def start(self, time: float) -> Belief:
        """See `StateSpace.start`."""
        return dataclasses.replace(self.belief, time=time)

    def observation_row(self, time: Series) -> Float[np.ndarray, "time 3"]:
        """See `StateSpace.observation_row`; level and distance from it are seen."""
        return np.tile([1.0, 0.0, 1.0], (len(time), 1))

    def advance(self, step: Series) -> Advanced:
        """See `StateSpace.advance`."""
        keep = np.exp(-step[:, None] / self.memory)
        transition, noise = np.zeros((2, *keep.shape, 3, 3))
        transition[..., 0, 0] = transition[..., 1, 1] = 1.0
        transition[..., 0, 1], transition[..., 2, 2] = step[:, None], keep
        noise[..., 0, 0] = self.sigma**2 * step[:, None]
        noise[..., 2, 2] = self.around**2 * (1.0 - keep**2)
        return transition, noise

    def _restored(self, belief: Belief, event: KnownChange) -> Belief:
        """Take away a share of the damage: of the distance from the first level seen."""
        left, base = 1.0 - event.restored, float(self.history.value[0])
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        mean[:, 0] = base + left * (mean[:, 0] - base)
        covariance[:, 0, :] *= left
        covariance[:, :, 0] *= left
        return lifted(Belief(belief.time, mean, covariance), event.sd)

    def draw(
        self, later: Float[np.ndarray, " later"], count: int, rng: np.random.Generator
    ) -> Drawn:
        """Sample paths at future slow times, the first of which is the last reading's."""
        owners = rng.choice(len(self.sigma), size=count, p=self.weights)
        values, vectors = np.linalg.eigh(self.belief.covariance[owners])
        shocks = np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal((count, 3))
        start = self.belief.mean[owners] + np.einsum("pij,pj->pi", vectors, shocks)
        ahead = later - later[0]
        steps = rng.standard_normal((count, len(later))) * np.sqrt(np.diff(ahead, prepend=0.0))
        wander = self.sigma[owners, None] * np.cumsum(steps, axis=1)
        paths = start[:, :1] + start[:, 1:2] * ahead + wander
        around, memory = self.around[owners], self.memory[owners]
        if around.any():
            now = start[:, 2]
            paths[:, 0] += now
            for i, step in enumerate(np.diff(ahead).tolist(), start=1):
                keep = np.exp(-step / memory)
                now = keep * now + around * np.sqrt(1.0 - keep**2) * rng.standard_normal(count)
                paths[:, i] += now
        return Drawn(paths, self.sigma[owners] ** 2 + 2.0 * around**2 / memory)

    def hyperparameters(self) -> FleetPrior | None:
        """Give the drift over slow time."""
        mean, variance = self.belief.mean[:, 1], self.belief.covariance[:, 1, 1]
        centre = self.weights @ mean
        spread = self.weights @ (variance + (mean - centre) ** 2)
        return FleetPrior(self.name, np.array([centre]), np.array([[spread]]))
