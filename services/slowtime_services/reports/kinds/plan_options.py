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

DIGITS, MOST_DIGITS = 3, 6
"""Digits of an amount [1], and the most that a difference may call for. Source: three are read
at a glance; beyond six, no forecast is as precise."""

SAME_DIFFERENCE = 0.1
"""Relative error [1] up to which a printed difference is the estimated one, where it has no
interval. Source: its first digit is then right."""

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


def day_of(plan: Mapping[str, Any], time: Mapping[str, Any], words: Words) -> str:
    """Write an instant of a plan by its date alone, or by its distance."""
    dated = time["t"] is not None and is_dated(plan)
    return str(time["t"][:10]) if dated else moment_of(plan, time, words)


def money_of(plan: Mapping[str, Any], amount: float, words: Words, digits: int = DIGITS) -> str:
    """Write an amount with its currency."""
    return f"{amount_text(amount, 0.0, words, digits)} {plan['currency']}"


def amount_text(amount: float, largest: float, words: Words, digits: int = DIGITS) -> str:
    """Write an amount in so many digits; what sums round off, of `largest`, is nothing."""
    rounded = 0.0 if abs(amount) < ROUNDING * largest else _rounded(amount, digits)
    return words.whole(rounded, 15) if abs(rounded) >= 1000 else words.number(rounded, digits)


def _rounded(amount: float, digits: int) -> float:
    return float(f"{amount:.{digits}g}")


def cost_digits(plan: Mapping[str, Any]) -> int:
    """Digits of the options' costs with which their printed difference is the estimated one.

    It is where it lies in the interval of the difference, or within a tenth of one that has
    none.
    """
    apart = plan["difference"]
    pair = None if apart is None else _compared_costs(plan)
    if pair is None:
        return DIGITS
    wide = 0.0 if apart["lo"] < apart["hi"] else SAME_DIFFERENCE * abs(apart["value"])
    for digits in range(DIGITS, MOST_DIGITS):
        shown = _rounded(pair[1], digits) - _rounded(pair[0], digits)
        if apart["lo"] - wide <= shown <= apart["hi"] + wide:
            return digits
    return MOST_DIGITS


def _compared_costs(plan: Mapping[str, Any]) -> tuple[float, float] | None:
    """Costs of the best option and of the best that does something else now."""
    known = {one["words"]: float(one["cost"]["value"]) for one in plan["options"]}
    best, other = (known.get(plan["difference"][name]) for name in ("best", "other"))
    return None if best is None or other is None else (best, other)


def cost_of(plan: Mapping[str, Any], option: Mapping[str, Any], words: Words) -> str:
    """Write the expected cost of an option."""
    return money_of(plan, option["cost"]["value"], words, cost_digits(plan))


def more_than_best(plan: Mapping[str, Any], option: Mapping[str, Any], words: Words) -> str:
    """Write by how much an option costs more than the best, as the printed costs differ."""
    return _difference(
        plan, plan["options"][0]["cost"]["value"], option["cost"]["value"], words
    )


def difference_of(plan: Mapping[str, Any], words: Words) -> str:
    """Write the difference of the two compared options, as their printed costs differ."""
    pair = _compared_costs(plan)
    if pair is None:
        return money_of(plan, plan["difference"]["value"], words)
    return _difference(plan, *pair, words)


def _difference(plan: Mapping[str, Any], best: float, other: float, words: Words) -> str:
    digits = cost_digits(plan)
    apart = _rounded(other, digits) - _rounded(best, digits)
    return money_of(plan, apart, words, MOST_DIGITS)
