"""The report on a probability of failure by several methods."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from slowtime.reliability import Conditional, Problem, Result, System
from slowtime_services.problem_files.expressions import Expression
from slowtime_services.problem_files.stated import NOTHING_STATED, Stated
from slowtime_services.reports.first_page import (
    Alternative,
    Confidence,
    FirstPage,
    Level,
    subject_of,
)
from slowtime_services.reports.page import Chart, Section, Table, write_page
from slowtime_services.reports.words import Words

GOOD, FAIR = 0.1, 0.3
"""Coefficients of variation [1] up to which an estimate is of high and of medium confidence.
Source: at 0.3 the 95 % interval spans about a factor of four, at 0.1 one of 1.5."""

MOST_LETTERS = 180
"""Letters of a limit state on a first page [1]: two lines; the section below has all of it."""

MOST_NAMED = 12
"""Inputs that a first page names [1]: two lines."""

LEAST_SHARE = 0.1
"""Share of the variance [1] from which an input is worth learning more of. Source: without one
of less, beta grows by 5 %."""


def write_reliability_report(
    path: Path,
    name: str,
    problem: Problem,
    found: Sequence[Result],
    refused: Mapping[str, str],
    *,
    seed: int,
    stated: Stated = NOTHING_STATED,
    language: str = "en",
) -> None:
    """Write the report of `slowtime reliability`, as HTML or PDF.

    Parameters
    ----------
    name
        Of the file of the problem.
    refused
        Methods that could not be applied, and why.
    stated
        What the file states of the problem.
    """
    words = Words(language)
    first = reliability_page(name, problem, found, words, seed=seed, stated=stated)
    write_page(
        path, f"{words('kind.reliability')}: {first.subject}", first.answer,
        list(_sections(problem, found, refused, stated)), first=first,
        picture=_picture(found, words), language=language,
    )  # fmt: skip


def reliability_page(
    name: str,
    problem: Problem,
    found: Sequence[Result],
    words: Words,
    *,
    seed: int,
    stated: Stated = NOTHING_STATED,
) -> FirstPage:
    """Give the first page: the estimate with the narrowest interval, the others beside it."""
    best = _best(found)
    others = [one for one in found if one is not best]
    subject = subject_of(stated.name, name, words)
    beta = words.number(best.beta, 4)
    p = _probability(best.probability, words)
    if best.interval is None:
        answer = words("reliability.approximate", p=p, beta=beta)
    else:
        lo, hi = (words.number(end) for end in best.interval)
        answer = words("reliability.answer", p=p, lo=lo, hi=hi, beta=beta)
    verdict = _verdict(best, stated)
    if verdict != "unstated":
        accepted = words.number(stated.accepted or 0.0)
        answer += " " + words(f"reliability.accepted_{verdict}", accepted=accepted)
    return FirstPage(
        kind="reliability",
        subject=subject,
        question=words("reliability.question", name=subject),
        answer=answer,
        measured=words("measured.none"),
        definition=_definition(problem, stated, words),
        confidence=_confidence(best, others, words),
        actions=list(_actions(best, found, problem, stated, words)),
        alternatives=[_alternative(one, words) for one in others],
        facts=[
            (words("facts.data"), name),
            (words("facts.inputs"), _named(problem.names, stated)),
            (words("facts.method"), best.method),
            (words("facts.calls"), str(best.calls)),
            (words("facts.seed"), str(seed)),
        ],
    )


def _probability(p: float, words: Words) -> str:
    """Write a probability as a number, and as one in how many."""
    if not 0.0 < p < 0.1:
        return words.number(p)
    return words("reliability.one_in", p=words.number(p), n=words.whole(1.0 / p))


def _verdict(best: Result, stated: Stated) -> str:
    """Compare the whole interval with the accepted probability."""
    if stated.accepted is None:
        return "unstated"
    lo, hi = best.interval or (best.probability, best.probability)
    if best.interval is not None and lo <= stated.accepted <= hi:
        return "open"
    return "exceeded" if lo > stated.accepted else "kept"


def limit_state_text(problem: Problem) -> str:
    """Write the condition of failure as a formula of the inputs."""
    given = problem.limit_state
    if isinstance(given, Expression):
        return f"{' '.join(given.text.split())} ≤ 0"
    if isinstance(given, System):
        parts = "; ".join(
            f"{name}: {' '.join(part.text.split())} ≤ 0"
            if isinstance(part, Expression)
            else name
            for name, part in given.parts.items()
        )
        return f"{'at least one' if given.kind == 'series' else 'all'} of: {parts}"
    return "g ≤ 0"


def _definition(problem: Problem, stated: Stated, words: Words) -> str:
    formula = stated.formula or limit_state_text(problem)
    if len(formula) > MOST_LETTERS:
        formula = f"{formula[:MOST_LETTERS].rsplit(' ', 1)[0]} …"
    if stated.failure:
        failure = words("reliability.failure", failure=stated.failure, formula=formula)
    else:
        failure = words("reliability.failure_formula", formula=formula)
    if stated.period:
        return f"{failure} {words('reliability.period', period=stated.period)}"
    return f"{failure} {words('reliability.no_period')}"


def _named(inputs: Sequence[str], stated: Stated) -> str:
    """List inputs with their units; of many the first, and how many there are."""
    names = [
        f"{name} [{stated.units[name]}]" if name in stated.units else name for name in inputs
    ]
    if len(names) <= MOST_NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:MOST_NAMED])}, … ({len(names)})"


def _best(found: Sequence[Result]) -> Result:
    def width(one: Result) -> tuple[bool, bool, float]:
        known = one.variation is not None and math.isfinite(one.variation)
        return one.interval is None, bool(one.warnings), one.variation if known else math.inf  # type: ignore[return-value]

    return min(found, key=width)


def _confidence(best: Result, others: Sequence[Result], words: Words) -> Confidence:
    cov = best.variation
    if best.interval is None or cov is None:
        return Confidence("low", words("reliability.no_interval"))
    lo, hi = best.interval
    agree = sum(lo <= one.probability <= hi for one in others)
    level: Level = "high" if cov <= GOOD else "medium" if cov <= FAIR else "low"
    if level == "high" and others and not agree:
        level = "medium"
    if best.warnings:
        level = "low"
    told = words(
        "reliability.confidence", cov=words.percent(cov, 2), agree=agree, n=len(others)
    )
    return Confidence(level, told)


def _alternative(one: Result, words: Words) -> Alternative:
    p = words.number(one.probability)
    name = words("reliability.other", method=one.method, p=p)
    if one.interval is None:
        return Alternative(name, words("reliability.other_none"))
    lo, hi = (words.number(end) for end in one.interval)
    return Alternative(name, words("reliability.other_interval", lo=lo, hi=hi))


def _actions(
    best: Result, found: Sequence[Result], problem: Problem, stated: Stated, words: Words
) -> Iterator[str]:
    verdict = _verdict(best, stated)
    # What an approximation says of an accepted probability is no reason to rest.
    if verdict != "unstated" and (best.interval is not None or verdict == "exceeded"):
        yield words(f"reliability.do_{verdict}")
    for warning in best.warnings:
        yield words("reliability.do_warning", method=best.method, warning=warning)
    if best.interval is None:
        yield words("reliability.do_sample")
    if verdict == "unstated":
        yield words("reliability.do_compare")
    point = next((one.design_points[0] for one in found if one.design_points), None)
    if point is not None:
        most = int(point.importance.argmax())
        share = float(point.importance[most])
        if share >= LEAST_SHARE:
            told = words.percent(share, 3)
            yield words("reliability.do_input", name=problem.names[most], share=told)
    if not (stated.failure and stated.period):
        yield words("reliability.do_state")


def _picture(found: Sequence[Result], words: Words) -> Chart:
    p = [one.probability for one in found]
    ends = [one.interval or (one.probability, one.probability) for one in found]
    trace = {
        "type": "scatter", "mode": "markers", "x": p, "y": [one.method for one in found],
        "marker": {"color": "#0b6fb8", "size": 10},
        "error_x": {
            "type": "data", "symmetric": False,
            "array": [hi - x for (_, hi), x in zip(ends, p, strict=True)],
            "arrayminus": [x - lo for (lo, _), x in zip(ends, p, strict=True)],
        },
    }  # fmt: skip
    positive = all(lo > 0 for lo, _ in ends) and all(x > 0 for x in p)
    layout = {
        "xaxis": {
            "title": {"text": words("reliability.axis")},
            "type": "log" if positive else "linear", "exponentformat": "power", "nticks": 6,
        },
        "yaxis": {"type": "category", "automargin": True},
    }  # fmt: skip
    return Chart([trace], layout, words("reliability.picture"))


def _inputs(problem: Problem, stated: Stated) -> Table:
    """List inputs with mean, standard deviation and unit."""
    rows = []
    for name, law in problem.inputs.items():
        numbers = ("", "")
        if not isinstance(law, Conditional):
            numbers = (f"{law.mean:.5g}", f"{law.sd:.4g}")
        rows.append((name, *numbers, stated.units.get(name, "")))
    caption = "A unit is empty where the file does not state it."
    return Table(("input", "mean", "standard deviation", "unit"), rows, caption)


def _sections(
    problem: Problem, found: Sequence[Result], refused: Mapping[str, str], stated: Stated
) -> Iterator[Section]:
    rows = []
    for one in found:
        told = one.no_interval
        if one.interval is not None:
            told = f"{one.interval[0]:.3g} to {one.interval[1]:.3g}"
        cov = "" if one.variation is None else f"{100 * one.variation:.1f}"
        cells = one.method, f"{one.probability:.3e}", told, f"{one.beta:.3f}", cov
        rows.append((*cells, str(one.calls)))
    heads = ("method", "P_f [1]", "95 % interval [1]", "beta [1]", "c.o.v. [%]", "calls [1]")
    notes = [f"{one.method}: {warning}" for one in found for warning in one.warnings]
    notes += [f"{method} cannot be applied: {said}" for method, said in refused.items()]
    caption = "β = −Φ⁻¹(P_f); c.o.v. is the standard deviation of the estimate over itself."
    yield Section("Results", notes, [Table(heads, rows, caption)])
    formula = stated.formula or limit_state_text(problem)
    yield Section("Failure", [formula], [_inputs(problem, stated)])
    points = next((one.design_points for one in found if one.design_points), ())
    listed = [
        (str(k), f"{point.beta:.3f}", name, f"{point.x[i]:.5g}",
         f"{100 * point.importance[i]:.1f}")
        for k, point in enumerate(points[:5], start=1)
        for i, name in enumerate(problem.names)
    ]  # fmt: skip
    if listed:
        told = "Importance is α², the share of the variance at the design point."
        names = ("point", "beta [1]", "input", "value", "importance [%]")
        yield Section("Design points", (), [Table(names, listed, told)])
