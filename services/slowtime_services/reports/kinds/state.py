"""The report on the state of a twin: what has changed against its reference, of its epochs."""

import collections
import dataclasses
import datetime
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from slowtime.evolution.events.change_detection import candidate_jump_times
from slowtime_schemas.slow_times import FIRST_CLOCK_S
from slowtime_services.reports.contents import Chart, Section, Table
from slowtime_services.reports.first_page import (
    LIKELY,
    SURE,
    Alternative,
    Confidence,
    FirstPage,
    level_of,
    measured_on,
    subject_of,
)
from slowtime_services.reports.page import write_page
from slowtime_services.reports.words import Words

State = Mapping[str, Any]


@dataclasses.dataclass(frozen=True, slots=True)
class Reference:
    """State from which changes are counted.

    Parameters
    ----------
    nominal_hz
        Natural frequency that was given [Hz]; None where it was learnt.
    learnt
        Epochs that it was learnt from [1].
    """

    nominal_hz: float | None = None
    learnt: int = 0


UNKNOWN_REFERENCE = Reference()

ROWS = 60
"""Epochs of the table [1]: about a page."""


def write_state_report(
    path: Path,
    name: str,
    states: Sequence[State],
    changes: str,
    *,
    structure: str = "",
    reference: Reference = UNKNOWN_REFERENCE,
    language: str = "en",
) -> None:
    """Write the report of `slowtime twin evolve`, as HTML or PDF.

    Parameters
    ----------
    name
        Of the file of the epochs.
    structure
        Name of the structure; empty where none is known.
    reference
        What the changes are counted from.
    states
        Epochs as REST gives them, in order.
    changes
        stiffness, mass or both: what may change.
    """
    words = Words(language)
    first = state_page(name, states, changes, words, structure=structure, reference=reference)
    write_page(
        path, f"{words('kind.state')}: {first.subject}", first.answer,
        list(_sections(states, changes, words)), first=first,
        picture=_picture(states, changes, words), language=language,
    )  # fmt: skip


def _wanted(changes: str) -> list[str]:
    return [name for name in ("stiffness", "mass") if changes in (name, "both")]


def state_page(
    name: str,
    states: Sequence[State],
    changes: str,
    words: Words,
    *,
    structure: str = "",
    reference: Reference = UNKNOWN_REFERENCE,
) -> FirstPage:
    """Give the first page, of the latest epoch."""
    subject = subject_of(structure, name, words)
    first_ns, last_ns = (state.get("t_ns") for state in (states[0], states[-1]))
    long_s = None if first_ns is None or last_ns is None else (last_ns - first_ns) / 1e9
    latest, wanted = states[-1], _wanted(changes)
    told = [(each, *_certainty(latest[f"{each}_change"])) for each in wanted]
    known = [one for one in told if math.isfinite(one[1])]
    sure = [chance for _, _, _, chance in known if chance >= SURE]
    ratio = _ratio(latest) if len(known) == 2 and not sure else None
    when, since = _when(latest, words), _since(reference, words)
    answers = [_answer(*one, when, since, words) for one in told]
    if of_frequency(latest, changes):
        answers = [
            _answer("frequency", *_of_frequency(*told[0][:3]), when, since, words),
            _conditional(*told[0][:3], words),
        ]
    if not latest["valid"]:
        reason = "; ".join(map(words.reason, latest["reasons"]))
        confidence = Confidence("low", words("state.not_valid", reason=reason))
    elif sure or ratio is not None:
        chance = min(sure) if ratio is None else ratio[2]
        told_p = words.probability(chance)
        way = "lost" if told[0][1] < 0 else "gained"
        of_one = f"state.confidence_{told[0][0]}_{way}"
        key = of_one if len(told) == 1 else "state.confidence"
        confidence = Confidence(level_of(chance), words(key, p=told_p))
    elif any(chance >= LIKELY for _, _, _, chance in known):
        told_p = words.probability(max(chance for _, _, _, chance in known))
        number = words("state.confidence_same", p=told_p)
        confidence = Confidence("medium", number, words("confidence.undecided"))
    elif not known:
        confidence = Confidence("low", "", words("confidence.none"))
    else:
        bounds = [words.number(100 * (abs(v) + 1.96 * sd), 2) for _, v, sd, _ in known]
        within = " / ".join(bounds)
        confidence = Confidence(level_of(SURE), words("state.confidence_bound", most=within))
    definition = f"{_reference(reference, words)} {words('sd')}"
    if ratio is not None:
        parts = {
            name: " ± ".join(words.measured(100 * value, 100 * sd))
            for name, value, sd, _ in known
        }
        definition = f"{words('state.apart', **parts)} {definition}"
        answers = [_answer("ratio", *ratio, when, since, words)]
    steps = _steps(states)
    said = [_step_words(one, states, words) for one in steps]
    if (latest["slow_time_unit"] or "") in ("", "units"):
        said.append(words("unit.unknown"))
    return FirstPage(
        kind="state",
        subject=subject,
        question=words("state.question", name=subject),
        measured=measured_on([(first_ns, long_s)], words),
        definition=" ".join([*said, definition]),
        answer=" ".join(answers),
        confidence=confidence,
        actions=[
            *[words("state.do_step")] * bool(steps),
            *_actions(latest, words, changed=bool(sure), tied=ratio is not None),
        ],
        alternatives=list(_alternatives(latest, wanted, ratio, words)),
        weighed=words("state.not_measured") if sure or ratio is not None else "",
        facts=list(_facts(name, states, words)),
    )


