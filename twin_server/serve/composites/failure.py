"""Failure probability of a twin within a horizon: what a composite asks of each member.

It is one function, so that another source, such as limit states with a remaining life, can
take its place.
"""

import math
from typing import NamedTuple

from scipy import stats

from twin_server.composites import Failing
from twin_server.registration import Registration
from twin_server.serve.knowledge import Knowledge
from twin_server.thresholds import Limit

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
    unit
        Of slow time.
    """

    value: float
    lo: float
    hi: float
    reasons: tuple[str, ...] = ()
    horizon: float | None = None
    unit: str | None = None


def unknown(*reasons: str, unit: str | None = None) -> Failure:
    """Give what is known where nothing is: anything from 0 to 1."""
    return Failure(math.nan, 0.0, 1.0, reasons, None, unit)


def failure_probability(
    knowledge: Knowledge,
    twin_id: str,
    horizon: float | None,
    failing: Failing | None = None,
) -> Failure:
    """Probability that a twin passes a failure threshold within a horizon, or has already.

    Thresholds are `failing`, else those under `forecast` in the registration, else the limits
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
    limits = _limits(registration, failing)
    if not limits:
        return unknown(
            f"{twin_id} has no failure threshold. Give `failing` in the composite, or "
            "forecast.thresholds in its registration."
        )
    outlook = knowledge.outlook(twin_id, horizon, 2, limits)
    if outlook is None:
        return unknown(f"{twin_id} has too few valid readings to forecast from.")
    found: dict[tuple[str, str | None], float] = {}
    ahead = math.nan
    for limit, crossing in outlook.crossings:
        side = limit.quantity, limit.toward
        found[side] = max(found.get(side, 0.0), crossing.probability, crossing.already)
        ahead = crossing.horizon - outlook.since
    if not found:
        names = ", ".join(sorted({limit.quantity for limit in limits}))
        return unknown(f"{twin_id} does not estimate {names}.", unit=outlook.unit)
    bands = [interval(p) for p in found.values()]
    value = 1.0 - math.prod(1.0 - p for p in found.values())
    lo = max(lo for lo, _ in bands)
    hi = min(1.0, sum(hi for _, hi in bands))
    reasons = tuple(f"{twin_id}: {reason}" for reason in outlook.reasons)
    return Failure(value, min(lo, value), max(hi, value), reasons, ahead, outlook.unit)


def interval(share: float, count: int = PATHS) -> tuple[float, float]:
    """Jeffreys' 95 % interval of a probability of which `share` of `count` draws were seen.

    Examples
    --------
    >>> [round(end, 5) for end in interval(0.0)]
    [0.0, 0.00126]
    """
    seen = round(share * count)
    low, high = 0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0
    belief = stats.beta(seen + 0.5, count - seen + 0.5)
    lo = 0.0 if seen == 0 else float(belief.ppf(low))
    hi = 1.0 if seen == count else float(belief.ppf(high))
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
