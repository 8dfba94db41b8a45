"""The report on a maintenance plan, made of the answer of `GET /twins/{id}/plan`."""

import datetime
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from slowtime_services.reports.first_page import (
    Alternative,
    Confidence,
    FirstPage,
    Level,
    made_at,
    subject_of,
)
from slowtime_services.reports.page import write_page
from slowtime_services.reports.words import MOST_SURE, Words

from .plan_details import PER_TIME, expected_order, observation_name, plan_sections
from .plan_options import (
    cost_of,
    day_of,
    difference_of,
    has_no_unit,
    last_words,
    moment_of,
    money_of,
    more_than_best,
    option_words,
    quantity_in,
    shown_observations,
    span_of,
    unit_of,
)
from .plan_pictures import change_chart, cost_chart

Answer = Mapping[str, Any]

SAME = 1e-3
"""Share of the least cost [1] below which two options cost the same: less than is printed."""

ALWAYS_TOLD = ("failure", "repair", "inspection")
"""Costs that are told though they are 0: a reader would look for them."""

CLOSED_FOR_REPAIR = "close_until_repair"

OFFLINE = "offline.record"
"""Twin of a file that names none."""

MOST_BESIDE = 3
"""Options beside the answer [1]; the table below has all."""


def write_plan_report(
    path: Path, plan: Answer, *, structure: str = "", source: str = "", language: str = "en"
) -> None:
    """Write the report of a plan, as HTML or PDF.

    Parameters
    ----------
    structure
        Name of the structure; as registered, or that of the twin, where empty.
    source
        File of the readings; empty where a server was asked.
    """
    words = Words(language)
    first = plan_page(plan, words, structure=structure, source=source)
    costs = cost_chart(plan, words) if plan["options"] else None
    picture = change_chart(plan, words) if plan["options"] else None
    below = None if picture is None else costs
    write_page(
        path, f"{words('kind.plan')}: {first.subject}", first.answer,
        list(plan_sections(plan, words, below)), first=first, picture=picture or costs,
        language=language,
    )  # fmt: skip


def plan_page(
    plan: Answer, words: Words, *, structure: str = "", source: str = ""
) -> FirstPage:
    """Give the first page of a plan, or of the reason why there is none."""
    of_file = bool(source) and plan["id"] == OFFLINE
    subject = structure or plan.get("name") or ("" if of_file else plan["id"])
    subject = subject_of(subject, source, words)
    question = words("plan.question", name=subject)
    if not plan["options"]:
        return FirstPage(
            kind="plan",
            subject=subject,
            question=question,
            answer=words("plan.act.none", reason=words.reason(plan["sentence"])),
            measured=words("measured.unknown"),
            confidence=Confidence("low", "", words("confidence.none")),
            actions=[words("plan.do_again")],
        )
    return FirstPage(
        kind="plan",
        subject=subject,
        question=question,
        answer=_answer(plan, words),
        measured=_measured(plan, words),
        definition=_definition(plan, words),
        confidence=_confidence(plan, words),
        actions=list(_actions(plan, words)),
        alternatives=list(_alternatives(plan, words)),
        facts=[(words("facts.data"), source or plan["id"]), *_facts(plan, words)],
    )


def _measured(plan: Answer, words: Words) -> str:
    last = plan["times"][0]["t"]
    return words("measured.until", last=last[:10]) if last else words("measured.unknown")


def _definition(plan: Answer, words: Words) -> str:
    """Write the present state, what counts as a failure, and how probable and near it is."""
    failure, last = plan["failure"], plan["last_order"]
    quantity = quantity_in(plan, words)
    said = []
    now = failure.get("estimate")
    if now is not None:
        told = {"quantity": quantity, "condition": _condition(plan, words)}
        said.append(words("plan.present", **told))
    if last["lead_time"] > 0 and last["now_effect"] is not None:
        chance = words.probability(last["now_probability"])
        span = span_of(plan, last["now_effect"]["ahead"], words)
        said.append(words("plan.in_lead", span=span, p=chance))
    said.append(
        words(
            f"plan.failure_{failure['toward']}",
            quantity=quantity,
            limit=words.percent(abs(failure["threshold"])),
            now=words.probability(failure["already"]),
            within=words.probability(failure["within"]),
            horizon=span_of(plan, plan["horizon"]["ahead"], words),
        )
    )
    key = "plan.counted_bare" if has_no_unit(plan) else "plan.counted"
    said.append(words(key, instant=_last_reading(plan, words)))
    return " ".join(said)


def _condition(plan: Answer, words: Words) -> str:
    """Write what a change read from a frequency supposes; empty for one of an element."""
    known = {"stiffness_change": "plan.if_stiffness", "mass_change": "plan.if_mass"}
    quantity = plan["failure"]["quantity"]
    return words(known[quantity]) if quantity in known else ""