def of_frequency(latest: State, changes: str) -> bool:
    """Whether the answer is of the frequency: its change is certain, its cause supposed."""
    wanted = _wanted(changes)
    return len(wanted) == 1 and _certainty(latest[f"{wanted[0]}_change"])[2] >= SURE


def _instant(state: State, words: Words) -> str:
    """Write the instant of an epoch, in slow time and by the calendar if known."""
    own = _slow_time(state, words)
    date = measured_on([(state.get("t_ns"), None)], words)
    if date == words("measured.unknown"):
        return own
    # Seconds since 1970 tell nobody more than their date.
    return f"{date} UTC" if state["slow_time_unit"] == "s" else f"{own} ({date} UTC)"


def _when(latest: State, words: Words) -> str:
    """Write the instant of an epoch as a sentence begins with it."""
    instant = _instant(latest, words)
    of_calendar = latest["slow_time_unit"] == "s" and instant != _slow_time(latest, words)
    return words("state.at_date" if of_calendar else "state.at_time", instant=instant)


def _slow_time(state: State, words: Words) -> str:
    unit = _unit(state["slow_time_unit"] or "", words)
    return f"{words.number(state['slow_time'], 6)} {unit}"


def _dates(states: Sequence[State]) -> list[str] | None:
    """Give the dates of states whose slow time is the calendar, in seconds; else None."""
    times = [state.get("t_ns") for state in states if state["slow_time_unit"] == "s"]
    known = [at for at in times if at is not None and at >= FIRST_CLOCK_S * 1e9]
    if not known or len(known) < len(states):
        return None
    return [
        f"{datetime.datetime.fromtimestamp(at / 1e9, datetime.UTC):%Y-%m-%d %H:%M}"
        for at in known
    ]


def _since(reference: Reference, words: Words) -> str:
    """Name what changes are counted from, as part of a sentence."""
    if reference.nominal_hz is not None:
        return words("state.since_nominal", hz=words.number(reference.nominal_hz, 5))
    if reference.learnt:
        return words("state.since_learnt", n=reference.learnt)
    return words("state.since_unknown")


def _of_frequency(name: str, value: float, sd: float) -> tuple[float, float, float]:
    """Change of the natural frequency that is read as one of stiffness or mass alone."""
    power = 0.5 if name == "stiffness" else -0.5
    change = (1.0 + value) ** power
    return _certainty({"value": change - 1.0, "sd": 0.5 * change * sd / (1.0 + value)})


def _conditional(name: str, value: float, sd: float, words: Words) -> str:
    """Write a change that is one of stiffness, or mass, only if all else is as it was."""
    size, around = words.measured(100 * abs(value), 100 * sd)
    direction = "lost" if value < 0 else "gained"
    return words(f"state.if_{name}_{direction}", size=size, sd=around)


class Step(NamedTuple):
    """A sudden change of the frequency: epochs before and after it, and its relative size."""

    before: int
    after: int
    size: float


BESIDE_STEP = 5
"""Epochs on either side of a step whose means give its size [1], as many as the search for
steps draws its lines through."""


