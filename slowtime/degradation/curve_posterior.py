"""Posterior of a curve: sampled shapes, with a Kalman filter of linear coefficients each."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, logsumexp

from .curves import Curve, columns
from .fleet import FleetPrior
from .history import LEVEL_WIDTH, History, Series
from .law import Drawn
from .sampling import Sample, importance_sample, normal_log_density


@dataclasses.dataclass(frozen=True, slots=True)
class CurveLaw:
    """A `Curve` as a law that learns: see `law.Law`."""

    curve: Curve

    @property
    def name(self) -> str:
        """The curve's name."""
        return self.curve.name

    def learn(self, history: History, fleet: FleetPrior | None = None) -> "CurvePosterior":
        """Sample shapes, and filter the linear coefficients of each; see `law.Law.learn`."""
        curve, size = self.curve, len(self.curve.names)
        prior = coefficient_prior(curve, history, fleet)

        def log_likelihood(points: np.ndarray) -> np.ndarray:
            return _batch_log_likelihood(curve, history, points, *prior)

        if size:
            sample = importance_sample(
                log_likelihood, normal_log_density, lambda n: n, normal_log_density, size
            )
        else:
            sample = Sample(np.zeros((1, 0)), np.zeros(1))
        number, width = len(sample.points), len(prior[0])
        begun = CurvePosterior(
            curve, history, sample,
            np.tile(prior[0], (number, 1)), np.tile(prior[1], (number, 1, 1)),
            np.zeros(number), np.zeros(number), 0,
        )  # fmt: skip
        assert begun.mean.shape == (number, width)
        return begun.follow(history.time, history.value, history.sd)


