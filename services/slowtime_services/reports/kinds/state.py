"""The report on the state of a twin: what has changed since as built, of its epochs."""

import collections
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from scipy.special import ndtr

from slowtime_services.reports.first_page import (
    SURE,
    Alternative,
    Confidence,
    FirstPage,
    level_of,
)
from slowtime_services.reports.page import Chart, Section, Table, write_page
from slowtime_services.reports.words import Words

State = Mapping[str, Any]

ROWS = 60
"""Epochs of the table [1]: about a page."""


def write_state_report(
    path: Path, name: str, states: Sequence[State], changes: str, *, language: str = "en"
) -> None:
    """Write the report of `slowtime evolve`, as HTML or PDF.

    Parameters
    ----------
    states
        Epochs as REST gives them, in order.
    changes
        stiffness, mass or both: what may change.
    """
    words = Words(language)
    first = state_page(name, states, changes, words)
    write_page(
        path, f"{words('kind.state')}: {name}", first.answer, list(_sections(states, changes)),
        first=first, picture=_picture(states, changes, words), language=language,
    )  # fmt: skip


def _wanted(changes: str) -> list[str]:
    return [name for name in ("stiffness", "mass") if changes in (name, "both")]


def state_page(name: str, states: Sequence[State], changes: str, words: Words) -> FirstPage:
    """Give the first page, of the latest epoch."""
    latest, wanted = states[-1], _wanted(changes)
    told = [(each, *_certainty(latest[f"{each}_change"])) for each in wanted]
    least = min((chance for _, _, _, chance in told), default=0.5)
    if not latest["valid"]:
        reason = "; ".join(latest["reasons"])
        confidence = Confidence("low", words("state.not_valid", reason=reason))
    else:
        key = "state.confidence" if least >= SURE else "state.confidence_same"
        told_p = words.percent(min(least, 0.9999), 4)
        confidence = Confidence(level_of(least), words(key, p=told_p))
    return FirstPage(
        kind="state",
        subject=name,
        question=words("state.question", name=name),
        answer=" ".join(_answer(each, value, sd, p, words) for each, value, sd, p in told),
        confidence=confidence,
        actions=list(_actions(latest, least, words)),
        alternatives=list(_alternatives(latest, wanted, words)),
        facts=list(_facts(name, states, words)),
    )


def _certainty(estimate: State | None) -> tuple[float, float, float]:
    """Value, standard deviation and probability of a change in the direction of the value."""
    if estimate is None:
        return math.nan, math.nan, 0.5
    value, sd = float(estimate["value"]), float(estimate["sd"])
    return value, sd, float(ndtr(abs(value) / sd)) if sd > 0 else 0.5


def _answer(name: str, value: float, sd: float, chance: float, words: Words) -> str:
    what = words(f"state.{name}")
    if not math.isfinite(value):
        return words("state.unknown", what=what)
    key = "same" if chance < SURE else "lost" if value < 0 else "gained"
    size = value if key == "same" else abs(value)
    shown = words.number(100 * size, 3)
    return words(f"state.{key}", what=what, size=shown, sd=words.number(100 * sd, 2))


def _actions(latest: State, chance: float, words: Words) -> Iterator[str]:
    for reason in latest["reasons"]:
        yield words("state.do_reason", reason=reason)
    yield words("state.do_inspect" if chance >= SURE else "state.do_wait")


def _alternatives(latest: State, wanted: Sequence[str], words: Words) -> Iterator[Alternative]:
    """Give the change of the other quantity with the same frequency: (1 + k) (1 + m) = 1."""
    if len(wanted) != 1 or latest[f"{wanted[0]}_change"] is None:
        return
    value, sd, _ = _certainty(latest[f"{wanted[0]}_change"])
    other = 1.0 / (1.0 + value) - 1.0
    key = "mass" if wanted[0] == "stiffness" else "stiffness"
    size, error = words.number(100 * other, 3), words.number(100 * sd / (1 + value) ** 2, 2)
    name = words(f"state.alternative_{key}", size=size, sd=error)
    yield Alternative(name, words("state.same_frequency"))


def _facts(name: str, states: Sequence[State], words: Words) -> Iterator[tuple[str, str]]:
    unit = states[-1]["slow_time_unit"] or ""
    invalid = collections.Counter(r for state in states for r in state["reasons"])
    yield words("facts.data"), name
    for key, state in (("facts.from", states[0]), ("facts.until", states[-1])):
        yield words(key), f"{words.number(state['slow_time'], 6)} {unit}".strip()
    yield words("facts.epochs"), str(len(states))
    count = sum(not state["valid"] for state in states)
    reasons = "; ".join(reason for reason, _ in invalid.most_common(2))
    yield words("facts.invalid"), f"{count}{f' ({reasons})' if reasons else ''}"


def _picture(states: Sequence[State], changes: str, words: Words) -> Chart:
    traces: list[dict[str, Any]] = []
    for name, colour in zip(_wanted(changes), ("#0b6fb8", "#b3541e"), strict=False):
        valid = [s for s in states if s["valid"] and s[f"{name}_change"] is not None]
        x = [state["slow_time"] for state in valid]
        of = [state[f"{name}_change"] for state in valid]
        lo, hi = ([100 * (e["value"] + side * e["sd"]) for e in of] for side in (-1.96, 1.96))
        traces += [
            {
                "type": "scatter", "mode": "lines", "x": [*x, *x[::-1]], "y": [*hi, *lo[::-1]],
                "fill": "toself", "line": {"width": 0}, "opacity": 0.3, "hoverinfo": "skip",
                "fillcolor": colour, "showlegend": False,
            },
            {
                "type": "scatter", "mode": "lines+markers", "name": words(f"state.{name}"),
                "x": x, "y": [100 * e["value"] for e in of], "marker": {"size": 4},
                "line": {"color": colour},
            },
        ]  # fmt: skip
    what = ", ".join(words(f"state.{name}") for name in _wanted(changes))
    unit = states[-1]["slow_time_unit"] or "1"
    layout = {
        "xaxis": {"title": {"text": words("state.axis_time", unit=unit)}},
        "yaxis": {"title": {"text": words("state.axis", what=what)}},
        "showlegend": len(_wanted(changes)) > 1,
    }
    return Chart(traces, layout, words("state.picture"))


def _sections(states: Sequence[State], changes: str) -> Iterator[Section]:
    every = max(1, math.ceil(len(states) / ROWS))
    wanted = [f"{name}_change" for name in _wanted(changes)]

    def cell(estimate: State | None, factor: float) -> str:
        if estimate is None:
            return "–"
        return f"{factor * estimate['value']:.4f} ± {factor * estimate['sd']:.4f}"

    rows = [
        (
            f"{state['slow_time']:g}",
            cell(state["frequency_hz"], 1.0),
            *(cell(state[name], 100.0) for name in wanted),
            "yes" if state["valid"] else "no",
        )
        for state in states[::every]
    ]
    heads = (
        "slow time",
        "frequency [Hz]",
        *(f"{name.replace('_', ' ')} [%]" for name in wanted),
        "valid",
    )
    caption = "± is one standard deviation."
    if every > 1:
        caption += f" One of {every} of {len(states)} epochs is shown."
    counts = collections.Counter(reason for state in states for reason in state["reasons"])
    notes = [f"Not valid in {n} of {len(states)}: {why}" for why, n in counts.most_common()]
    yield Section("Epochs", notes, [Table(heads, rows, caption)])
