"""Posterior of a curve: sampled shapes, with a Kalman filter of linear coefficients each."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, logsumexp

from .curves import Curve, columns, point_of_rate, points_of_periods
from .fleet import FleetPrior
from .history import LEVEL_WIDTH, History, Series
from .law import Drawn
from .sampling import WeightedPoints, importance_sample, normal_log_density

POINTS, ROUNDS = 256, 2
"""Shapes of each proposal, and proposals after the first [1]."""

NEGLIGIBLE = 14.0
"""Logarithm of the weight over the greatest below which a shape is left out [1]."""

NOMINAL_SD = 0.015
"""Prior sd of a constant in the readings of a structure that fades to total loss [1]: a nominal
model is known to about a percent, and a law without this would be surer than its readings."""

BREAK_WIDTH = 3.0
"""Prior sd of a step, and of a bend over the history, over the scatter of the readings [1]."""

WAVE_WIDTH = 1.2
"""Prior sd of the cosine and sine of a wave, over the geometric mean of the scatters of the
readings and about a parabola, and over the square of the number of the harmonic [1]: a wave
alone scatters by 0.7 of its amplitude."""

MOST_PLACES = 128
"""Places of a break that are tried [1]."""

FEWEST_PERIODS, MOST_PERIODS, PEAKS = 0.3, 40.0, 4
"""Periods in the history between which a wave is looked for, and how many are tried [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class CurveLaw:
    """A `Curve` as a law that learns: see `law.Law`."""

    curve: Curve

    @property
    def name(self) -> str:
        """The curve's name."""
        return self.curve.name

    def learn(self, history: History, fleet: FleetPrior | None = None) -> "CurvePosterior":
        """Sample shapes, and solve for the linear coefficients of each; see `law.Law.learn`."""
        curve, size = self.curve, len(self.curve.names)
        prior = coefficient_prior(curve, history, fleet)

        def log_likelihood(points: np.ndarray) -> np.ndarray:
            return _solve(curve, history, points, *prior).log_likelihood

        if curve.broken is not None:
            places = _places(history)
            sample = WeightedPoints(places, np.full(len(places), -np.log(len(places))))
        elif size:
            sample = importance_sample(
                log_likelihood, normal_log_density, lambda n: n, normal_log_density, size,
                points=POINTS, rounds=ROUNDS,
                starts=_starts(curve, history) if curve.harmonics else None,
            )  # fmt: skip
        else:
            sample = WeightedPoints(np.zeros((1, 0)), np.zeros(1))
        found = _solve(curve, history, sample.points, *prior)
        log = sample.log_base + found.log_likelihood
        kept = log > log.max() - NEGLIGIBLE
        return CurvePosterior(
            curve, history, WeightedPoints(sample.points[kept], sample.log_base[kept]),
            found.mean[kept], np.linalg.inv(found.information[kept]),
            found.log_likelihood[kept], found.misfit[kept], len(history.time),
        )  # fmt: skip


def _places(history: History) -> Float[np.ndarray, "place 1"]:
    """Places of a break, between readings and at most `MOST_PLACES`, over the history."""
    age = history.age(history.time)
    middle = 0.5 * (age[1:] + age[:-1])
    number = min(len(middle), MOST_PLACES)
    return np.asarray(middle[np.linspace(0, len(middle) - 1, number).astype(int), None])


def _starts(curve: Curve, history: History) -> Float[np.ndarray, "start parameter"]:
    """Give points at the periods that least squares find clearest."""
    # The periodogram is of what is left of a parabola, in steps of a tenth of a period over the
    # history: the likelihood has a peak for each number of periods.
    age = history.age(history.time)
    fastest = min(0.4 * len(age), MOST_PERIODS)
    periods = np.arange(FEWEST_PERIODS, max(fastest, FEWEST_PERIODS + 0.2), 0.1)
    weight = 1.0 / history.sd
    base, _ = np.linalg.qr(np.vander(age, 3) * weight[:, None])
    left = history.value * weight
    left = left - base @ (base.T @ left)
    turn = 2.0 * np.pi * periods[:, None] * age
    wave = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * weight[:, None]
    wave = wave - base @ (base.T @ wave)
    turned, _ = np.linalg.qr(wave)
    power = np.sum((left @ turned) ** 2, axis=-1)
    inner = np.concatenate([[-np.inf], power, [-np.inf]])
    peaks = np.flatnonzero((power >= inner[:-2]) & (power >= inner[2:]))
    best = peaks[np.argsort(-power[peaks], kind="stable")[:PEAKS]]
    clear = points_of_periods(periods[best])[:, None]
    if len(curve.names) == 1:
        return clear
    # The rate of the fade that least squares find: its posterior may be narrow.
    left_over = np.log(np.maximum(1.0 + history.value, 1e-3))
    rate = -float(np.polyfit(age, left_over, 1, w=weight * np.exp(left_over))[0])
    return np.column_stack([np.full(len(clear), point_of_rate(rate)), clear])


def coefficient_prior(
    curve: Curve, history: History, fleet: FleetPrior | None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the linear coefficients beforehand: level, change, shifts."""
    wide = LEVEL_WIDTH * history.scatter
    if curve.fades:
        mean, sds = [1.0 + history.centre, 0.0], [wide, NOMINAL_SD]
    else:
        mean, sds = [history.centre, 0.0], [wide, wide]
    beside = []
    if curve.broken is not None:
        beside.append(BREAK_WIDTH * history.scatter)
    # A parabola takes out most of a wave of less than a period, and nothing of a faster one.
    size = np.sqrt(history.rough * history.scatter)
    for harmonic in range(1, curve.harmonics + 1):
        beside += 2 * [WAVE_WIDTH * size / harmonic**2]
    covariance = np.diag(np.square([*sds, *beside, *history.step_sds]))
    if fleet is not None and not curve.fades:
        # The sisters' rate of change, over this asset's history.
        mean[1] = float(fleet.mean[0]) * history.span
        covariance[1, 1] = float(fleet.covariance[0, 0]) * history.span**2
    return np.array([*mean, *np.zeros(len(covariance) - len(mean))]), covariance


@dataclasses.dataclass(frozen=True, slots=True)
class CurvePosterior:
    """What is believed of a curve: see `law.Posterior`.

    Parameters
    ----------
    curve, history
        The law, and the readings that fixed its scales.
    mean, covariance
        Of the linear coefficients, for each shape.
    log_likelihood, misfit
        Of each shape, over the readings so far: log density, and sum of squared innovations
        over their variances.
    """

    curve: Curve
    history: History
    sample: WeightedPoints
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
        """Update the belief by further readings, at a constant cost each."""
        # Portions do not matter: readings are taken one after another.
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
        """Sample paths at future slow times, the first of which is the last reading's."""
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


@dataclasses.dataclass(frozen=True, slots=True)
class _Solved:
    """Of each shape, what the readings say of its linear coefficients.

    Parameters
    ----------
    log_likelihood, misfit
        As of `CurvePosterior`.
    """

    mean: Float[np.ndarray, "point column"]
    information: Float[np.ndarray, "point column column"]
    log_likelihood: Float[np.ndarray, " point"]
    misfit: Float[np.ndarray, " point"]


def _solve(
    curve: Curve, history: History, points: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> _Solved:
    """Condition the linear coefficients of each shape on all readings at once."""
    own = columns(curve, points, history.age(history.time))
    if len(history.step_sds):
        steps = history.steps(history.time)
        shared = np.broadcast_to(steps, (len(points), *steps.shape))
        own = np.concatenate([own, shared], axis=-1)
    design = own / history.sd[:, None]
    target = (history.value + (1.0 if curve.fades else 0.0)) / history.sd - design @ mean
    precision = np.linalg.inv(covariance)
    information = np.swapaxes(design, 1, 2) @ design + precision
    sign, log_determinant = np.linalg.slogdet(information)
    # A shape that grows by so much that rounding leaves nothing of its prior has no likelihood.
    sound = sign > 0.0
    information[~sound] = precision
    score = (target[:, None, :] @ design)[:, 0]
    solved = np.linalg.solve(information, score[..., None])[..., 0]
    determinant = log_determinant + np.linalg.slogdet(covariance)[1]
    # Not as the difference of two sums: of a shape far out, both are huge, and what rounding
    # leaves of them may be below zero, a likelihood beyond all others.
    left = target - np.einsum("ptc,pc->pt", design, solved)
    square = np.sum(left**2, axis=1) + np.einsum("pi,ij,pj->p", solved, precision, solved)
    constant = np.log(2.0 * np.pi * history.sd**2).sum()
    log_likelihood = np.where(sound, -0.5 * (square + determinant + constant), -np.inf)
    return _Solved(mean + solved, information, log_likelihood, square)
