r"""A law adopted: what it expects of later epochs, and how far from that a reading may be.

A model is a handful of members, each a law with shapes and a wandering part that the history
allows, and a weight. Each foretells by exact filtering with its coefficients integrated out;
the mixture is the band. Taking the terms away again gives back what was before.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.estimation import hyperparameters
from slowtime.evolution.change import check_level

from .evidence import Posterior
from .history import Covariate, Filled, History, Series, filled, history
from .law import (
    Fit,
    Readings,
    Term,
    climb,
    design,
    log_prior,
    noise,
    scorer,
    smoothnesses,
    solve,
    space,
)
from .search import Contest
from .whitening import Filtered, Wander, carry_on, whiten

_DRAWS = 32
_NEAR, _WIDE = 1.0, 2.0  # of the Laplace width: half the draws each
_TAILS = np.tile([_NEAR, _WIDE], _DRAWS // 2)
_LEAST = 0.05  # curvature along any direction, over that along a coordinate
_NEGLIGIBLE = 2e-3
_KEPT = 16
_WILD = 5.0  # standard deviations beyond which a later reading teaches nothing
_DEAF = 1e8  # variance with which a reading is expected but teaches nothing
_POSSIBLE = 0.02  # probability from which on a rival has a share in the band
_WILDEST = 0.04  # share of wild readings up to which the band is widened to hold them
_PATIENCE = 3  # such readings in a row, after which they are believed


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Member:
    """A law that the history allows, and how probable it is."""

    terms: tuple[Term, ...]
    wander: Wander
    weight: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SlowModel:
    """What a twin expects of the next epochs.

    Parameters
    ----------
    past
        The history it was learnt from.
    readings
        The same, scaled and judged.
    members
        Shapes of one law, with weights that sum to one.
    rivals
        Other laws that the history allows, with weights beside those of the members; the band
        of a drift that may be a line or a power is as wide as both.
    names
        Of the effects that were adopted; none for the nominal model.
    before
        The model it replaces; None for the nominal one.
    """

    past: History
    readings: Readings
    members: tuple[Member, ...]
    rivals: tuple[Member, ...] = ()
    names: tuple[str, ...] = ()
    before: "SlowModel | None" = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Band:
    """What was expected of readings, their noise included.

    Parameters
    ----------
    mean, sd, lo, hi
        In the unit of the values.
    accepted
        For readings that were followed: which taught something, others being wild.
    """

    mean: Float[np.ndarray, " later"]
    sd: Float[np.ndarray, " later"]
    lo: Float[np.ndarray, " later"]
    hi: Float[np.ndarray, " later"]
    accepted: Bool[np.ndarray, " later"]


def members(readings: Readings, fits: list[Fit]) -> tuple[Member, ...]:
    """Spread laws about the best of each smoothness, weighted by their evidence.

    Importance sampling from fixed points, somewhat wider than the peaks: the same history gives
    the same members.
    """
    drawn: list[tuple[float, tuple[Term, ...], Wander]] = []
    for fit in fits:
        room = space(readings, (), fit.terms, fit.wander)
        score_at = scorer(readings, room)
        share = log_prior(fit.wander) - np.log(np.ptp(room.box, axis=1) + 1e-300).sum()
        if not len(room.start):
            drawn.append((fit.peak + share, fit.terms, fit.wander))
            continue
        factor = _widths(score_at, room.start, np.array(fit.spreads), room.box)
        for z, wider in zip(_normal(len(factor)), _TAILS, strict=True):
            point = room.start + wider * (factor @ z)
            score = score_at(point)
            if np.isfinite(score):
                proposal = _log_proposal(wider * z) - np.linalg.slogdet(factor)[1]
                weight = score + share - float(proposal) - np.log(_DRAWS)
                drawn.append((weight, *room.build(point)))
    weights = np.array([one[0] for one in drawn])
    shares = np.exp(weights - weights.max())
    shares /= shares.sum()
    best = [i for i in np.argsort(-shares)[:_KEPT] if shares[i] > _NEGLIGIBLE]
    total = float(shares[best].sum())
    return tuple(Member(drawn[i][1], drawn[i][2], float(shares[i]) / total) for i in best)


def _normal(dimensions: int) -> Float[np.ndarray, "draw coordinate"]:
    """Spread standard normal points evenly, the first of them at the origin."""
    points = hyperparameters.spread(_DRAWS, dimensions)
    points[0] = 0.0
    return points


def _log_proposal(z: Float[np.ndarray, " coordinate"]) -> float:
    """Density of near and wide draws together."""
    parts = [
        -0.5 * float(z @ z) / w**2 - len(z) * np.log(np.sqrt(2.0 * np.pi) * w)
        for w in (_NEAR, _WIDE)
    ]
    return float(np.logaddexp(*parts) - np.log(2.0))


def _widths(
    score: Callable[[np.ndarray], float],
    peak: Float[np.ndarray, " coordinate"],
    spreads: Float[np.ndarray, " coordinate"],
    box: Float[np.ndarray, "coordinate 2"],
) -> Float[np.ndarray, "coordinate coordinate"]:
    """Factor of the covariance about a peak, by differences as wide as the peak itself.

    A lag and the length of the wandering part give way to each other: along the ridge the
    peak is wider than along either coordinate.
    """
    count = len(peak)
    curvature = np.eye(count)
    for i in range(count):
        for j in range(i):
            corners = []
            for first, second in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
                point = peak.copy()
                point[[i, j]] += np.array([first, second]) * spreads[[i, j]]
                corners.append(score(np.clip(point, box[:, 0], box[:, 1])))
            mixed = -0.25 * (corners[0] + corners[1] - corners[2] - corners[3])
            if np.isfinite(mixed):
                curvature[i, j] = curvature[j, i] = np.clip(mixed, -0.95, 0.95)
    values, vectors = np.linalg.eigh(curvature)
    root = vectors / np.sqrt(np.maximum(values, _LEAST))
    factor: Float[np.ndarray, "coordinate coordinate"] = spreads[:, None] * root
    return factor


def learn(
    past: History,
    readings: Readings,
    terms: tuple[Term, ...],
    wander: Wander,
    before: SlowModel | None = None,
    rivals: tuple[Member, ...] = (),
) -> SlowModel:
    """Polish all terms together, with every kind of wandering, into a model."""
    fits = [climb(readings, (), terms, start) for start in smoothnesses(wander)]
    names = tuple(term.kind.name for term in terms)
    return SlowModel(past, readings, members(readings, fits), rivals, names, before)


def rivals(contests: Sequence[Contest]) -> tuple[Member, ...]:
    """Keep the other laws of each place, nothing at all included, as likely as they were."""
    found = []
    for contest in contests:
        chosen, *others = contest.options
        found += [
            Member(o.fit.terms, o.fit.wander, o.probability / chosen.probability)
            for o in others
            if o.probability > _POSSIBLE
        ]
    return tuple(found)


def undo(model: SlowModel) -> SlowModel:
    """Give back the model as it was before the adoption."""
    if model.before is None:
        raise ValueError(
            "This is the nominal model: nothing was adopted, so nothing can be undone. Undo a "
            "model that `adopt` gave."
        )
    return model.before


def forecast(
    model: SlowModel,
    slow_time: Series,
    sd: Series,
    covariates: tuple[Covariate, ...] = (),
    *,
    level: float = 0.95,
) -> Band:
    """Foretell readings from the end of the history alone.

    Parameters
    ----------
    model
        What was adopted, or the nominal model.
    slow_time, sd
        Of the readings to come, ascending, none before the history ends.
    covariates
        As then read or expected, by the names of those of the history.
    level
        Probability of the band [1], wild readings included at the rate of the history.
    """
    nothing = np.full(len(slow_time), np.nan)
    return follow(model, slow_time, nothing, sd, covariates, level=level)


def follow(
    model: SlowModel,
    slow_time: Series,
    value: Series,
    sd: Series,
    covariates: tuple[Covariate, ...] = (),
    *,
    level: float = 0.95,
) -> Band:
    """Foretell each later reading from all before it; NaN values teach nothing.

    Parameters
    ----------
    model, slow_time, sd, covariates, level
        As for `forecast`.
    value
        The readings.
    """
    check_level(level)
    wild_share = min(1.0 - float(model.readings.mask.mean()), _WILDEST)
    quantile = check_level(min(level / (1.0 - wild_share), 0.5 + 0.5 * level))
    later = _later(model, slow_time, value, sd, covariates)
    everyone = (*model.members, *model.rivals)
    runners = [_Runner.start(model, member, later) for member in everyone]
    weights = np.array([member.weight for member in everyone])
    weights /= weights.sum()
    past = model.readings.past
    mean, spread = np.empty(len(slow_time)), np.empty(len(slow_time))
    accepted = np.zeros(len(slow_time), dtype=bool)
    wild = 0
    scaled = (value - past.centre) / past.scale
    for i in range(len(slow_time)):
        each = np.array([runner.expect(i) for runner in runners])
        mean[i] = weights @ each[:, 0]
        spread[i] = np.sqrt(weights @ (each[:, 1] + (each[:, 0] - mean[i]) ** 2))
        known = np.isfinite(scaled[i])
        wild = wild + 1 if known and abs(scaled[i] - mean[i]) > _WILD * spread[i] else 0
        accepted[i] = known and (wild == 0 or wild > _PATIENCE)
        for runner in runners:
            runner.learn(i, float(scaled[i]) if accepted[i] else None)
    mean, spread = past.centre + past.scale * mean, past.scale * spread
    return Band(mean, spread, mean - quantile * spread, mean + quantile * spread, accepted)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Later:
    """Later epochs in the units of the history, with it in front where memory is needed."""

    time: Float[np.ndarray, " whole"]
    sd: Float[np.ndarray, " later"]
    covariates: tuple[Filled, ...]
    past: int


def _later(
    model: SlowModel,
    slow_time: Series,
    value: Series,
    sd: Series,
    covariates: tuple[Covariate, ...],
) -> _Later:
    past = model.readings.past
    if len(slow_time) and not (
        slow_time[0] >= model.past.time[-1] and np.all(np.diff(slow_time) >= 0.0)
    ):
        raise ValueError(
            f"Later epochs begin at {slow_time[0]:g} or go back in time; the history ends at "
            f"{model.past.time[-1]:g}. Give ascending slow times after it."
        )
    if len(slow_time):
        history(slow_time, np.zeros(len(slow_time)), sd, covariates, fewest=1)
    named = {covariate.name: covariate for covariate in covariates}
    missing = [f.name for f in past.covariates if f.name not in named]
    used = {
        past.covariates[t.kind.covariate].name
        for m in (*model.members, *model.rivals)
        for t in m.terms
        if t.kind.covariate is not None
    }
    if needed := sorted(used & set(missing)):
        raise ValueError(
            f"The model follows {needed}, but later values were given of {sorted(named)}. Give "
            "them too, NaN where they were not read."
        )
    time = np.concatenate([past.time, (slow_time - past.start) / past.span])
    together = tuple(
        _continued(time, f, named.get(f.name), len(past.time)) for f in past.covariates
    )
    return _Later(time, sd / past.scale, together, len(past.time))


def _continued(time: Series, past: Filled, later: Covariate | None, count: int) -> Filled:
    """Carry a covariate on from the history, in the scale it had there."""
    new = np.full(len(time) - count, np.nan) if later is None else later.values
    values = np.concatenate([past.centre + past.scale * past.values, new])
    whole = filled(time, Covariate(past.name, values, past.unit, past.role))
    scaled = (whole.centre + whole.scale * whole.values - past.centre) / past.scale
    sd = np.concatenate([past.sd, whole.sd[count:] * whole.scale / past.scale])
    return dataclasses.replace(past, values=scaled, sd=sd)


@dataclasses.dataclass(slots=True, eq=False)
class _Runner:
    """One member on its way through later epochs."""

    wander: Wander
    columns: Float[np.ndarray, "later coefficient"]
    variance: Float[np.ndarray, " later"]
    time: Float[np.ndarray, " later"]
    state: Filtered
    mean: Float[np.ndarray, " coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    noise: float

    @classmethod
    def start(cls, model: SlowModel, member: Member, later: _Later) -> "_Runner":
        found, state = solve(model.readings, member.terms, member.wander)
        columns = design(member.terms, later.time, later.covariates)[later.past :]
        time = later.time[later.past :]
        variance = later.sd**2
        for term in member.terms:
            variance = variance * term.kind.factor(time, term.shape)
        variance = variance + _from_gaps(member.terms, later, found)
        return cls(
            member.wander, columns, variance, time, state,
            found.mean, found.covariance, found.noise_variance,
        )  # fmt: skip

    def expect(self, i: int) -> tuple[float, float]:
        """Mean and variance of a reading before it is read."""
        row = np.concatenate([[0.0], self.columns[i]])
        # A row of infinite variance only carries the state on in time.
        ahead = carry_on(
            self.wander, self.state, self.time[i : i + 1], np.array([np.inf]), row[None, :]
        )
        seen = row[1:] - ahead.mean[0, 1:]
        own = float(ahead.covariance[0, 0] + self.variance[i])
        value = float(ahead.mean[0, 0] + seen @ self.mean)
        return value, self.noise * own + float(seen @ self.covariance @ seen)

    def learn(self, i: int, value: float | None) -> None:
        """Go on to a reading, and take it in if there is one."""
        row = np.concatenate([[0.0 if value is None else value], self.columns[i]])
        variance = np.inf if value is None else self.variance[i]
        self.state = carry_on(
            self.wander, self.state, self.time[i : i + 1], np.array([variance]), row[None, :]
        )
        if value is None:
            return
        seen = self.state.white[0]
        shared = self.covariance @ seen[1:]
        gain = shared / (self.noise + float(seen[1:] @ shared))
        self.mean = self.mean + gain * float(seen[0] - seen[1:] @ self.mean)
        self.covariance = self.covariance - np.outer(gain, shared)


def _from_gaps(terms: tuple[Term, ...], later: _Later, found: Posterior) -> Series:
    """Variance that covariates add where they were not read."""
    total = np.zeros(len(later.time) - later.past)
    columns = design(terms, later.time, later.covariates)
    for index, covariate in enumerate(later.covariates):
        if not covariate.sd.any():
            continue
        nudged = list(later.covariates)
        nudged[index] = dataclasses.replace(covariate, values=covariate.values + covariate.sd)
        moved = design(terms, later.time, tuple(nudged)) - columns
        total = total + ((moved @ found.mean) ** 2)[later.past :]
    return total


def fitted(
    model: SlowModel,
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Residuals of the best member over the history, and what they were expected to scatter.

    Each reading is expected from those before it (and from coefficients that know them all);
    readings that were left out are expected too, but teach nothing.
    """
    readings, best = model.readings, model.members[0]
    found, _ = solve(readings, best.terms, best.wander)
    columns = design(best.terms, readings.past.time, readings.past.covariates)
    residual = readings.past.value - columns @ found.mean
    stated = noise(dataclasses.replace(readings, mask=np.ones_like(readings.mask)), best.terms)
    deaf = np.where(readings.mask, stated, _DEAF)
    filtered = whiten(best.wander, readings.past.time, deaf, residual[:, None])
    own = np.where(readings.mask, filtered.spread, filtered.spread - _DEAF + stated)
    return (
        filtered.white[:, 0] * np.sqrt(filtered.spread),
        np.sqrt(found.noise_variance * np.maximum(own, stated)),
    )
