"""The report on a maintenance plan, made of the answer of `GET /twins/{id}/plan`."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from slowtime_services.reports.first_page import (
    Alternative,
    Confidence,
    FirstPage,
    subject_of,
)
from slowtime_services.reports.page import Chart, Section, Table, write_page
from slowtime_services.reports.words import Words

from .plan_options import option_words, unit_of

Answer = Mapping[str, Any]

NEAR = 0.1
"""Share of the least cost [1] by which an option may cost more and still stand beside the
answer. Source: costs that owners state are seldom known better."""

SAME = 1e-3
"""Share of the least cost [1] below which two options cost the same: less than is printed."""

DRAWN = 4
"""Options whose costs are drawn [1]: more cannot be told apart."""

LETTERS = "ABCD"
"""Names of the curves, which the caption explains: options are sentences, and no legend of a
first page has room for four."""

ALWAYS_TOLD = ("failure", "repair", "inspection")
"""Costs that are told though they are 0: a reader would look for them."""

OFFLINE = "offline.record"
"""Twin of a file that names none."""

MOST_BESIDE = 3
"""Options beside the answer [1]; the table below has all."""

HOUR_S = 3600.0
"""Seconds of a unit of time above which instants are told by date [s], as the page does."""

ROUNDING = 1e-9
"""Share of the largest cost [1] below which an amount is written as 0: what sums round off."""

COLOURS = ("#0b6fb8", "#b3541e", "#2f8f5b", "#7a5ba6")


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
    picture = _picture(plan, words) if plan["options"] else None
    write_page(
        path, f"{words('kind.plan')}: {first.subject}", first.answer, list(_sections(plan)),
        first=first, picture=picture, language=language,
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
            answer=words("plan.act.none", reason=plan["sentence"]),
            measured=words("measured.unknown"),
            confidence=Confidence("low", ""),
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
    """Write what counts as a failure, and how probable it is without a repair."""
    failure = plan["failure"]
    return (
        words(
            f"plan.failure_{failure['toward']}",
            quantity=_quantity(failure["quantity"], words),
            limit=words.percent(failure["threshold"]),
            now=words.probability(failure["already"]),
            within=words.probability(failure["within"]),
            horizon=_span(plan, plan["horizon"]["ahead"], words),
        )
        + f" {words('plan.counted')}"
    )


def _quantity(name: str, words: Words) -> str:
    known = {"stiffness_change": "plan.stiffness", "mass_change": "plan.mass"}
    return words(known[name]) if name in known else name.replace("_", " ")


def _span(plan: Answer, time: float, words: Words) -> str:
    return f"{words.number(time)} {unit_of(plan, words)}"


def _is_dated(plan: Answer) -> bool:
    return plan["seconds"] is not None and plan["seconds"] > HOUR_S


def _moment(plan: Answer, time: Answer, words: Words) -> str:
    span = _span(plan, time["ahead"], words)
    if time["t"] is None or not _is_dated(plan):
        return words("plan.ahead", span=span)
    return words("plan.dated", date=time["t"][:10], span=span)


def _money(plan: Answer, amount: float, words: Words) -> str:
    rounded = float(f"{amount:.3g}")
    text = words.number(rounded) if abs(rounded) < 1000 else f"{rounded:,.0f}"
    if abs(rounded) >= 1000:
        text = text.replace(",", "." if words.language == "de" else ",").replace("-", "−")
    return f"{text} {plan['currency']}"


def _answer(plan: Answer, words: Words) -> str:
    last, act = plan["last_order"], plan["action"]
    if act == "repair" and last["lead_time"] > 0:
        act = "order"
    best, apart = plan["options"][0], plan["difference"]
    if act == "undecided" and abs(apart["value"]) <= SAME * abs(best["cost"]["value"]):
        act = "equal"
    compared = ["", ""] if apart is None else _compared(plan, words)
    said = [words(f"plan.act.{act}", best=compared[0], other=compared[1])]
    if last["status"] == "due":
        said.append(words("plan.due", when=_moment(plan, last["order"], words)))
    else:
        said.append(words(f"plan.{last['status']}"))
    horizon = _span(plan, plan["horizon"]["ahead"], words)
    cost = _money(plan, best["cost"]["value"], words)
    if act != "undecided":
        said.append(words("plan.cost", cost=cost, horizon=horizon))
    return " ".join(said)


def _compared(plan: Answer, words: Words) -> list[str]:
    """Name the best option, and the best of those that do something else now."""
    known = {option["words"]: option for option in plan["options"]}
    return [
        option_words(known[name], plan, words) if name in known else name
        for name in (plan["difference"]["best"], plan["difference"]["other"])
    ]


def _confidence(plan: Answer, words: Words) -> Confidence:
    apart = plan["difference"]
    if apart is None:
        return Confidence("high", words("plan.alone"))
    value, lo, hi = (_money(plan, apart[name], words) for name in ("value", "lo", "hi"))
    other = _compared(plan, words)[1]
    told = words("plan.confidence", other=other, value=value, lo=lo, hi=hi)
    level = "high" if apart["lo"] > 0 else "medium" if plan["decided"] else "low"
    return Confidence(level, told)  # type: ignore[arg-type]


def _alternatives(plan: Answer, words: Words) -> Iterator[Alternative]:
    least = plan["options"][0]["cost"]["value"]
    other = None if plan["difference"] is None else plan["difference"]["other"]
    beside = [
        option
        for option in plan["options"][1:]
        if option["cost"]["value"] <= least * (1 + NEAR)
        or (option["words"] == other and not plan["decided"])
    ]
    # The option that does something else now comes first: it is what is to be decided.
    beside.sort(key=lambda option: option["words"] != other)
    for option in beside[:MOST_BESIDE]:
        cost = _money(plan, option["cost"]["value"], words)
        name = option_words(option, plan, words)
        yield Alternative(name, words("plan.expected", cost=cost))


def _actions(plan: Answer, words: Words) -> Iterator[str]:
    last = plan["last_order"]
    if plan["decided"]:
        yield words("plan.do_option", name=option_words(plan["options"][0], plan, words))
    elif plan["difference"] is not None:
        best = _compared(plan, words)[0]
        yield words(
            "plan.do_undecided",
            best=best,
            cost=_money(plan, plan["options"][0]["cost"]["value"], words),
            horizon=_span(plan, plan["horizon"]["ahead"], words),
            value=_money(plan, plan["difference"]["value"], words),
        )
    if last["status"] == "due":
        yield words("plan.do_order", when=_moment(plan, last["order"], words))
    if plan["action"] == "repair" and last["now_effect"] is not None:
        when = _moment(plan, last["now_effect"], words)
        yield words("plan.do_now", when=when, p=words.percent(last["now_probability"], 2))
    first = plan["information"][0] if plan["information"] else None
    if first is not None and first["net"] > 0 and first["cost"] > 0:
        net = _money(plan, first["net"], words)
        yield words("plan.do_inform", name=first["name"], net=net)
    yield words("plan.do_again")


def _facts(plan: Answer, words: Words) -> Iterator[tuple[str, str]]:
    last = plan["last_order"]
    own = unit_of({**plan, "time_unit": "slow_time"}, words)
    since = f"{words.number(plan['since'], 6)} {own}"
    told = plan["times"][0]["t"]
    yield words("facts.since"), f"{since} ({told[:10]})" if told and _is_dated(plan) else since
    yield words("facts.horizon"), _span(plan, plan["horizon"]["ahead"], words)
    yield words("facts.lead"), _span(plan, last["lead_time"], words)
    if plan["months"]:
        yield words("facts.months"), ", ".join(str(month) for month in plan["months"])
    yield words("facts.costs"), "; ".join(_costs(plan, words))
    if last["limit"] is not None:
        yield words("facts.accepted"), words.percent(last["limit"])


PER_TIME = ("downtime", "closed")
"""Costs per unit of time; the others are paid once each."""


def _costs(plan: Answer, words: Words) -> Iterator[str]:
    """Write what failure, actions and inspections cost, each that costs something."""
    for name, one in plan["costs"].items():
        if not isinstance(one, Mapping) or (one["mean"] == 0 and name not in ALWAYS_TOLD):
            continue
        amount = _money(plan, one["mean"], words)
        if one["sd"] > 0:
            amount = amount.replace(
                f" {plan['currency']}", f" ± {_money(plan, one['sd'], words)}"
            )
        per = words(f"plan.per.{plan['time_unit']}") if name in PER_TIME else ""
        yield f"{words(f'plan.item.{name}')} {amount} {per}".rstrip()
    for one in plan["information"]:
        if one["cost"] > 0 and one["kind"] == "readings":
            yield f"{one['name']} {_money(plan, one['cost'], words)}"


def _picture(plan: Answer, words: Words) -> Chart:
    x = [time["ahead"] for time in plan["times"]]
    drawn = plan["options"][:DRAWN]
    traces = [
        {
            "type": "scatter", "mode": "lines", "x": x,
            "name": letter,
            "y": option["curve"],
            "line": {"color": colour, "width": 2.5 if not k else 1.4},
        }
        for k, (option, letter, colour) in enumerate(zip(drawn, LETTERS, COLOURS, strict=False))
    ]  # fmt: skip
    layout = {
        "xaxis": {"title": {"text": words("plan.axis_time", unit=unit_of(plan, words))}},
        "yaxis": {"title": {"text": f"[{plan['currency']}]"}, "rangemode": "tozero"},
    }  # fmt: skip
    named = "; ".join(
        f"{letter}: {option_words(option, plan, words)}"
        for letter, option in zip(LETTERS, drawn, strict=False)
    )
    told = words("plan.picture", currency=plan["currency"])
    return Chart(traces, layout, f"{told} {named}.")


def _amount(amount: float, largest: float) -> str:
    """Write an amount of a table in three digits; what sums round off is nothing."""
    rounded = 0.0 if abs(amount) < ROUNDING * largest else float(f"{amount:.3g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 1000 else f"{rounded:.3g}"


def _cost_table(plan: Answer) -> Table:
    """List every cost and time that the plan counts."""
    costs, english = plan["costs"], Words()
    unit, per = unit_of(plan, english), english(f"plan.per.{plan['time_unit']}")
    rows = []
    for name, one in costs.items():
        title = english(f"plan.item.{name}")
        if one is None:
            rows.append((title, "–", "", "not on offer"))
        elif isinstance(one, Mapping):
            each = f"{plan['currency']} {per}" if name in PER_TIME else plan["currency"]
            rows.append((title, f"{one['mean']:,.6g}", f"{one['sd']:,.6g}", each))
        elif name == "discount_rate":
            rows.append((title, f"{100 * one:.3g}", "", f"% {per}"))
        else:
            rows.append((title, f"{one:.4g}", "", unit))
    lead = plan["last_order"]["lead_time"]
    rows.append(("from the order of a repair to its effect", f"{lead:.4g}", "", unit))
    months = ", ".join(map(str, plan["months"])) or "every"
    rows.append(("months in which a repair can take effect", months, "", "month of the year"))
    rows += [
        (f"observation: {one['name']}", f"{one['cost']:,.6g}", "", plan["currency"])
        for one in plan["information"]
    ]
    heads = ("item", "value", "standard deviation", "unit")
    return Table(heads, rows, "As the owner registered them.")


def _sections(plan: Answer) -> Iterator[Section]:
    told = [plan["sentence"]]
    if plan["last_order"] is not None:
        told.append(plan["last_order"]["sentence"])
    yield Section("Reasons", [*told, *plan["changes"]])
    if not plan["options"]:
        return
    largest = max(abs(option["cost"]["hi"]) for option in plan["options"])
    rows = [
        (
            option["words"], option["now"],
            *(_amount(option["cost"][part], largest) for part in ("value", "lo", "hi")),
            f"{option['failures']:.2g}",
        )
        for option in plan["options"]
    ]  # fmt: skip
    heads = (
        "option",
        "now",
        "expected cost",
        "9 of 10 futures: from",
        "to",
        "expected failures",
    )
    caption = (
        f"Costs in {plan['currency']} until the horizon. 9 of 10 futures cost between the two "
        "amounts, 1 of 20 less and 1 of 20 more."
    )
    yield Section("Options", (), [Table(heads, rows, caption)])
    yield Section("Costs and times used", (), [_cost_table(plan)])
    worths = [
        (
            one["words"], *(_amount(one[part], largest) for part in ("value", "net")),
            f"{one['changes']:.2g}",
        )
        for one in plan["information"]
    ]  # fmt: skip
    if worths:
        names = ("observation", "value", "net value", "changes the action")
        caption = (
            f"Value and net value in {plan['currency']}: by how much the expected cost falls, "
            "before and after the cost of the observation. The last column is the probability "
            "that it changes the action."
        )
        yield Section("Observations on offer", (), [Table(names, worths, caption)])
