r"""Damage that drifts, read with errors, of a fleet of sister assets at once.

Damage D grows the faster the more there is of it, by an acceleration c; u is its coordinate in
which it drifts evenly, 0 as built and 1 at failure:

.. math::
    u = \frac{\ln(1 + c D)}{\ln(1 + c)}, \qquad
    du = \mu_i\,dt + \sqrt{q}\,dW, \qquad y = D(u) + e, \qquad \mu_i \sim N(M, s^2)

and u = D where c = 0. An extended Kalman filter of :math:`(u, \mu_i)` with a diffuse rate runs
for each q and c of a bank; the fleet chooses among them by their evidence, and M and s by the
marginal likelihood of all rates. Failures ahead are those of a gamma process of the same mean
and variance, which does not turn back.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaincc, ndtr, ndtri

VARIANCES = tuple(np.geomspace(3e-5, 3e-2, 8).tolist())
"""Values of q [1/time, in units where damage fails at 1 after about 10] of the bank, a factor
of 2.7 apart; between them q is found by a parabola through the evidence."""

ACCELERATIONS = (0.0, 0.7, 2.0)
"""Values of c of the bank: damage grows at its end 1, 1.7 and 3 times as fast as at first."""

PRIOR_SD = 1.5
"""Standard deviation of ln q about the middle of the bank: it matters in the first months."""

SPREADS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.55, 0.7)
"""Values of s / M among which the marginal likelihood chooses."""

DIFFUSE = 5.0
"""Standard deviation of a rate [in units of the first guess] before any reading: vague, and yet
so small that the drift of a first epoch stays where D(u) is nearly linear."""

LEAST_SLOPE = 0.05
"""Smallest dD/du used where an estimate of the damage is below 0 by the error of readings."""

_Q = np.repeat(VARIANCES, len(ACCELERATIONS))[:, None]
_C = np.tile(ACCELERATIONS, len(VARIANCES))[:, None]

STATES = 15
"""Equally probable states of an asset in a decision."""

LEAST_RATE = 1e-3
"""Smallest rate [of the fleet's mean] with which failures are foretold."""


@dataclasses.dataclass(frozen=True, slots=True)
class DriftBelief:
    """What is believed of each asset under each of the bank, with a diffuse rate.

    Parameters
    ----------
    place, rate
        Means of u [1] and of μ [1/time].
    pdd, pdr, prr
        Their covariance.
    evidence
        Log likelihood of the readings of the whole fleet, of each of the bank.
    """

    place: Float[np.ndarray, "*row bank asset"]
    rate: Float[np.ndarray, "*row bank asset"]
    pdd: Float[np.ndarray, "*row bank asset"]
    pdr: Float[np.ndarray, "*row bank asset"]
    prr: Float[np.ndarray, "*row bank asset"]
    evidence: Float[np.ndarray, "*row bank"]


@dataclasses.dataclass(frozen=True, slots=True)
class Pooled:
    """Belief of each asset with what its sisters tell of its rate.

    Parameters
    ----------
    place, rate, pdd, pdr, prr
        As of `DriftBelief`, of the most probable of the bank.
    variance, acceleration
        Its q [1/time] and c [1].
    mean_rate
        M [1/time].
    spread
        s [1/time], the error of M included.
    """

    place: Float[np.ndarray, "*row asset"]
    rate: Float[np.ndarray, "*row asset"]
    pdd: Float[np.ndarray, "*row asset"]
    pdr: Float[np.ndarray, "*row asset"]
    prr: Float[np.ndarray, "*row asset"]
    variance: Float[np.ndarray, "*row"]
    acceleration: Float[np.ndarray, "*row"]
    mean_rate: Float[np.ndarray, "*row"]
    spread: Float[np.ndarray, "*row"]

    @property
    def damage(self) -> Float[np.ndarray, "*row asset"]:
        """Estimate of the damage [1]."""
        return damage_at(self.place, self.acceleration[..., None])


def damage_at(
    place: Float[np.ndarray, "*any"], acceleration: Float[np.ndarray, "*acc"]
) -> Float[np.ndarray, "*any"]:
    """Damage D at a coordinate u.

    Parameters
    ----------
    place
        Coordinate u [1].
    acceleration
        Acceleration c [1]; broadcast against `place`.

    Returns
    -------
    Damage [1].
    """
    c = np.maximum(acceleration, 1e-9)
    return np.asarray(np.expm1(place * np.log1p(c)) / c)


def slope_at(
    place: Float[np.ndarray, "*any"], acceleration: Float[np.ndarray, "*acc"]
) -> Float[np.ndarray, "*any"]:
    """Compute the derivative dD/du at a coordinate u.

    Parameters
    ----------
    place
        Coordinate u [1].
    acceleration
        Acceleration c [1]; broadcast against `place`.

    Returns
    -------
    Derivative [1], at least `LEAST_SLOPE`.
    """
    c = np.maximum(acceleration, 1e-9)
    speed = np.log1p(c)
    return np.asarray(np.maximum(speed / c * np.exp(place * speed), LEAST_SLOPE))


def start(shape: tuple[int, ...], rate: float) -> DriftBelief:
    """Make the belief about new assets.

    Parameters
    ----------
    shape
        Leading axes, and the count of assets.
    rate
        First guess of M [1/time], which sets the scale of the diffuse rate.

    Returns
    -------
    The belief.
    """
    full = (*shape[:-1], len(_Q), shape[-1])
    none = np.zeros(full)
    return DriftBelief(
        none, np.full(full, rate), none, none, np.full(full, (DIFFUSE * rate) ** 2),
        np.zeros(full[:-1]),
    )  # fmt: skip


def advance(belief: DriftBelief, step: float) -> DriftBelief:
    """Predict the belief after a time without a reading.

    Parameters
    ----------
    belief
        Belief now.
    step
        Time that passes [time].

    Returns
    -------
    Belief then.
    """
    pdr = belief.pdr + step * belief.prr
    pdd = belief.pdd + step * (belief.pdr + pdr) + _Q * step
    return dataclasses.replace(
        belief, place=belief.place + step * belief.rate, pdd=pdd, pdr=pdr
    )


def read(
    belief: DriftBelief,
    reading: Float[np.ndarray, "*row asset"],
    sd: float | Float[np.ndarray, "*row asset"],
) -> DriftBelief:
    """Update the belief by a reading of each asset; one that is NaN is passed over.

    Parameters
    ----------
    belief
        Belief before the reading.
    reading
        Measured damage of each asset [1].
    sd
        Standard deviation of a reading [1].

    Returns
    -------
    Belief after the reading.
    """
    own = np.broadcast_to(np.asarray(sd, dtype=float), reading.shape)[..., None, :]
    given = np.isfinite(reading)[..., None, :]
    slope = slope_at(belief.place, _C)
    off = np.where(given, reading[..., None, :] - damage_at(belief.place, _C), 0.0)
    total = slope**2 * belief.pdd + own**2
    gain_d = np.where(given, slope * belief.pdd / total, 0.0)
    gain_r = np.where(given, slope * belief.pdr / total, 0.0)
    score = np.where(given, -0.5 * (np.log(total) + off**2 / total), 0.0)
    return DriftBelief(
        belief.place + gain_d * off,
        belief.rate + gain_r * off,
        belief.pdd * (1.0 - slope * gain_d),
        belief.pdr * (1.0 - slope * gain_d),
        belief.prr - slope * gain_r * belief.pdr,
        belief.evidence + score.sum(axis=-1),
    )


def renew(belief: DriftBelief, renewed: Bool[np.ndarray, "*row asset"]) -> DriftBelief:
    """Set the assets that were renewed to undamaged; the belief about their rates is kept.

    Parameters
    ----------
    belief
        Belief before the renewal.
    renewed
        True for each asset that was renewed.

    Returns
    -------
    Belief after the renewal.
    """
    new = np.broadcast_to(renewed[..., None, :], belief.place.shape)
    return dataclasses.replace(
        belief,
        place=np.where(new, 0.0, belief.place),
        pdd=np.where(new, 0.0, belief.pdd),
        pdr=np.where(new, 0.0, belief.pdr),
    )


def pool(belief: DriftBelief, guess: float, guess_sd: float) -> Pooled:
    """Combine the belief about each asset with the rates of its sister assets.

    Parameters
    ----------
    belief
        Belief about each asset by itself.
    guess, guess_sd
        Of M before any reading [1/time].

    Returns
    -------
    Belief about each asset, with the rates of the fleet.
    """
    chosen, variance, acceleration = _chosen(belief.evidence)
    best = chosen[..., None, None]
    place, rate, pdd, pdr, prr = (
        np.take_along_axis(each, best, axis=-2)[..., 0, :]
        for each in (belief.place, belief.rate, belief.pdd, belief.pdr, belief.prr)
    )
    mean, spread = _sisters(rate, prr, guess, guess_sd)
    total = prr + (spread**2)[..., None]
    off = mean[..., None] - rate
    return Pooled(
        place + pdr / total * off,
        rate + prr / total * off,
        pdd - pdr**2 / total,
        pdr * (1.0 - prr / total),
        prr * (1.0 - prr / total),
        variance,
        acceleration,
        mean,
        spread,
    )


def _chosen(
    evidence: Float[np.ndarray, "*row bank"],
) -> tuple[Int[np.ndarray, "*row"], Float[np.ndarray, "*row"], Float[np.ndarray, "*row"]]:
    """Index of the most probable of the bank, its q refined by a parabola, and its c."""
    logs = np.log(VARIANCES)
    prior = -0.5 * ((logs - logs.mean()) / PRIOR_SD) ** 2
    of_each = evidence.reshape(*evidence.shape[:-1], len(logs), len(ACCELERATIONS))
    of_each = of_each + prior[:, None]
    flat = of_each.reshape(evidence.shape).argmax(axis=-1)
    row, column = np.divmod(flat, len(ACCELERATIONS))
    line = np.take_along_axis(of_each, column[..., None, None], axis=-1)[..., 0]
    middle = np.clip(row, 1, len(logs) - 2)
    low, mid, high = (
        np.take_along_axis(line, (middle + k)[..., None], axis=-1)[..., 0] for k in (-1, 0, 1)
    )
    bend = np.maximum(2.0 * mid - low - high, 1e-9)
    shift = np.clip((high - low) / (2.0 * bend), -1.0, 1.0)
    found = np.exp(logs[middle] + shift * (logs[1] - logs[0]))
    return np.asarray(flat), np.asarray(found), np.asarray(np.array(ACCELERATIONS)[column])


def _sisters(
    rate: Float[np.ndarray, "*row asset"],
    var: Float[np.ndarray, "*row asset"],
    guess: float,
    guess_sd: float,
) -> tuple[Float[np.ndarray, "*row"], Float[np.ndarray, "*row"]]:
    """M and s (with the error of M) of the largest marginal likelihood."""
    shares = np.array(SPREADS)
    # The spread is relative to a first M, found with a middling one.
    first = _mean(rate, var + (0.3 * guess) ** 2, guess, guess_sd)[0]
    s2 = (shares * np.maximum(first, 0.1 * guess)[..., None]) ** 2
    total = var[..., None, :] + s2[..., None]
    mean, precision = _mean(rate[..., None, :], total, guess, guess_sd)
    off = rate[..., None, :] - mean[..., None]
    fit = -0.5 * (np.log(total) + off**2 / total).sum(axis=-1) - 0.5 * np.log(precision)
    best = fit.argmax(axis=-1)[..., None]
    pick = (np.take_along_axis(each, best, axis=-1)[..., 0] for each in (mean, s2, precision))
    m, s, p = pick
    return np.asarray(m), np.asarray(np.sqrt(s + 1.0 / p))


def _mean(
    rate: Float[np.ndarray, "*#row asset"],
    total: Float[np.ndarray, "*row asset"],
    guess: float,
    guess_sd: float,
) -> tuple[Float[np.ndarray, "*row"], Float[np.ndarray, "*row"]]:
    precision = (1.0 / total).sum(axis=-1) + guess_sd**-2
    mean = ((rate / total).sum(axis=-1) + guess * guess_sd**-2) / precision
    return np.asarray(mean), np.asarray(precision)


def states_of(
    pooled: Pooled, count: int = STATES
) -> tuple[Float[np.ndarray, "*row asset state"], Float[np.ndarray, "*row asset state"]]:
    """Give equally probable u below 1 of each asset, with the mean rate of each."""
    sd = np.sqrt(np.maximum(pooled.pdd, 1e-12))[..., None]
    middle = pooled.place[..., None]
    share = (np.arange(count) + 0.5) / count * ndtr((1.0 - middle) / sd)
    place = np.minimum(middle + sd * ndtri(np.clip(share, 1e-300, 1 - 1e-16)), 1.0 - 1e-6)
    tilt = (pooled.pdr / np.maximum(pooled.pdd, 1e-12))[..., None]
    return place, pooled.rate[..., None] + tilt * (place - middle)


def failure_cdf(
    pooled: Pooled,
    place: Float[np.ndarray, "*row asset state"],
    rate: Float[np.ndarray, "*row asset state"],
    time: Float[np.ndarray, " time"],
) -> Float[np.ndarray, "*row asset state time"]:
    """Probability that each state has failed by each time, by a gamma process.

    Parameters
    ----------
    pooled
        Gives q, M and what is not known of the rate at a known damage.
    place
        Coordinate u of each state [1].
    rate
        Rate of each state [1/time].
    time
        From now [time].

    Returns
    -------
    Probabilities [1].
    """
    left = np.maximum(pooled.prr - pooled.pdr**2 / np.maximum(pooled.pdd, 1e-12), 0.0)
    fleet = np.maximum(pooled.mean_rate, 1e-12)[..., None, None]
    per_time = np.maximum(rate, LEAST_RATE * fleet)
    scale = pooled.variance[..., None, None] / fleet
    at = np.maximum(time, 1e-9)
    mean = per_time[..., None] * at
    var = left[..., None, None] * at**2 + (scale * per_time)[..., None] * at
    found = gammaincc(mean**2 / var, (1.0 - place)[..., None] * mean / var)
    found = np.where(time > 0, found, 0.0)
    return np.asarray(np.maximum.accumulate(found, axis=-1))