def _last_reading(plan: Answer, words: Words) -> str:
    """Write the instant of the last reading, in slow time and by the calendar if known."""
    own = unit_of({**plan, "time_unit": "slow_time"}, words)
    since, told = f"{words.number(plan['since'], 6)} {own}", plan["times"][0]["t"]
    if not told:
        return since
    date = f"{told[:16].replace('T', ' ')} UTC"
    # Seconds since 1970 tell nobody more than their date.
    return date if own == "s" else f"{since}, {date}"


def _is_gone(plan: Answer) -> bool:
    """Whether the last safe order lies before the instant of the report."""
    order = plan["last_order"]["order"]
    if plan["last_order"]["status"] != "due" or order is None or order["t"] is None:
        return False
    return datetime.datetime.fromisoformat(order["t"]) < made_at()


def _answer(plan: Answer, words: Words) -> str:
    last, act = plan["last_order"], plan["action"]
    if act == "repair" and last["lead_time"] > 0:
        act = "order"
    if act == "close" and plan["options"][0]["name"] == CLOSED_FOR_REPAIR:
        act = "close_for_repair"
    best, apart = plan["options"][0], plan["difference"]
    if act == "undecided" and abs(apart["value"]) <= SAME * abs(best["cost"]["value"]):
        act = "equal"
    compared = ["", ""] if apart is None else _compared(plan, words)
    said = [words(f"plan.act.{act}", best=compared[0], other=compared[1])]
    if last["status"] == "due":
        when = moment_of(plan, last["order"], words)
        said.append(words("plan.due", last=last_words(plan, words), when=when))
        if _is_gone(plan):
            said.append(words("plan.gone"))
    else:
        said.append(words(f"plan.{last['status']}"))
    horizon = span_of(plan, plan["horizon"]["ahead"], words)
    if act != "undecided":
        said.append(words("plan.cost", cost=cost_of(plan, best, words), horizon=horizon))
    said += _present(plan, words)
    return " ".join(said)


def _present(plan: Answer, words: Words) -> Iterator[str]:
    """Write the loss so far beside that which counts as a failure."""
    failure = plan["failure"]
    now = failure.get("estimate")
    if now is not None:
        way = "down" if now["value"] < 0 else "up"
        size, sd = words.measured(100.0 * abs(now["value"]), 100.0 * now["sd"])
        yield words(
            f"plan.head_{way}_{failure['toward']}",
            quantity=quantity_in(plan, words),
            size=size,
            sd=sd,
            limit=words.percent(abs(failure["threshold"])),
        )


def _compared(plan: Answer, words: Words) -> list[str]:
    """Name the best option, and the best of those that do something else now."""
    known = {option["words"]: option for option in plan["options"]}
    return [
        option_words(known[name], plan, words) if name in known else name
        for name in (plan["difference"]["best"], plan["difference"]["other"])
    ]


def _confidence(plan: Answer, words: Words) -> Confidence:
    apart = plan["difference"]
    risk = _risk(plan, words)
    if apart is None:
        return Confidence("high", f"{words('plan.alone')} {risk}")
    lo, hi = (money_of(plan, apart[name], words) for name in ("lo", "hi"))
    exact = money_of(plan, apart["value"], words) == lo == hi
    key = "plan.confidence_exact" if exact else "plan.confidence"
    other, value = _compared(plan, words)[1], difference_of(plan, words)
    told = f"{words(key, other=other, value=value, lo=lo, hi=hi)} {risk}"
    if not plan["decided"]:
        return Confidence("low", told, words("confidence.undecided"))
    level: Level = "high" if apart["lo"] > 0 else "medium"
    return Confidence(level, told, words(f"plan.sure_{_against(plan)}_{level}"))


def _against(plan: Answer) -> str:
    """Name what the best option is compared with: acting, waiting, or another action."""
    now = {option["words"]: option["now"] for option in plan["options"]}
    if plan["options"][0]["now"] == "wait":
        return "wait"
    return "act" if now.get(plan["difference"]["other"]) == "wait" else "other"


def _risk(plan: Answer, words: Words) -> str:
    """Bound the probability of a failure within the horizon if the plan is followed.

    No probability exceeds the expected number of failures (Markov's inequality).
    """
    most, limit = min(plan["options"][0]["failures"], 1.0), plan["last_order"]["limit"]
    bound = words("plan.at_most", p=words.percent(most))
    told = {
        "p": words.probability(most) if most < 1.0 - MOST_SURE else bound,
        "horizon": span_of(plan, plan["horizon"]["ahead"], words),
    }
    if limit is None:
        return words("plan.risk", **told)
    return words("plan.risk_accepted", accepted=words.percent(limit), **told)


