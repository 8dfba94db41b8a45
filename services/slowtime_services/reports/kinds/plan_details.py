"""Reasons, options, costs and observations of a plan: what follows its first page."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from slowtime_services.reports.contents import Chart, Item, Section, Table
from slowtime_services.reports.words import Words

from .plan_options import (
    ORDERED,
    amount_text,
    cost_digits,
    cost_of,
    difference_of,
    instant_at,
    is_dated,
    last_words,
    moment_of,
    money_of,
    option_words,
    shown_observations,
    span_of,
    unit_of,
)

Answer = Mapping[str, Any]

PER_TIME = ("downtime", "closed")
"""Costs per unit of time; the others are paid once each."""

FAR, MOST_CHANGES = 20.0, 3
"""Break-even costs beyond so many times the given cost, or below its inverse, and more of them
than that, are not told [1], as in the sentences of the answer itself."""

TRIGGERED = ("estimate_threshold", "probability_threshold", "periodic_inspection")
"""Options that repair once something has been read or found, on no fixed date."""

DATED = ("repair_now", "repair_at", "fixed_interval", "age")
"""Options whose time of repair is the decision itself."""

_MORE = re.compile(r"(one|\d+) more readings?")
"""Name that the server gives to further readings of the sensor that is there."""


def plan_sections(plan: Answer, words: Words, costs: Chart | None = None) -> Iterator[Section]:
    """Yield what follows the first page, in the language of `words`.

    `costs` is the chart of the options' costs; None where the first page shows it.
    """
    if not plan["options"]:
        yield Section("Reasons", [plan["sentence"]])
        return
    yield Section("Reasons", list(_reasons(plan, words)), translated=True)
    largest = max(abs(option["cost"]["hi"]) for option in plan["options"])
    digits = cost_digits(plan)
    rows = [
        (
            option_words(option, plan, words),
            words.known(f"plan.now.{option['now']}") or option["now"],
            *(amount_text(option["cost"][part], largest, words, digits) for part in COST_PARTS),
            words.number(option["failures"], 2),
        )
        for option in plan["options"]
    ]
    caption = words("plan.options_caption", currency=plan["currency"])
    shown: list[Item] = [Table(OPTION_HEADS, rows, caption)]
    if costs is not None:
        shown.append(costs)
    yield Section("Options", (), shown, translated=True)
    yield Section("Costs and times used", (), [_cost_table(plan, words)], translated=True)
    if plan["information"]:
        table = _observation_table(plan, largest, words)
        yield Section("Observations on offer", (), [table], translated=True)


def _observation_table(plan: Answer, largest: float, words: Words) -> Table:
    """List the observations of largest net value, and count the others."""
    shown, total = shown_observations(plan), len(plan["information"])
    rows = [
        (
            _observed(one, plan, words),
            *(amount_text(one[part], largest, words) for part in ("value", "net")),
            words.number(one["changes"], 2),
        )
        for one in shown
    ]
    key = "plan.worth_order" if len(shown) == total else "plan.worth_order_some"
    order = words(key, n=len(shown), total=total)
    caption = f"{order} {words('plan.worth_caption', currency=plan['currency'])}"
    return Table(WORTH_HEADS, rows, caption)


COST_PARTS = ("value", "lo", "hi")
OPTION_HEADS = (
    "option", "now", "expected cost", "9 of 10 futures: from", "to", "expected failures",
)  # fmt: skip
WORTH_HEADS = ("observation", "value", "net value", "changes the action")


def observation_name(one: Mapping[str, Any], words: Words) -> str:
    """Name an observation; one that the owner has named by that name, in quotation marks."""
    if one["kind"] != "readings" or not _MORE.fullmatch(one["name"]):
        return words("quoted", name=one["name"])
    key = "plan.one_reading" if one["count"] == 1 else "plan.more_readings"
    return words(key, n=one["count"])


def _observed(one: Mapping[str, Any], plan: Answer, words: Words) -> str:
    name = observation_name(one, words)
    if one["at"]["ahead"] == 0.0:
        return words("plan.at_once", name=name)
    return words("plan.within", name=name, when=moment_of(plan, one["at"], words))


def _reasons(plan: Answer, words: Words) -> Iterator[str]:
    known = {option["words"]: option for option in plan["options"]}

    def named(name: str) -> str:
        return option_words(known[name], plan, words) if name in known else name

    best, apart = plan["options"][0], plan["difference"]
    cost = cost_of(plan, best, words)
    said = [
        words(
            "plan.reason_best", best=option_words(best, plan, words), cost=cost,
            due=_falls_due(best, plan, words),
            horizon=span_of(plan, plan["horizon"]["ahead"], words),
        )
    ]  # fmt: skip
    if apart is not None:
        lo, hi = (money_of(plan, apart[part], words) for part in LOW_HIGH)
        value = difference_of(plan, words)
        other = named(apart["other"])
        if plan["decided"]:
            said.append(words("plan.reason_other", other=other, value=value))
        else:
            said.append(
                words(
                    "plan.reason_undecided",
                    best=named(apart["best"]), other=other, value=value, lo=lo, hi=hi,
                )
            )  # fmt: skip
            said.append(_advice(plan, words))
    yield " ".join(said)
    yield " ".join(_last_order(plan, words))
    if apart is not None:
        near = [one for one in plan["break_even"] if 1 / FAR < one["at"] / one["given"] < FAR]
        for one in near[:MOST_CHANGES]:
            yield words(
                "plan.better_more" if one["at"] > one["given"] else "plan.better_less",
                other=named(apart["other"]), item=words(f"plan.item.{one['item']}"),
                at=money_of(plan, one["at"], words),
                given=money_of(plan, one["given"], words),
            )  # fmt: skip


def _falls_due(best: Answer, plan: Answer, words: Words) -> str:
    """Write when a repair is expected whose time later readings decide; empty for others."""
    if best["repair"] is None or best["now"] == "repair" or best["name"] in DATED:
        return ""
    median = best["repair"][1]
    if median is None:
        return words("plan.never_due")
    when = moment_of(plan, median, words)
    ordered = expected_order(best, plan)
    if ordered is not None:
        order = moment_of(plan, ordered, words)
        return words("plan.falls_due_ordered", order=order, when=when)
    return words("plan.falls_due", when=when)


def expected_order(best: Answer, plan: Answer) -> Mapping[str, Any] | None:
    """Give the median instant of the order of an option's first repair, where it is known."""
    median = None if best["repair"] is None else best["repair"][1]
    lead = plan["last_order"]["lead_time"]
    # Where months are given, a repair may wait for one: its time does not tell the order's.
    if median is None or lead <= 0 or best["name"] not in ORDERED or plan["months"]:
        return None
    return instant_at(plan, max(median["ahead"] - lead, 0.0))


