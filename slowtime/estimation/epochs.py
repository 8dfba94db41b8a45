r"""Constants of a nonlinear structure, estimated from one record with standard deviations.

State of the unscented filter: displacements, velocities, the mean acceleration of each sensor's
node over the last interval, and the logarithms of the free constants over their nominal values.

An accelerometer under a white force reads no acceleration at an instant, which would have no
variance, but the mean over an interval, :math:`(v_{k+1} - v_k) / h`, with all forces in it. So
it is modelled here; readings of a higher rate may be averaged over the interval, which loses
nothing that is slower than it.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtri

from slowtime.dynamics.plant.parameter_names import Name
from slowtime.dynamics.stochastic import Springs, WhiteForce

from .gaussian import FilterStep, Gaussian
from .unscented import Unscented

_REACH = 5.0
"""Standard deviations about a first result within which a record is gone through again."""

Readings = Float[np.ndarray, "time *twins sensor"]
Forces = Float[np.ndarray, "force *series node"]


@dataclasses.dataclass(frozen=True, slots=True)
class Constants:
    """Constants of a structure as one record tells them.

    Parameters
    ----------
    names, nominal
        Of the free constants, and what they were taken for.
    prior_log_ratio, prior_log_sd
        Where the constants were taken to be before the record, and how well.
    log_ratio, log_covariance
        Logarithms of the constants over their nominal values, and the covariance of these.
    log_likelihood
        Of all readings.
    surprise
        Mean squared residual over what was expected of it [1]: 1 if the model is right.
    """

    names: tuple[Name, ...]
    nominal: Float[np.ndarray, " free"]
    prior_log_ratio: Float[np.ndarray, "*twins free"]
    prior_log_sd: Float[np.ndarray, " free"]
    log_ratio: Float[np.ndarray, "*twins free"]
    log_covariance: Float[np.ndarray, "*twins free free"]
    log_likelihood: Float[np.ndarray, "*twins"]
    surprise: Float[np.ndarray, "*twins"]

    @property
    def value(self) -> Float[np.ndarray, "*twins free"]:
        """The constants, in their units: medians."""
        return np.asarray(self.nominal * np.exp(self.log_ratio))

    @property
    def log_sd(self) -> Float[np.ndarray, "*twins free"]:
        """Standard deviations of the logarithms: relative ones of the constants."""
        return np.asarray(np.sqrt(np.diagonal(self.log_covariance, axis1=-2, axis2=-1)))

    def record_alone(self) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms over nominal values as the record alone tells them, and their sd.

        Epochs that are put together must not each bring the same prior along. It is taken out
        constant by constant; where a record says less than the prior does, it stays.
        """
        own, prior = self.log_sd**-2.0, self.prior_log_sd**-2.0
        left = own - prior
        told = left > prior
        safe = np.where(told, left, 1.0)
        log = (own * self.log_ratio - prior * self.prior_log_ratio) / safe
        return (
            np.where(told, log, self.log_ratio),
            np.where(told, safe**-0.5, self.log_sd),
        )

    def interval(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Compute the ends of the interval that holds each constant with probability `level`.

        Parameters
        ----------
        level
            Probability [1].

        Returns
        -------
        Lower and upper ends [twins, free], in the units of the constants.
        """
        half = float(ndtri(0.5 + 0.5 * level)) * self.log_sd
        ends = self.value * np.exp(-half), self.value * np.exp(half)
        return np.minimum(*ends), np.maximum(*ends)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Watched:
    """A structure, what of it is free, and what is known of forces and sensors.

    Parameters
    ----------
    springs
        The structure, with nominal values.
    free
        Constants to be estimated; their signs are those of the nominal values.
    log_sd
        Prior standard deviation of the logarithm of each: 0.1 for ten per cent.
    step_s
        Interval from one reading to the next [s].
    white
        Forces that nobody measures.
    force_sd
        Standard deviation of the error of the measured forces, as means over the interval [N].
    sensors
        Rows of the nodes whose mean acceleration is read.
    reading_sd
        Standard deviation of the noise of each reading [m/s^2].
    start_sd
        Of displacements and velocities at the start, in this order [m, m/s].
    substeps
        Of the integration, per interval.
    alpha, beta, gate
        Of the filter, see `Unscented`.
    """

    springs: Springs
    free: tuple[Name, ...]
    log_sd: Float[np.ndarray, " free"]
    step_s: float
    white: WhiteForce
    force_sd: Float[np.ndarray, " node"]
    sensors: Int[np.ndarray, " sensor"]
    reading_sd: Float[np.ndarray, " sensor"]
    start_sd: Float[np.ndarray, " state"]
    substeps: int = 1
    alpha: float = 0.3
    beta: float = 2.0
    gate: float | None = None

    @property
    def nominal(self) -> Float[np.ndarray, " free"]:
        """What the free constants are taken for."""
        return np.asarray(self.springs.values[self.springs.where(self.free)])

    def filter(self) -> Unscented:
        """Joint filter of motion and constants."""
        nodes, sensors = len(self.springs.nodes), len(self.sensors)
        moving, free = 2 * nodes, self.springs.where(self.free)
        base, seen = self.springs.values, self.sensors
        h, white = self.step_s, self.white
        mass = base[self.springs.where([("mass", name) for name in self.springs.nodes])]

        def move(points: np.ndarray, known: Any) -> np.ndarray:
            ends = np.broadcast_to(known, (*points.shape[:-2], known.shape[-1]))
            first, last = ends[..., :nodes], ends[..., -nodes:]
            rows = points.reshape(-1, points.shape[-1])
            values = np.repeat(base[None], len(rows), axis=0)
            values[:, free] *= np.exp(rows[:, moving + sensors :])
            moved = self.springs.move(
                rows[:, :moving],
                first.reshape(-1, nodes),
                last.reshape(-1, nodes),
                h,
                values,
                substeps=self.substeps,
            )
            mean = (moved[:, nodes:] - rows[:, nodes:moving])[:, seen] / h
            found = np.concatenate([moved, mean, rows[:, moving + sensors :]], axis=1)
            return found.reshape(points.shape)

        def read(points: np.ndarray, known: Any) -> np.ndarray:
            return np.asarray(points[..., moving : moving + sensors])

        def process_root(mean: np.ndarray, known: Any) -> np.ndarray:
            of_white = white.added + white.per_metre * mean[..., :nodes]
            b = np.sqrt(of_white**2 + self.force_sd**2 * h) / mass
            root = np.zeros((*mean.shape, moving))
            at = np.arange(nodes)
            root[..., at, at] = 0.5 * h**1.5 * b
            root[..., at, nodes + at] = 0.5 * h**1.5 / 3.0**0.5 * b
            root[..., nodes + at, at] = h**0.5 * b
            root[..., moving : moving + sensors, :] = root[..., nodes + seen, :] / h
            return root

        return Unscented(
            move=move,
            read=read,
            process_root=process_root,
            reading_noise=np.diag(self.reading_sd**2),
            alpha=self.alpha,
            beta=self.beta,
            gate=self.gate,
        )

    def start(
        self,
        log_ratio: Float[np.ndarray, "*twins free"],
        log_sd: Float[np.ndarray, "*twins free"],
    ) -> Gaussian:
        """Belief before the first reading, with the constants as given.

        Parameters
        ----------
        log_ratio
            Logarithms of the constants over their nominal values [1].
        log_sd
            Their standard deviations [1].

        Returns
        -------
        Belief about the state of the filter.
        """
        still, twins = len(self.start_sd) + len(self.sensors), log_ratio.shape[:-1]
        sd = np.concatenate(
            [
                np.broadcast_to(self.start_sd, (*twins, len(self.start_sd))),
                np.zeros((*twins, len(self.sensors))),
                np.broadcast_to(log_sd, log_ratio.shape),
            ],
            axis=-1,
        )
        mean = np.concatenate([np.zeros((*twins, still)), log_ratio], axis=-1)
        return Gaussian(mean, sd[..., None] * np.eye(sd.shape[-1]))


@dataclasses.dataclass(frozen=True, slots=True)
class Tally:
    """Sums over the steps of a filter."""

    log_likelihood: np.ndarray
    surprise: np.ndarray
    used: np.ndarray

    def plus(self, step: FilterStep) -> "Tally":
        """Count one step more."""
        return Tally(
            self.log_likelihood + step.log_likelihood,
            self.surprise + np.where(step.used > 0, step.surprise, 0.0),
            self.used + step.used,
        )


def identify_epoch(
    watched: Watched,
    readings: Readings,
    forces: Forces,
    *,
    log_ratio: Float[np.ndarray, "*twins free"] | None = None,
    passes: int = 2,
) -> Constants:
    r"""Estimate the constants from one record, of many twins or epochs at once.

    Parameters
    ----------
    watched
        The structure and what is known.
    readings
        Mean accelerations over each interval [m/s^2]; NaN where missing.
    forces
        Measured forces over the same intervals [N]: their means (`dynamics.stochastic.means`),
        a column a node; or the ends of a straight line through each interval, the columns of
        its beginning before those of its end. A mean alone displaces the structure by
        :math:`(\omega h)^2 / 12` of what the force would hold it at.
    log_ratio
        Where the constants are taken to be before, over the nominal values.
    passes
        How often the record is gone through.

    Returns
    -------
    The constants, one entry per twin.

    Notes
    -----
    Where the prior is wide, the points of the first readings lie where the structure is not,
    and what they teach is half wrong but wholly believed. So each further pass starts about
    the result of the one before, `_REACH` standard deviations wide, and what that start has
    put in is taken out of its result again:

    .. math:: P^{-1} = P_2^{-1} - S^{-1} + P_0^{-1}, \qquad
              P^{-1} m = P_2^{-1} m_2 - S^{-1} s + P_0^{-1} m_0

    with s and S where the pass started, :math:`m_2, P_2` where it ended, and
    :math:`m_0, P_0` the prior, so that the readings count once. The constants do not wander,
    therefore :math:`P_2 \le S`, and P is positive.
    """
    if len(forces) != len(readings):
        raise ValueError(
            f"{len(forces)} forces were given for {len(readings)} intervals. Give the mean of "
            "the force over each interval that was read."
        )
    twins, one = readings.shape[1:-1], watched.filter()
    prior = np.zeros((*twins, len(watched.free)))
    if log_ratio is not None:
        prior = prior + log_ratio
    centre, sd = prior, np.broadcast_to(watched.log_sd, prior.shape)
    for _ in range(passes):
        belief, tally = _go_through(watched, one, centre, sd, readings, forces)
        count = len(watched.free)
        mean, covariance = _restart_undone(
            belief.mean[..., -count:],
            belief.covariance[..., -count:, -count:],
            (centre, sd),
            (prior, watched.log_sd),
        )
        centre, spread = mean, np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        sd = np.minimum(_REACH * spread, watched.log_sd)
    return Constants(
        watched.free,
        watched.nominal,
        prior,
        watched.log_sd,
        mean,
        covariance,
        tally.log_likelihood,
        tally.surprise / np.maximum(tally.used, 1),
    )


def _go_through(
    watched: Watched,
    one: Unscented,
    centre: np.ndarray,
    sd: np.ndarray,
    readings: np.ndarray,
    forces: np.ndarray,
) -> tuple[Gaussian, Tally]:
    belief, none = watched.start(centre, sd), np.zeros(readings.shape[1:-1])
    tally = Tally(none, none, none)
    for reading, force in zip(readings, forces, strict=True):
        belief, step = one.step(belief, reading, force)
        tally = tally.plus(step)
    return belief, tally


def _restart_undone(
    mean: np.ndarray,
    covariance: np.ndarray,
    start: tuple[np.ndarray, np.ndarray],
    prior: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance as if the pass had started from the prior."""
    eye = np.eye(mean.shape[-1])
    information = np.linalg.inv(covariance)
    taken, given = (sd[..., None] ** -2.0 * eye for _, sd in (start, prior))
    left = information - taken + given
    whole = np.linalg.inv(0.5 * (left + np.swapaxes(left, -1, -2)))
    pull = (
        information @ mean[..., None]
        - taken @ start[0][..., None]
        + given @ prior[0][..., None]
    )
    return (whole @ pull)[..., 0], 0.5 * (whole + np.swapaxes(whole, -1, -2))