def _alternatives(plan: Answer, words: Words) -> Iterator[Alternative]:
    """Give the best option that does something else now and the cheapest others, by cost."""
    other = None if plan["difference"] is None else plan["difference"]["other"]
    beside = sorted(plan["options"][1:], key=lambda option: option["words"] != other)
    for option in sorted(beside[:MOST_BESIDE], key=lambda one: one["cost"]["value"]):
        cost, value = cost_of(plan, option, words), more_than_best(plan, option, words)
        name = option_words(option, plan, words)
        yield Alternative(name, words("plan.expected", cost=cost, value=value))


def _actions(plan: Answer, words: Words) -> Iterator[str]:
    last, best_option = plan["last_order"], plan["options"][0]
    gone = _is_gone(plan)
    if gone:
        yield words("plan.do_read_again")
    in_time = last["status"] == "due" and best_option["name"] == "read_on"
    at_threshold = _waits_for_threshold(plan) and not gone
    if at_threshold:
        yield _order_at_threshold(plan, words)
    elif plan["decided"] and in_time:
        at = span_of(plan, best_option["parameters"]["at"], words)
        yield words("plan.do_read_on", at=at)
    elif plan["decided"]:
        yield words("plan.do_option", name=option_words(plan["options"][0], plan, words))
    elif plan["difference"] is not None and in_time:
        at = span_of(plan, best_option["parameters"]["at"], words)
        yield words("plan.do_read_most", at=at, value=difference_of(plan, words))
    elif plan["difference"] is not None:
        best = _compared(plan, words)[0]
        yield words(
            "plan.do_undecided",
            best=best,
            cost=cost_of(plan, plan["options"][0], words),
            horizon=span_of(plan, plan["horizon"]["ahead"], words),
            value=difference_of(plan, words),
        )
    if last["status"] == "due" and not (gone or in_time or at_threshold):
        yield words("plan.do_order", when=moment_of(plan, last["order"], words))
    orders = plan["action"] == "repair" or best_option["name"] == CLOSED_FOR_REPAIR
    if plan["decided"] and orders and last["now_effect"] is not None:
        when = moment_of(plan, last["now_effect"], words)
        yield words("plan.do_now", when=when, p=words.percent(last["now_probability"], 2))
    first = plan["information"][0] if plan["information"] else None
    if first is not None and first["net"] > 0 and first["cost"] > 0:
        net = money_of(plan, first["net"], words)
        yield words("plan.do_inform", name=observation_name(first, words), net=net)
    if best_option["name"] != "close" and not gone:
        yield words("plan.do_again")


def _waits_for_threshold(plan: Answer) -> bool:
    """Whether a repair is ordered once the estimate reaches a value, before a last day."""
    last, best = plan["last_order"], plan["options"][0]
    ordered = best["name"] == "estimate_threshold" and last["lead_time"] > 0
    return bool(plan["decided"] and ordered and last["status"] == "due")


def _order_at_threshold(plan: Answer, words: Words) -> str:
    """Write one instruction: when to order, when that is expected, and at the latest."""
    best = plan["options"][0]
    order = expected_order(best, plan)
    expected = ""
    if order is not None:
        expected = words("plan.do_order_expected", when=day_of(plan, order, words))
    return words(
        "plan.do_order_at",
        reading=words.percent(best["parameters"]["damage"] * plan["failure"]["threshold"]),
        expected=expected,
        last=moment_of(plan, plan["last_order"]["order"], words),
    )


def _facts(plan: Answer, words: Words) -> Iterator[tuple[str, str]]:
    last = plan["last_order"]
    yield words("facts.since"), _last_reading(plan, words)
    yield words("facts.horizon"), span_of(plan, plan["horizon"]["ahead"], words)
    yield words("facts.lead"), span_of(plan, last["lead_time"], words)
    if plan["months"]:
        yield words("facts.months"), ", ".join(str(month) for month in plan["months"])
    yield words("facts.costs"), "; ".join(_costs(plan, words))
    if last["limit"] is not None:
        accepted = words("plan.accepted", p=words.percent(last["limit"]))
        yield words("facts.accepted"), accepted


def _costs(plan: Answer, words: Words) -> Iterator[str]:
    """Write what failure, actions and inspections cost, each that costs something."""
    for name, one in plan["costs"].items():
        if not isinstance(one, Mapping) or (one["mean"] == 0 and name not in ALWAYS_TOLD):
            continue
        amount = money_of(plan, one["mean"], words)
        if one["sd"] > 0:
            amount = amount.replace(
                f" {plan['currency']}", f" ± {money_of(plan, one['sd'], words)}"
            )
        per = words(f"plan.per.{plan['time_unit']}") if name in PER_TIME else ""
        yield f"{words(f'plan.item.{name}')} {amount} {per}".rstrip()
    for one in shown_observations(plan):
        # A sensor that is not worth its cost is in no option: its price decides nothing.
        if one["cost"] > 0 and one["net"] > 0 and one["kind"] == "readings":
            yield f"{observation_name(one, words)} {money_of(plan, one['cost'], words)}"
