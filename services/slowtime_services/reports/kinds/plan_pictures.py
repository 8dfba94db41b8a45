"""Charts of a plan: what fails over time with its limit, and what the options cost."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from slowtime_services.reports.contents import Chart
from slowtime_services.reports.words import Words

from .plan_options import instant_at, is_dated, moment_of, option_words, quantity_in, unit_of

Answer = Mapping[str, Any]
Trace = dict[str, Any]

DRAWN = 4
"""Options whose costs are drawn [1]: more cannot be told apart."""

LETTERS = "ABCD"
"""Names of the curves, which the caption explains: options are sentences, and no legend has
room for four."""

COLOURS = ("#0b6fb8", "#b3541e", "#2f8f5b", "#7a5ba6")
READ, AHEAD, LIMIT, DATE = "#5b6770", "#0b6fb8", "#b3261e", "#2f8f5b"

BEYOND = 1.4
"""Multiple of the limit [1] at which the axis of what fails ends: futures of a structure that
has failed would flatten all before it."""

ROOM = 0.06
"""Room above and below what is drawn, over its height [1]."""

TOP, BOTTOM = (0.99, "top"), (0.02, "bottom")
"""Heights of labels over that of the chart [1], and the side from which they are counted."""

DONE, ORDERED = ("repair_now", "close_until_repair"), ("repair_at",)
INSPECTED, DECIDED = ("inspect_now", "inspect_at"), ("read_on",)


class Mark(NamedTuple):
    """An instant that the picture marks, ahead of the last reading, and what it is.

    `label` stands beside its line, `told` in the caption.
    """

    ahead: float
    label: str
    told: str
    dash: str


def change_chart(plan: Answer, words: Words) -> Chart | None:
    """Draw readings, forecast and limit of what fails, and the dates of what is to be done.

    None where the answer has no readings, as from an older server.
    """
    if not plan.get("history") or not plan.get("outlook"):
        return None
    limit, quantity = 100.0 * plan["failure"]["threshold"], quantity_in(plan, words)
    marks = list(_marks(plan, words))
    low, high = _range(plan, limit)
    first = plan["history"][0]["ahead"]
    span = plan["horizon"]["ahead"] - first
    layout = {
        "xaxis": {
            "title": {"text": words("plan.axis_time", unit=unit_of(plan, words))},
            "range": [first - ROOM * span / 2, plan["horizon"]["ahead"]],
        },
        "yaxis": {
            "title": {"text": words("plan.axis_change", quantity=quantity)},
            "range": [low, high],
        },
        "shapes": [_upright(mark) for mark in marks],
        "annotations": list(_labels(marks, first + span / 2, falls=limit < 0.0)),
    }
    told = words("plan.picture_change", quantity=quantity, limit=words.number(limit))
    if marks:
        told += " " + words("plan.picture_dates", dates="; ".join(one.told for one in marks))
    return Chart(list(_traces(plan, limit, words)), layout, told)


def _traces(plan: Answer, limit: float, words: Words) -> Iterator[Trace]:
    x = [time["ahead"] for time in plan["times"]]
    lo, mid, hi = (
        [100.0 * one[part] for one in plan["outlook"]] for part in ("lo", "value", "hi")
    )
    line: Trace = {"type": "scatter", "mode": "lines"}
    yield line | {
        "x": [*x, *x[::-1]], "y": [*hi, *lo[::-1]], "fill": "toself", "line": {"width": 0},
        "fillcolor": "rgba(11, 111, 184, 0.22)", "hoverinfo": "skip",
        "name": words("plan.line_band"),
    }  # fmt: skip
    yield line | {"x": x, "y": mid, "name": words("plan.line_median"), "line": {"color": AHEAD}}
    yield {
        "type": "scatter", "mode": "markers", "name": words("plan.line_read"),
        "x": [one["ahead"] for one in plan["history"]],
        "y": [100.0 * one["value"] for one in plan["history"]],
        "error_y": {
            "type": "data", "array": [100.0 * one["sd"] for one in plan["history"]],
            "thickness": 1, "width": 0,
        },
        "marker": {"color": READ, "size": 4},
    }  # fmt: skip
    ends = [plan["history"][0]["ahead"], x[-1]]
    yield line | {
        "x": ends, "y": [limit, limit], "name": words("plan.line_limit"),
        "line": {"color": LIMIT, "width": 2, "dash": "dash"},
    }  # fmt: skip


def _range(plan: Answer, limit: float) -> tuple[float, float]:
    """Give the axis of what fails: all readings, and futures until well beyond the limit."""
    end = BEYOND * limit
    drawn = [0.0, limit]
    for one in plan["history"]:
        drawn += [100.0 * (one["value"] - one["sd"]), 100.0 * (one["value"] + one["sd"])]
    for one in plan["outlook"]:
        for part in ("lo", "hi"):
            value = 100.0 * one[part]
            drawn.append(max(value, end) if limit < 0 else min(value, end))
    room = ROOM * (max(drawn) - min(drawn))
    return min(drawn) - room, max(drawn) + room


def _marks(plan: Answer, words: Words) -> Iterator[Mark]:
    """Give the date of the recommended action, and the last at which an order is in time."""
    when = recommended(plan)
    if when is not None:
        yield _mark(f"plan.mark_{when[0]}", when[1], plan, words, "solid")
    last = plan["last_order"]
    if last["status"] == "due":
        yield _mark("plan.mark_last", last["order"], plan, words, "dot")


def _mark(key: str, time: Mapping[str, Any], plan: Answer, words: Words, dash: str) -> Mark:
    """Mark an instant: by its date beside the line, with the span to it in the caption."""
    whole = moment_of(plan, time, words)
    short = time["t"][:10] if time["t"] is not None and is_dated(plan) else whole
    if time["ahead"] == 0.0:
        whole = short = words("plan.now")
    return Mark(time["ahead"], words(key, when=short), words(key, when=whole), dash)


def recommended(plan: Answer) -> tuple[str, Mapping[str, Any]] | None:
    """Give what the best option does first, and when; None where it does nothing on a date."""
    best = plan["options"][0]
    given, name = best["parameters"], best["name"]
    if name == "close":
        return "close", instant_at(plan, 0.0)
    for kind, names, key in (
        ("repair", DONE, "at"), ("order", ORDERED, "order"),
        ("inspect", INSPECTED, "at"), ("decide", DECIDED, "at"),
    ):  # fmt: skip
        if name in names and key in given:
            return kind, instant_at(plan, given[key])
    median = best["repair"][1] if best["repair"] else None
    return None if median is None else ("expected", median)


def _upright(mark: Mark) -> Trace:
    line = {"color": DATE, "width": 2, "dash": mark.dash}
    return {
        "type": "line", "x0": mark.ahead, "x1": mark.ahead, "y0": 0, "y1": 1,
        "yref": "paper", "line": line,
    }  # fmt: skip


def _labels(marks: Sequence[Mark], middle: float, *, falls: bool) -> Iterator[Trace]:
    """Write the first label to the left of its line, where nothing is read; the last beside it.

    `falls` says whether what fails falls: readings are above then, else below.
    """
    ranked = sorted(marks, key=lambda mark: mark.ahead)
    free, other = (BOTTOM, TOP) if falls else (TOP, BOTTOM)
    for mark in ranked:
        first = len(ranked) > 1 and mark is ranked[0]
        height, anchor = free if first else other
        yield {
            "x": mark.ahead, "y": height, "yref": "paper", "yanchor": anchor,
            "xanchor": "left" if not first and mark.ahead < middle else "right",
            "text": mark.label, "showarrow": False, "font": {"size": 11, "color": DATE},
        }  # fmt: skip


def cost_chart(plan: Answer, words: Words) -> Chart:
    """Draw the expected cost of the cheapest options up to each time."""
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
        "yaxis": {
            "title": {"text": words("plan.axis_cost", currency=plan["currency"])},
            "rangemode": "tozero", "exponentformat": "none", "separatethousands": True,
        },
    }  # fmt: skip
    named = "; ".join(
        f"{letter}: {option_words(option, plan, words)}"
        for letter, option in zip(LETTERS, drawn, strict=False)
    )
    told = words("plan.picture", currency=plan["currency"])
    return Chart(traces, layout, f"{told} {named}.")