def _steps(states: Sequence[State]) -> list[Step]:
    """Find sudden changes of the frequency between neighbouring epochs, in order."""
    rows = [
        k
        for k, state in enumerate(states)
        if state["frequency_hz"] is not None
        and (k == 0 or state["slow_time"] > states[k - 1]["slow_time"])
    ]
    if not rows:
        return []
    time = np.array([states[k]["slow_time"] for k in rows], dtype=float)
    of = [states[k]["frequency_hz"] for k in rows]
    value, sd = (np.array([one[part] for one in of], dtype=float) for part in ("value", "sd"))
    found = []
    for at in sorted(candidate_jump_times(time, value, sd)):
        place = int(np.searchsorted(time, at, side="right"))
        before = value[max(place - BESIDE_STEP, 0) : place].mean()
        after = value[place : place + BESIDE_STEP].mean()
        found.append(Step(rows[place - 1], rows[place], float(after / before - 1.0)))
    return found


def _step_words(step: Step, states: Sequence[State], words: Words) -> str:
    before, after = (_instant(states[k], words) for k in (step.before, step.after))
    key = "state.step_down" if step.size < 0 else "state.step_up"
    size = words.number(100 * abs(step.size), 2)
    return words(key, before=before, after=after, size=size)


def _reference(reference: Reference, words: Words) -> str:
    if reference.nominal_hz is not None:
        hz = words.number(reference.nominal_hz, 5)
        return words("state.reference_nominal", hz=hz)
    if reference.learnt:
        return words("state.reference_learnt", n=reference.learnt)
    return words("state.reference_unknown")


def _certainty(estimate: State | None) -> tuple[float, float, float]:
    """Value, standard deviation and probability of a change in the direction of the value."""
    if estimate is None:
        return math.nan, math.nan, 0.5
    value, sd = float(estimate["value"]), float(estimate["sd"])
    return value, sd, float(ndtr(abs(value) / sd)) if sd > 0 else 0.5


def _ratio(latest: State) -> tuple[float, float, float] | None:
    """Change of stiffness over mass that is certain while that of neither is; else None.

    A natural frequency knows the ratio far better than its parts, whose errors go together.
    """
    (k, sd_k, _), (m, sd_m, _) = (
        _certainty(latest[name]) for name in ("stiffness_change", "mass_change")
    )
    ratio, sds = (1 + k) / (1 + m), (sd_k / (1 + k), sd_m / (1 + m))
    variance = sds[0] ** 2 + sds[1] ** 2 - 2 * (latest["correlation"] or 0.0) * sds[0] * sds[1]
    sd = ratio * math.sqrt(max(variance, 0.0))
    found = _certainty({"value": ratio - 1, "sd": sd})
    return found if found[2] >= SURE else None


def _answer(
    name: str,
    value: float,
    sd: float,
    chance: float,
    when: str,
    since: str,
    words: Words,
) -> str:
    what = words(f"state.the_{name}")
    if not math.isfinite(value):
        return words("state.unknown", what=what)
    if chance < SURE:
        key, size = "none" if chance < LIKELY else "same", value
    else:
        key, size = "lost" if value < 0 else "gained", abs(value)
    shown, around = words.measured(100 * size, 100 * sd)
    return words(f"state.{key}", what=what, size=shown, sd=around, when=when, since=since)


def _actions(latest: State, words: Words, *, changed: bool, tied: bool) -> Iterator[str]:
    for reason in latest["reasons"]:
        yield words("state.do_reason", reason=words.reason(reason))
    yield words("state.do_inspect" if changed or tied else "state.do_wait")
    if changed or tied:
        yield words("state.do_plan")
    if tied:
        yield words("state.do_tell_apart")
    if changed or tied:
        yield words("state.do_commands")


def _alternatives(
    latest: State,
    wanted: Sequence[str],
    ratio: tuple[float, float, float] | None,
    words: Words,
) -> Iterator[Alternative]:
    """Give what else has the same frequency: (1 + k) / (1 + m) is what one mode knows."""
    keys: tuple[str, ...]
    if ratio is not None:
        value, sd, keys = ratio[0], ratio[1], ("stiffness", "mass")
    elif len(wanted) != 1 or latest[f"{wanted[0]}_change"] is None:
        keys = ()
        value = sd = 0.0
    else:
        of = latest[f"{wanted[0]}_change"]
        value, sd, keys = of["value"], of["sd"], tuple({"stiffness", "mass"} - {*wanted})
        if wanted[0] == "mass":
            value, sd = 1 / (1 + value) - 1, sd / (1 + value) ** 2
    for key in keys:
        size = value if key == "stiffness" else 1 / (1 + value) - 1
        error = sd if key == "stiffness" else sd / (1 + value) ** 2
        shown, around = words.measured(100 * abs(size), 100 * error)
        way = "less" if size < 0 else "more"
        name = words(f"state.{way}_{key}", size=shown, sd=around)
        yield Alternative(name, words("state.same_frequency"))