def coefficient_prior(
    curve: Curve, history: History, fleet: FleetPrior | None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the linear coefficients beforehand: level, change, shifts."""
    wide = LEVEL_WIDTH * history.scatter
    if curve.fades:
        mean, sds = [1.0 + history.centre], [wide]
    else:
        mean, sds = [history.centre, 0.0], [wide, wide]
    covariance = np.diag(np.square([*sds, *history.step_sds]))
    if fleet is not None and not curve.fades:
        # The sisters' rate of change, over this asset's history.
        mean[1] = float(fleet.mean[0]) * history.span
        covariance[1, 1] = float(fleet.covariance[0, 0]) * history.span**2
    return np.array([*mean, *np.zeros(len(history.step_sds))]), covariance


@dataclasses.dataclass(frozen=True, slots=True)
class CurvePosterior:
    """What is believed of a curve: see `law.Posterior`.

    Parameters
    ----------
    curve, history
        The law, and the readings that fixed its scales.
    sample
        Shapes with importance weights.
    mean, covariance
        Of the linear coefficients, for each shape.
    log_likelihood, misfit
        Of each shape, over the readings so far: log density, and sum of squared innovations
        over their variances.
    count
        Readings so far.
    """

    curve: Curve
    history: History
    sample: Sample
    mean: Float[np.ndarray, "point column"]
    covariance: Float[np.ndarray, "point column column"]
    log_likelihood: Float[np.ndarray, " point"]
    misfit: Float[np.ndarray, " point"]
    count: int

    @property
    def log_evidence(self) -> float:
        """See `law.Posterior`."""
        return float(logsumexp(self.sample.log_base + self.log_likelihood))

    @property
    def weights(self) -> Float[np.ndarray, " point"]:
        """Posterior probability of each shape."""
        log = self.sample.log_base + self.log_likelihood
        weight = np.exp(log - log.max())
        return np.asarray(weight / weight.sum())

    @property
    def p_value(self) -> float:
        """See `law.Posterior`: of the sum of squared innovations, which is chi-squared."""
        freedom = max(self.count - self.mean.shape[1], 1)
        return float(self.weights @ chdtrc(freedom, self.misfit))

    def follow(self, time: Series, value: Series, sd: Series) -> "CurvePosterior":
        """Update the belief by further readings, at a constant cost each.

        Portions do not matter: readings are taken one after another.

        Parameters
        ----------
        time, value, sd
            Slow time, value, and standard deviation of each reading; NaN readings are left out.

        Returns
        -------
        Belief after the readings.
        """
        known = np.isfinite(value) & np.isfinite(sd)
        time, value, sd = time[known], value[known], sd[known]
        if not len(time):
            return self
        design = self._columns(time)
        mean, covariance = self.mean.copy(), self.covariance.copy()
        total, misfit = self.log_likelihood.copy(), self.misfit.copy()
        first, floor = self.count, 1e-6 * self.history.scatter
        target = value + (1.0 if self.curve.fades else 0.0)
        for i in range(len(time)):
            row = design[:, i]
            reach = np.einsum("pij,pj->pi", covariance, row)
            spread = np.einsum("pi,pi->p", reach, row) + max(float(sd[i]), floor) ** 2
            residual = target[i] - np.einsum("pi,pi->p", mean, row)
            square = residual**2 / spread
            total -= 0.5 * (square + np.log(2.0 * np.pi * spread))
            # The first readings fix the vague coefficients: they say nothing of the fit.
            if first + i >= mean.shape[1]:
                misfit += square
            gain = reach / spread[:, None]
            mean += gain * residual[:, None]
            covariance -= gain[:, :, None] * reach[:, None, :]
        return dataclasses.replace(
            self, mean=mean, covariance=covariance, log_likelihood=total, misfit=misfit,
            count=first + len(time),
        )  # fmt: skip

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
        owners = rng.choice(len(self.mean), size=count, p=self.weights)
        values, vectors = np.linalg.eigh(self.covariance[owners])
        shocks = rng.standard_normal((count, self.mean.shape[1]))
        spread = np.sqrt(np.maximum(values, 0.0)) * shocks
        coefficients = self.mean[owners] + np.einsum("pij,pj->pi", vectors, spread)
        design = self._columns(later, owners)
        paths = np.einsum("ptc,pc->pt", design, coefficients)
        if self.curve.fades:
            paths = paths - 1.0
        return Drawn(paths, np.zeros(count))

    def hyperparameters(self) -> FleetPrior | None:
        """Give the rate of change over slow time; None for a law that fades."""
        if self.curve.fades:
            return None
        mean, variance = self.mean[:, 1], self.covariance[:, 1, 1]
        centre = self.weights @ mean
        spread = self.weights @ (variance + (mean - centre) ** 2)
        span = self.history.span
        return FleetPrior(
            self.curve.name, np.array([centre / span]), np.array([[spread / span**2]])
        )

    def _columns(
        self, time: Float[np.ndarray, " any"], owners: np.ndarray | None = None
    ) -> np.ndarray:
        points = self.sample.points if owners is None else self.sample.points[owners]
        own = columns(self.curve, points, self.history.age(time))
        steps = self.history.steps(time)
        shared = np.broadcast_to(steps, (len(points), *steps.shape))
        return np.concatenate([own, shared], axis=-1)


def _batch_log_likelihood(
    curve: Curve, history: History, points: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> Float[np.ndarray, " point"]:
    """Log density of all readings at each shape, linear coefficients integrated out."""
    own = columns(curve, points, history.age(history.time))
    steps = history.steps(history.time)
    shared = np.broadcast_to(steps, (len(points), *steps.shape))
    design = np.concatenate([own, shared], axis=-1) / history.sd[:, None]
    target = (history.value + (1.0 if curve.fades else 0.0)) / history.sd - design @ mean
    information = np.swapaxes(design, 1, 2) @ design + np.linalg.inv(covariance)
    score = np.einsum("ptc,pt->pc", design, target)
    solved = np.linalg.solve(information, score[..., None])[..., 0]
    determinant = np.linalg.slogdet(information)[1] + np.linalg.slogdet(covariance)[1]
    square = np.sum(target**2, axis=1) - np.sum(score * solved, axis=1)
    constant = np.log(2.0 * np.pi * history.sd**2).sum()
    return np.asarray(-0.5 * (square + determinant + constant))
