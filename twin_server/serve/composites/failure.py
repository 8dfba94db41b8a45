"""Failure probability of a twin within a horizon, as a composite needs it of each member.

It is one function, so that another source, such as limit states with a remaining life, can
take its place.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from scipy.special import betaincinv, ndtri

from twin_server.composites.composite import Failing
from twin_server.registration.thresholds import Limit
from twin_server.registration.twin import Registration
from twin_server.serve.knowledge import Knowledge

PATHS = 2000
"""Futures that a forecast draws: the probability of a crossing is a share of so many."""

LEVEL = 0.95
"""Share that the band of a probability holds."""


class Failure(NamedTuple):
    """Failure probability of a twin.

    Parameters
    ----------
    value
        NaN where nothing is known.
    lo, hi
        Ends of the 95 % band; 0 and 1 where nothing is known.
    reasons
        Why it should not be relied on, in sentences; none where it can.
    horizon
        How far ahead was looked, in slow time; None where nothing is known.
    since
        Slow time of the last reading; None where nothing is known.
    unit
        Of slow time.
    """

    value: float
    lo: float
    hi: float
    reasons: tuple[str, ...] = ()
    horizon: float | None = None
    unit: str | None = None
    since: float | None = None


def unknown(*reasons: str, unit: str | None = None) -> Failure:
    """Return the result if nothing is known: any probability from 0 to 1."""
    return Failure(math.nan, 0.0, 1.0, reasons, None, unit)


def failure_probability(
    knowledge: Knowledge,
    twin_id: str,
    horizon: float | None,
    failing: Failing | None = None,
) -> Failure:
    """Probability that a twin fails within a horizon, or has already.

    It fails by `failing`, else by the limit states of its registration (docs/risk.md). Without
    either it fails at thresholds: those under `forecast` in the registration, else the limits
    of its alarms. Of several on one side of a quantity the one that is reached first counts.
    Different quantities are taken for independent in the value; the band holds for any
    dependence of them. It covers the sampling of the forecast's futures; what the forecast
    itself does not know is in the probability.

    Parameters
    ----------
    horizon
        How far ahead, in slow time; None for that of the twin's forecast.
    """
    registration = knowledge.registration(twin_id)
    if registration is None:
        return unknown(f"{twin_id} is not registered any more.")
    if failing is None and registration.limit_states:
        return _of_limit_states(knowledge.risk(twin_id, horizon), twin_id)
    limits = _limits(registration, failing)
    if not limits:
        return unknown(
            f"{twin_id} has no failure threshold. Give `failing` in the composite, or "
            "limit_states in its registration."
        )
    outlook = knowledge.outlook(twin_id, horizon, 2, limits)
    if outlook is None:
        return unknown(f"{twin_id} has too few valid readings to forecast from.")
    found: dict[tuple[str, str | None], float] = {}
    ahead = math.nan
    for limit, life in outlook.crossings:
        side = limit.quantity, limit.toward
        found[side] = max(found.get(side, 0.0), life.within, life.already)
        ahead = life.horizon - outlook.since
    if not found:
        names = ", ".join(sorted({limit.quantity for limit in limits}))
        return unknown(f"{twin_id} does not estimate {names}.", unit=outlook.unit)
    value, lo, hi = _any_of([(p, *interval(p)) for p in found.values()])
    reasons = tuple(f"{twin_id}: {reason}" for reason in outlook.reasons)
    return Failure(value, lo, hi, reasons, ahead, outlook.unit, outlook.since)


def _of_limit_states(risk: Mapping[str, Any], twin_id: str) -> Failure:
    """Probability of failure by any limit state up to the horizon, from the risk."""
    told = [
        *risk["reasons"],
        *(text for one in risk["limit_states"] for text in one["reasons"]),
    ]
    reasons = tuple(f"{twin_id}: {reason}" for reason in dict.fromkeys(told))
    within = [one["within"] for one in risk["limit_states"]]
    if risk["since"] is None or not within or None in within:
        return unknown(*(reasons or (f"{twin_id} has no failure probability yet.",)))
    value, lo, hi = _any_of([_widened(**one) for one in within])
    ahead = risk["horizon"] - risk["since"]
    return Failure(value, lo, hi, reasons, ahead, risk["slow_time_unit"], risk["since"])


def _widened(value: float, lo: float, hi: float) -> tuple[float, float, float]:
    """Turn a 90 % band into one of 95 %, as if its halves were normal."""
    wider = ndtri(0.5 + LEVEL / 2.0) / ndtri(0.95)
    low, high = value - wider * (value - lo), value + wider * (hi - value)
    return value, max(0.0, min(low, value)), min(1.0, max(high, value))


def _any_of(parts: Sequence[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Value of independent parts of which one suffices; a band for any dependence of them."""
    value = 1.0 - math.prod(1.0 - p for p, _, _ in parts)
    lo, hi = max(lo for _, lo, _ in parts), min(1.0, sum(hi for _, _, hi in parts))
    return value, min(lo, value), max(hi, value)


def interval(share: float, count: int = PATHS) -> tuple[float, float]:
    """Jeffreys' 95 % interval of a probability of which `share` of `count` draws were seen.

    Parameters
    ----------
    share
        Share of draws that failed [1].
    count
        Number of draws.

    Returns
    -------
    Lower and upper end [1].

    Examples
    --------
    >>> [round(end, 5) for end in interval(0.0)]
    [0.0, 0.00126]
    """
    seen = round(share * count)
    low, high = 0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0
    belief = seen + 0.5, count - seen + 0.5
    lo = 0.0 if seen == 0 else float(betaincinv(*belief, low))
    hi = 1.0 if seen == count else float(betaincinv(*belief, high))
    return min(lo, share), max(hi, share)


def _limits(registration: Registration, failing: Failing | None) -> list[Limit]:
    """Thresholds of failure, each with the side on which an unchanged structure fails."""
    if failing is not None:
        given = [Limit(failing.quantity, failing.at)]
    else:
        every = registration.thresholds()
        asked = [limit for limit in every if limit.toward is None]
        given = asked or list(every)
    return [
        limit if limit.toward else limit._replace(toward="below" if limit.at < 0 else "above")
        for limit in given
    ]
