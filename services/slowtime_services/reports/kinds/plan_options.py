"""Options of a plan in the words of a report's language."""

from collections.abc import Mapping
from typing import Any

from slowtime_services.reports.words import Words

ORDERED = (
    "estimate_threshold", "probability_threshold", "periodic_inspection", "repair_now",
    "repair_at",
)  # fmt: skip
"""Options whose repair is ordered, where it takes effect some time later."""

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
    given, unit = option["parameters"], unit_of(plan, words)
    spans = {name: f"{words.number(given[name])} {unit}" for name in SPANS if name in given}
    shares = {
        name: words.percent(given[name]) for name in ("damage", "probability") if name in given
    }
    ordered = plan["last_order"]["lead_time"] > 0 and option["name"] in ORDERED
    key = f"plan.option.{option['name']}{'.ordered' if ordered else ''}"
    try:
        return words(key, **spans, **shares)
    except KeyError:  # an option, or a parameter, that this version does not know
        return str(option["words"])