def _advice(plan: Answer, words: Words) -> str:
    """Name the observation that pays most and comes in time for the last safe order."""
    order = plan["last_order"]["order"]
    last = float("inf") if order is None else max(order["ahead"], 0.0)
    for one in plan["information"]:
        if one["net"] > 0.0 and one["at"]["ahead"] <= last:
            return words("plan.reason_advice", observation=_observed(one, plan, words))
    return words("plan.reason_no_advice")


def _last_order(plan: Answer, words: Words) -> Iterator[str]:
    """Write the last safe order, with the limit that it is judged by."""
    last = plan["last_order"]
    chance = words.probability(last["probability"])
    by_cost = last["limit"] is None
    limit = (
        words("plan.by_cost")
        if by_cost
        else words("plan.by_probability", p=words.probability(last["limit"]))
    )
    if last["status"] == "beyond":
        horizon = span_of(plan, plan["horizon"]["ahead"], words)
        yield words("plan.reason_beyond", horizon=horizon, p=chance)
        yield _no_date(plan, words) if by_cost else limit
        return
    if last["status"] == "due":
        spread = ""
        if last["lo"] is not None and last["hi"] is not None:
            lo, hi = (span_of(plan, max(last[end]["ahead"], 0.0), words) for end in LOW_HIGH)
            spread = "" if lo == hi else words("plan.spread", lo=lo, hi=hi)
        when = moment_of(plan, last["order"], words)
        name = last_words(plan, words)
        on = words("plan.on_day" if is_dated(plan) else "plan.on_time")
        yield words("plan.reason_due", last=name, when=when, spread=spread, on=on, p=chance)
    else:
        yield from _passed(plan, words)
    yield limit


LOW_HIGH = ("lo", "hi")


def _no_date(plan: Answer, words: Words) -> str:
    """Tell fixed dates, none of which pays, from triggers, one of which may."""
    names = [option["name"] for option in plan["options"]]
    until = names.index("nothing") if "nothing" in names else 0
    for option in plan["options"][:until]:
        if option["name"] in TRIGGERED:
            nothing = cost_of(plan, plan["options"][until], words)
            cost = cost_of(plan, option, words)
            name = option_words(option, plan, words)
            return words("plan.no_date_but", option=name, cost=cost, nothing=nothing)
    return words("plan.no_date")


def _passed(plan: Answer, words: Words) -> Iterator[str]:
    last = plan["last_order"]
    if last["order"] is None:
        yield words("plan.reason_too_late")
    else:
        yield words("plan.reason_passed", span=span_of(plan, -last["order"]["ahead"], words))
    if last["now_effect"] is None:
        yield words("plan.reason_no_window")
    else:
        when = moment_of(plan, last["now_effect"], words)
        chance = words.probability(last["now_probability"])
        yield words("plan.reason_now", when=when, p=chance)


def _cost_table(plan: Answer, words: Words) -> Table:
    """List every cost and time that the plan counts."""
    unit, per = unit_of(plan, words), words(f"plan.per.{plan['time_unit']}")
    rows = []
    for name, one in plan["costs"].items():
        title = words(f"plan.item.{name}")
        if one is None:
            rows.append((title, "–", "", words("plan.not_offered")))
        elif isinstance(one, Mapping):
            each = f"{plan['currency']} {per}" if name in PER_TIME else plan["currency"]
            mean, sd = (_whole(one[part], words) for part in ("mean", "sd"))
            rows.append((title, mean, sd, each))
        elif name == "discount_rate":
            rows.append((title, words.number(100 * one), "", f"% {per}"))
        else:
            rows.append((title, words.number(one, 4), "", unit))
    lead = words.number(plan["last_order"]["lead_time"], 4)
    rows.append((words("plan.lead_row"), lead, "", unit))
    months = ", ".join(map(str, plan["months"])) or words("plan.every")
    rows.append((words("plan.months_row"), months, "", words("plan.month_unit")))
    for one in shown_observations(plan):
        title = words("plan.observation_row", name=observation_name(one, words))
        rows.append((title, _whole(one["cost"], words), "", plan["currency"]))
    heads = ("item", "value", "standard deviation", "unit")
    return Table(heads, rows, words("plan.costs_caption"))


def _whole(amount: float, words: Words) -> str:
    """Write an amount in up to six digits, thousands apart."""
    return words.whole(amount, 6) if abs(amount) >= 1000 else words.number(amount, 6)
