"""The report on a maintenance plan, made of the answer of `GET /twins/{id}/plan`."""

import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from slowtime_services.reports.first_page import Alternative, Confidence, FirstPage
from slowtime_services.reports.page import Chart, Section, Table, write_page
from slowtime_services.reports.words import Words

Answer = Mapping[str, Any]

NEAR = 0.1
"""Share of the least cost [1] by which an option may cost more and still stand beside the
answer. Source: costs that owners state are seldom known better."""

SAME = 1e-3
"""Share of the least cost [1] below which two options cost the same: less than is printed."""

DRAWN = 4
"""Options whose costs are drawn [1]: more cannot be told apart."""

LETTERS = 40
"""Letters of a line of the legend [1]: as many as a phone is wide."""

MOST_BESIDE = 3
"""Options beside the answer [1]; the table below has all."""

HOUR_S = 3600.0
"""Seconds of a unit of time above which instants are told by date [s], as the page does."""

ROUNDING = 1e-9
"""Share of the largest cost [1] below which an amount is written as 0: what sums round off."""

COLOURS = ("#0b6fb8", "#b3541e", "#2f8f5b", "#7a5ba6")


def write_plan_report(path: Path, plan: Answer, *, language: str = "en") -> None:
    """Write the report of a plan, as HTML or PDF."""
    words = Words(language)
    first = plan_page(plan, words)
    picture = _picture(plan, words) if plan["options"] else None
    write_page(
        path, f"{words('kind.plan')}: {plan['id']}", first.answer, list(_sections(plan)),
        first=first, picture=picture, language=language,
    )  # fmt: skip


def plan_page(plan: Answer, words: Words) -> FirstPage:
    """Give the first page of a plan, or of the reason why there is none."""
    question = words("plan.question", name=plan["id"])
    if not plan["options"]:
        return FirstPage(
            kind="plan",
            subject=plan["id"],
            question=question,
            answer=words("plan.act.none", reason=plan["sentence"]),
            confidence=Confidence("low", ""),
            actions=[words("plan.do_again")],
        )
    return FirstPage(
        kind="plan",
        subject=plan["id"],
        question=question,
        answer=_answer(plan, words),
        confidence=_confidence(plan, words),
        actions=list(_actions(plan, words)),
        alternatives=list(_alternatives(plan, words)),
        facts=list(_facts(plan, words)),
    )


def _span(plan: Answer, time: float, words: Words) -> str:
    return f"{words.number(time)} {_unit(plan, words)}"


def _is_dated(plan: Answer) -> bool:
    return plan["seconds"] is not None and plan["seconds"] > HOUR_S


def _unit(plan: Answer, words: Words) -> str:
    if plan["time_unit"] == "slow_time" and plan["slow_time_unit"]:
        return str(plan["slow_time_unit"])
    return words(f"unit.{plan['time_unit']}")


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
    said = [words(f"plan.act.{act}")]
    if last["status"] == "due":
        said.append(words("plan.due", when=_moment(plan, last["order"], words)))
    else:
        said.append(words(f"plan.{last['status']}"))
    horizon = _span(plan, plan["horizon"]["ahead"], words)
    cost = _money(plan, best["cost"]["value"], words)
    said.append(words("plan.cost", cost=cost, horizon=horizon))
    return " ".join(said)


def _confidence(plan: Answer, words: Words) -> Confidence:
    apart = plan["difference"]
    if apart is None:
        return Confidence("high", words("plan.alone"))
    value, lo, hi = (_money(plan, apart[name], words) for name in ("value", "lo", "hi"))
    told = words("plan.confidence", value=value, lo=lo, hi=hi)
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
        yield Alternative(option["words"], words("plan.expected", cost=cost))


def _actions(plan: Answer, words: Words) -> Iterator[str]:
    last = plan["last_order"]
    if plan["decided"]:
        yield words("plan.do_option", name=plan["options"][0]["words"])
    if last["status"] == "due":
        yield words("plan.do_order", when=_moment(plan, last["order"], words))
    if plan["action"] == "repair" and last["now_effect"] is not None:
        when = _moment(plan, last["now_effect"], words)
        yield words("plan.do_now", when=when, p=words.percent(last["now_probability"], 2))
    best = plan["information"][0] if plan["information"] else None
    if best is not None and best["net"] > 0 and best["cost"] > 0:
        net = _money(plan, best["net"], words)
        yield words("plan.do_inform", name=best["name"], net=net)
    yield words("plan.do_again")


def _facts(plan: Answer, words: Words) -> Iterator[tuple[str, str]]:
    last, failure = plan["last_order"], plan["failure"]
    since = f"{words.number(plan['since'], 6)} {plan['slow_time_unit'] or ''}".strip()
    told = plan["times"][0]["t"]
    yield words("facts.data"), plan["id"]
    yield words("facts.since"), f"{since} ({told[:10]})" if told and _is_dated(plan) else since
    yield words("facts.horizon"), _span(plan, plan["horizon"]["ahead"], words)
    yield words("facts.lead"), _span(plan, last["lead_time"], words)
    sign = "<" if failure["toward"] == "below" else ">"
    limit = words.percent(failure["threshold"])
    yield words("facts.limit"), f"{failure['quantity'].replace('_', ' ')} {sign} {limit}"
    if last["limit"] is not None:
        yield words("facts.accepted"), words.percent(last["limit"])


def _picture(plan: Answer, words: Words) -> Chart:
    x = [time["ahead"] for time in plan["times"]]
    traces = [
        {
            "type": "scatter", "mode": "lines", "x": x,
            "name": "<br>".join(textwrap.wrap(option["words"], LETTERS)),
            "y": option["curve"],
            "line": {"color": colour, "width": 2.5 if not k else 1.4},
        }
        for k, (option, colour) in enumerate(
            zip(plan["options"][:DRAWN], COLOURS, strict=False)
        )
    ]  # fmt: skip
    layout = {
        "xaxis": {"title": {"text": words("plan.axis_time", unit=_unit(plan, words))}},
        "yaxis": {
            "title": {"text": words("plan.axis_cost", currency=plan["currency"])},
            "rangemode": "tozero",
        },
        "legend": {"orientation": "v", "x": 0, "xanchor": "left", "y": -0.4, "yanchor": "top"},
    }  # fmt: skip
    return Chart(traces, layout, words("plan.picture"))


def _amount(amount: float, largest: float) -> str:
    """Write an amount of a table in three digits; what sums round off is nothing."""
    rounded = 0.0 if abs(amount) < ROUNDING * largest else float(f"{amount:.3g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 1000 else f"{rounded:.3g}"


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
    heads = ("option", "now", "expected cost", "5 %", "95 %", "expected failures")
    caption = f"Costs in {plan['currency']} until the horizon; 5 and 95 % over futures."
    yield Section("Options", (), [Table(heads, rows, caption)])
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