def _facts(name: str, states: Sequence[State], words: Words) -> Iterator[tuple[str, str]]:
    invalid = collections.Counter(r for state in states for r in state["reasons"])
    yield words("facts.data"), name
    for key, state in (("facts.from", states[0]), ("facts.until", states[-1])):
        yield words(key), _instant(state, words)
    yield words("facts.epochs"), str(len(states))
    count = sum(not state["valid"] for state in states)
    reasons = "; ".join(words.reason(reason) for reason, _ in invalid.most_common(2))
    yield words("facts.invalid"), f"{count}{f' ({reasons})' if reasons else ''}"


def _unit(unit: str, words: Words) -> str:
    """Name a unit of slow time; a text file does not state it."""
    return words("unit.units") if unit in ("", "units") else unit


def _drawn(name: str, estimate: State, as_frequency: bool) -> State:
    """Give an estimate as it is drawn: as the change of the frequency, or as it is."""
    if not as_frequency:
        return estimate
    value, sd, _ = _of_frequency(name, float(estimate["value"]), float(estimate["sd"]))
    return {"value": value, "sd": sd}


def _picture(states: Sequence[State], changes: str, words: Words) -> Chart:
    traces: list[dict[str, Any]] = []
    as_frequency = of_frequency(states[-1], changes)
    for name, colour in zip(_wanted(changes), ("#0b6fb8", "#b3541e"), strict=False):
        valid = [s for s in states if s["valid"] and s[f"{name}_change"] is not None]
        x = _dates(valid) or [state["slow_time"] for state in valid]
        of = [_drawn(name, state[f"{name}_change"], as_frequency) for state in valid]
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
    what = words(f"state.{'frequency' if as_frequency else changes}")
    unit = _unit(states[-1]["slow_time_unit"] or "", words)
    title = words("state.axis_time", unit=unit)
    # Months as numbers are of no language.
    dated = {"title": {"text": words("state.date")}, "tickformat": "%Y-%m-%d", "nticks": 6}
    layout = {
        "xaxis": dated if _dates(states) else {"title": {"text": title}},
        "yaxis": {"title": {"text": words("state.axis", what=what)}},
        "showlegend": len(_wanted(changes)) > 1,
    }
    return Chart(traces, layout, words("state.picture", what=what))


def _sections(states: Sequence[State], changes: str, words: Words) -> Iterator[Section]:
    """Yield the table of the epochs, in the language of `words`."""
    every = max(1, math.ceil(len(states) / ROWS))
    wanted = [f"{name}_change" for name in _wanted(changes)]

    def cell(estimate: State | None, factor: float) -> str:
        if estimate is None:
            return "–"
        return " ± ".join(words.measured(factor * estimate["value"], factor * estimate["sd"]))

    dates = _dates(states)
    rows = [
        (
            words.number(state["slow_time"], 6) if dates is None else dates[k],
            cell(state["frequency_hz"], 1.0),
            *(cell(state[name], 100.0) for name in wanted),
            words("yes" if state["valid"] else "no"),
        )
        # From the last on, which the first page is about.
        for k, state in list(enumerate(states))[::-1][::every][::-1]
    ]
    unit = _unit(states[-1]["slow_time_unit"] or "", words)
    slow = f"{words.heading('slow time') or 'slow time'} [{unit}]"
    heads = (
        slow if dates is None else words("state.date"),
        "frequency [Hz]",
        *(f"{name.replace('_', ' ')} [%]" for name in wanted),
        "valid",
    )
    caption = words("sd")
    if every > 1:
        caption += " " + words("state.some_shown", shown=len(rows), total=len(states))
    counts = collections.Counter(reason for state in states for reason in state["reasons"])
    notes = [
        words("state.not_valid_in", n=n, total=len(states), why=words.reason(why))
        for why, n in counts.most_common()
    ]
    yield Section("Epochs", notes, [Table(heads, rows, caption)], translated=True)
