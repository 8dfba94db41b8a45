"""Outlooks that a twin keeps, and what came of them: coverage, reliability, Brier score.

A statement says, as of one reading, the quantiles of the change at a few future instants and
the probability that each threshold is reached. Quantiles are kept as the laws gave them, beside
the factor by which they were told wider. They leave out the error that all readings share, as
no later reading shows it either.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from slowtime.evolution.forecasting import verification
from slowtime.evolution.forecasting.verification import LEVELS, StatementClass, Widening
from twin_server.registration.thresholds import Limit

from .changes import ForecastState, Past
from .futures import futures_of

KEPT = 64
"""Statements that are kept of a twin. Of a long history they are `LONGEST` readings apart, so
that they reach back over ten times the readings that a forecast is made from: some ten
independent statements, more of which would tell of a structure that is another by now."""

FIRST = 16
"""Readings before the first statement [1]: laws tell little from fewer."""

LONGEST = 64
"""Most readings between two statements [1]: a sixth of those that a forecast is made from, so
that statements nearer to each other would repeat one another."""

FRACTIONS = (0.125, 0.25, 0.5, 1.0)
"""Instants whose quantiles are kept, over the horizon [1]."""

INTERVALS = (0.5, 0.8, 0.9, 0.95)
"""Central intervals whose coverage is told [1]."""

FAR = 0.1
"""Distance of an instant from the nearest reading, over how far ahead it was, up to which its
truth is known [1]; one step between readings is near in any case. Source: a tenth of the way is
little beside the eighth to the whole of the horizon at which the instants lie."""


class Truth(NamedTuple):
    """One quantity as later readings show it: its smoothed level and the error of that."""

    time: Float[np.ndarray, " time"]
    level: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True)
class IntervalCoverage:
    """How often a central interval held.

    Parameters
    ----------
    stated
        Its probability [1].
    count, held
        Decided statements, and those whose interval held the truth.
    lo, hi
        95 % interval of the probability that it holds [1].
    """

    stated: float
    count: int
    held: int
    lo: float
    hi: float


@dataclasses.dataclass(frozen=True, slots=True)
class QuantityScore:
    """What came of the bands of one quantity."""

    coverage: tuple[IntervalCoverage, ...]
    widening: Widening


@dataclasses.dataclass(frozen=True, slots=True)
class Decided:
    """A threshold statement whose horizon has passed."""

    stated: float
    came_true: bool
    begin: float
    end: float
    quantity: str
    threshold: float


@dataclasses.dataclass(frozen=True, slots=True)
class Verification:
    """Scores of the statements of a twin.

    Parameters
    ----------
    quantities
        Of each, the coverage of its bands.
    decided
        Threshold statements whose horizon has passed.
    classes
        These by stated probability.
    brier
        Mean squared error of their probabilities [1]; None where there are none.
    effective
        Independent statements that they are worth [1].
    """

    quantities: Mapping[str, QuantityScore]
    decided: tuple[Decided, ...]
    classes: tuple[StatementClass, ...]
    brier: float | None
    effective: float


def is_due(sequence: int) -> bool:
    """Whether an outlook is kept at the reading of a sequence number.

    Eight are kept while the number of readings doubles, at most one every `LONGEST` readings:
    what a forecast knows grows with its past, not with each reading.

    Examples
    --------
    >>> [n for n in range(60) if is_due(n)]
    [16, 18, 20, 22, 24, 26, 28, 30, 32, 36, 40, 44, 48, 52, 56]
    """
    step = min(2 ** max(sequence.bit_length() - 4, 0), LONGEST)
    return sequence >= FIRST and sequence % step == 0


def state_outlook(
    prospect: ForecastState, horizon: float | None, thresholds: Sequence[Limit]
) -> dict[str, Any]:
    """Make the statement of a twin as of its last reading.

    Parameters
    ----------
    prospect
        State after the reading, with the factors by which its futures are told wider.
    horizon
        How far ahead, in slow time; None for as long as the history that is used.
    thresholds
        Limits of which is stated with which probability they are reached.
    """
    since = prospect.since
    end = since + (horizon or since - prospect.first)
    ahead = since + (end - since) * np.array(FRACTIONS)
    quantities, told = {}, {}
    for name, laws in prospect.laws.items():
        bare = futures_of(laws, 0.0, end)
        at = np.clip(np.searchsorted(bare.later, ahead - 1e-9 * (end - since)), 0, None)
        quantities[name] = {
            "instants": bare.later[at].tolist(),
            "quantiles": np.quantile(bare.paths[:, at], LEVELS, axis=0).T.tolist(),
            "widening": prospect.widening.get(name, 1.0),
        }
        if any(limit.quantity == name for limit in thresholds):
            told[name] = prospect.futures(name, end)
    crossings = []
    for limit in thresholds:
        if limit.quantity in told:
            drawn = told[limit.quantity]
            life = drawn.crossing(limit.at, toward=limit.toward)
            falls = float(np.median(drawn.paths[:, 0])) > limit.at
            crossings.append(
                {
                    "quantity": limit.quantity,
                    "threshold": limit.at,
                    "toward": limit.toward or ("below" if falls else "above"),
                    "within": life.within,
                    "already": life.already,
                }
            )
    return {"since": since, "horizon": end, "quantities": quantities, "crossings": crossings}


def truth_of(past: Mapping[str, Past]) -> dict[str, Truth]:
    """Smooth each quantity over all of its readings."""
    found = {}
    for name, one in past.items():
        usable = np.isfinite(one.value) & np.isfinite(one.own_sd) & (one.own_sd > 0.0)
        order = np.argsort(one.slow_time[usable], kind="stable")
        time, value, sd = (
            each[usable][order] for each in (one.slow_time, one.value, one.own_sd)
        )
        if len(time):
            found[name] = Truth(time, *verification.smoothed_level(time, value, sd))
    return found


def verify(
    statements: Sequence[Mapping[str, Any]],
    truth: Mapping[str, Truth],
    interrupted: Sequence[float] = (),
) -> Verification:
    """Compare statements with what came.

    A threshold statement counts once its horizon has passed, also where the threshold was
    reached before: else those that came true would be counted sooner than the others.

    Parameters
    ----------
    statements
        Of `state_outlook`, in the order of time.
    truth
        Of `truth_of`, as far as is known.
    interrupted
        Slow times at which the structure was renewed or repaired: no statement from before is
        about what follows.
    """
    quantities = {
        name: _quantity_score(name, statements, known, interrupted)
        for name, known in truth.items()
    }
    decided = tuple(_decided(statements, truth, interrupted))
    if not decided:
        return Verification(quantities, (), (), None, 0.0)
    stated, came, begin, end = (
        np.array([getattr(one, part) for one in decided])
        for part in ("stated", "came_true", "begin", "end")
    )
    return Verification(
        quantities,
        decided,
        tuple(verification.reliability(stated, came, begin, end)),
        float(np.mean((stated - came) ** 2)),
        verification.effective_number(begin, end),
    )


def told_quantiles(stated: Mapping[str, Any]) -> Float[np.ndarray, "instant level"]:
    """Quantiles of one quantity as they were told: as much wider as its futures were."""
    bare = np.array(stated["quantiles"])
    middle = bare[:, len(LEVELS) // 2, None]
    return np.asarray(middle + stated["widening"] * (bare - middle))


def _quantity_score(
    name: str,
    statements: Sequence[Mapping[str, Any]],
    truth: Truth,
    interrupted: Sequence[float],
) -> QuantityScore:
    score, error, factor, begin, end = [], [], [], [], []
    for one in statements:
        stated = one["quantities"].get(name)
        for at, quantiles in zip(*_instants(stated), strict=True):
            known = _known(truth, one["since"], at, interrupted)
            spread = verification.spread_of(quantiles)
            if known is None or spread <= 0.0:
                continue
            score.append(verification.normal_score(quantiles, known[0]))
            error.append(known[1] / spread)
            factor.append(stated["widening"])
            begin.append(one["since"])
            end.append(at)
    effective = verification.effective_number(np.array(begin), np.array(end))
    z, r, f = np.array(score), np.array(error), np.array(factor)
    widening = verification.widening_of(z, r, effective)
    told = np.abs(z) / np.hypot(f, r)
    return QuantityScore(
        tuple(_coverage(told, level, effective) for level in INTERVALS), widening
    )


def _instants(stated: Mapping[str, Any] | None) -> tuple[Sequence[float], np.ndarray]:
    if stated is None:
        return (), np.empty((0, len(LEVELS)))
    return stated["instants"], np.array(stated["quantiles"])


def _coverage(told: np.ndarray, level: float, effective: float) -> IntervalCoverage:
    held = int(np.sum(told <= verification.half_width(level)))
    lo, hi = 0.0, 1.0
    if len(told):
        lo, hi = verification.binomial_interval(held / len(told), effective)
    return IntervalCoverage(level, len(told), held, lo, hi)


def _known(
    truth: Truth, since: float, at: float, interrupted: Sequence[float]
) -> tuple[float, float] | None:
    """Level and its error at an instant; None where they are not known."""
    if at > truth.time[-1] or any(since < when <= at for when in interrupted):
        return None
    step = float(np.median(np.diff(truth.time))) if len(truth.time) > 1 else 0.0
    if float(np.min(np.abs(truth.time - at))) > max(FAR * (at - since), step):
        return None
    level, sd = (float(np.interp(at, truth.time, each)) for each in truth[1:])
    return level, sd


def _decided(
    statements: Sequence[Mapping[str, Any]],
    truth: Mapping[str, Truth],
    interrupted: Sequence[float],
) -> list[Decided]:
    found = []
    for one in statements:
        begin, end = one["since"], one["horizon"]
        for stated in one["crossings"]:
            known = truth.get(stated["quantity"])
            if known is None or stated["already"] > 0.5:
                continue
            if _known(known, begin, end, interrupted) is None:
                continue
            within = (known.time > begin) & (known.time <= end)
            side = 1.0 if stated["toward"] == "above" else -1.0
            passed = bool(np.any(side * (known.level[within] - stated["threshold"]) >= 0.0))
            found.append(
                Decided(
                    stated["within"],
                    passed,
                    begin,
                    end,
                    stated["quantity"],
                    stated["threshold"],
                )
            )
    return found


__all__ = [
    "KEPT",
    "Decided",
    "QuantityScore",
    "Truth",
    "Verification",
    "is_due",
    "state_outlook",
    "told_quantiles",
    "truth_of",
    "verify",
]
