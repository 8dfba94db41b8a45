"""Options of a plan in the words of a report's language."""

import datetime
from collections.abc import Mapping
from typing import Any

from slowtime_services.reports.words import Words

ORDERED = (
    "estimate_threshold", "probability_threshold", "periodic_inspection", "repair_now",
    "repair_at",
)  # fmt: skip
"""Options whose repair is ordered, where it takes effect some time later."""

HOUR_S = 3600.0
"""Seconds of a unit of time above which instants are told by date [s], as the page does."""

ROUNDING = 1e-9
"""Share of the largest cost [1] below which an amount is written as 0: what sums round off."""

MOST_OBSERVATIONS = 5
"""Observations that are listed [1]: as many as can be weighed against each other at once."""

SPANS = ("age", "every", "window", "order", "at")
"""Parameters of an option that are times."""


def unit_of(plan: Mapping[str, Any], words: Words) -> str:
    """Name the unit of the times of a plan; a text file does not state it."""
    if plan["time_unit"] == "slow_time" and plan["slow_time_unit"]:
        own = str(plan["slow_time_unit"])
        return words("unit.units") if own == "units" else own
    return words(f"unit.{plan['time_unit']}")


def option_words(option: Mapping[str, Any], plan: Mapping[str, Any], words: Words) -> str:
    """Name an option by its kind and parameters; as the server names it, if it is a new kind.

    Parameters
    ----------
    option
        Of `plan`, which has the units.
    """
    given = option["parameters"]
    spans = {name: span_of(plan, given[name], words) for name in SPANS if name in given}
    shares = {
        name: words.percent(given[name]) for name in ("damage", "probability") if name in given
    }
    if "damage" in given:
        shares["reading"] = words.percent(given["damage"] * plan["failure"]["threshold"])
    ordered = plan["last_order"]["lead_time"] > 0 and option["name"] in ORDERED
    key = f"plan.option.{option['name']}{'.ordered' if ordered else ''}"
    try:
        return words(key, **spans, **shares)
    except KeyError:  # an option, or a parameter, that this version does not know
        return str(option["words"])


def shown_observations(plan: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Give the observations of largest net value, that first."""
    ranked = sorted(plan["information"], key=lambda one: -one["net"])
    return ranked[:MOST_OBSERVATIONS]


def quantity_in(plan: Mapping[str, Any], words: Words) -> str:
    """Name the quantity that fails; one of an element by its own name."""
    name = str(plan["failure"]["quantity"])
    known = {"stiffness_change": "plan.stiffness", "mass_change": "plan.mass"}
    return words(known[name]) if name in known else name.replace("_", " ")


def has_no_unit(plan: Mapping[str, Any]) -> bool:
    """Whether the times of a plan are slow times whose unit nobody has stated."""
    return plan["time_unit"] == "slow_time" and plan["slow_time_unit"] in (None, "", "units")


def span_of(plan: Mapping[str, Any], time: float, words: Words) -> str:
    """Write a span of a plan's time with its unit."""
    count, unit = words.number(time), unit_of(plan, words)
    single = words.known(f"unit.{plan['time_unit']}.one") if count == "1" else None
    return f"{count} {single or unit}"


def is_dated(plan: Mapping[str, Any]) -> bool:
    """Whether instants of a plan are told by date."""
    return plan["seconds"] is not None and plan["seconds"] > HOUR_S


def moment_of(plan: Mapping[str, Any], time: Mapping[str, Any], words: Words) -> str:
    """Write an instant of a plan by its date, or by its distance from the last reading."""
    span = span_of(plan, time["ahead"], words)
    if time["t"] is None or not is_dated(plan):
        return words("plan.ahead", span=span)
    return words("plan.dated", date=time["t"][:10], span=span)


def instant_at(plan: Mapping[str, Any], ahead: float) -> Mapping[str, Any]:
    """Give a time of a plan with its date, where the calendar is known."""
    first, seconds = plan["times"][0]["t"], plan["seconds"]
    if first is None or seconds is None:
        return {"ahead": ahead, "t": None}
    try:
        at = datetime.datetime.fromisoformat(first) + datetime.timedelta(
            seconds=ahead * seconds
        )
    except OverflowError:  # beyond the year 9999
        return {"ahead": ahead, "t": None}
    return {"ahead": ahead, "t": at.isoformat(timespec="seconds")}


def last_words(plan: Mapping[str, Any], words: Words) -> str:
    """Name the last safe order: a day, or a time where days are too long a unit."""
    return words("plan.last_day" if is_dated(plan) else "plan.last_time")


def money_of(plan: Mapping[str, Any], amount: float, words: Words) -> str:
    """Write an amount in three digits with its currency."""
    return f"{amount_text(amount, 0.0, words)} {plan['currency']}"


def amount_text(amount: float, largest: float, words: Words) -> str:
    """Write an amount in three digits; what sums round off, of `largest`, is nothing."""
    rounded = 0.0 if abs(amount) < ROUNDING * largest else float(f"{amount:.3g}")
    return words.whole(rounded, 15) if abs(rounded) >= 1000 else words.number(rounded)
