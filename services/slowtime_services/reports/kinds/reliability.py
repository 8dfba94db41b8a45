"""The report on a probability of failure by several methods."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import NormalDist

from slowtime.reliability import Conditional, DesignPoint, Problem, Result, System
from slowtime_services.problem_files.expressions import Expression
from slowtime_services.problem_files.stated import NOTHING_STATED, Stated
from slowtime_services.reports.contents import Chart, Section, Table
from slowtime_services.reports.first_page import (
    Alternative,
    Confidence,
    FirstPage,
    Level,
    subject_of,
)
from slowtime_services.reports.page import write_page
from slowtime_services.reports.words import Words

from .input_runs import run_name, runs_of_inputs

GOOD, FAIR = 0.1, 0.3
"""Coefficients of variation [1] up to which an estimate is of high and of medium confidence.
Source: at 0.3 the 95 % interval spans about a factor of four, at 0.1 one of 1.5."""

MOST_APART = 3.0
"""Ratio of two probabilities [1] from which methods disagree. Source: an interval of this width
is of an estimate with a coefficient of variation of a quarter, more than that of a good one."""

FRACTION_ERROR = 0.1
"""Relative error [1] up to which a ratio is called a half, a third, ..., "about" being said."""

FRACTIONS = (2, 3, 4, 5, 10)
"""Denominators [1] of fractions that have a name in both languages."""

MOST_LETTERS = 180
"""Letters of a limit state on a first page [1]: two lines; the section below has all of it."""

MOST_POINTS = 5
"""Design points that are listed [1]: farther ones add little."""

MOST_NAMED = 12
"""Inputs that a first page names [1]: two lines."""

BETA_OF_COLLAPSE, YEARS_OF_COLLAPSE = 3.8, 50.0
"""Reliability index [1] of the collapse of an ordinary building (class RC2), and the time that
it is of [years]. Source: EN 1990:2002, table B.2."""

YEARS = re.compile(
    r"(\d+(?:\.\d+)?|one|a|ein|eines)\s+(?:years?|Jahr(?:e[ns]?)?)", re.IGNORECASE
)
"""A number of years, as files state periods."""

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
    key = "reliability.approximate" if best.interval is None else "reliability.answer"
    answer = words(key, p=_probability(best.probability, words))
    answer += " " + _verdict_in_words(best, stated, words)
    return FirstPage(
        kind="reliability",
        subject=subject,
        question=words("reliability.question", name=subject),
        answer=answer,
        measured=words("measured.none"),
        definition=_definition(problem, stated, words),
        confidence=_confidence(best, others, _verdict(best, stated), words),
        actions=list(_actions(best, found, problem, stated, words)),
        alternatives=[_alternative(one, words) for one in others],
        weighed=_weighed(best, others, stated, words),
        facts=[
            (words("facts.data"), name),
            (words("facts.inputs"), _named(problem, stated)),
            (words("facts.method"), _method(best, words)),
            (words("facts.beta"), words.number(best.beta, 4)),
            (words("facts.calls"), str(best.calls)),
            (words("facts.seed"), str(seed)),
        ],
    )


def _method(one: Result, words: Words) -> str:
    """Write the name of a method in full."""
    return words.known(f"method.{one.method}") or one.method


def _probability(p: float, words: Words, digits: int = 3) -> str:
    """Write a probability as a number, and as one in how many."""
    if not 0.0 < p < 0.1:
        return words.number(p, digits)
    n = words.whole(1.0 / p, digits)
    return words("reliability.one_in", p=words.number(p, digits), n=n)


def _verdict(best: Result, stated: Stated) -> str:
    """Compare the whole interval with the accepted probability."""
    if stated.accepted is None:
        return "unstated"
    lo, hi = best.interval or (best.probability, best.probability)
    if best.interval is not None and lo <= stated.accepted <= hi:
        return "open"
    return "exceeded" if lo > stated.accepted else "kept"


def _verdict_in_words(best: Result, stated: Stated, words: Words) -> str:
    """Set the probability and its interval in proportion to what is accepted."""
    verdict = _verdict(best, stated)
    if verdict == "unstated" or not stated.accepted:
        return words("reliability.accepted_unstated")
    accepted = stated.accepted
    told = {
        "ratio": _ratio(best.probability / accepted, words),
        "accepted": words.number(accepted),
    }
    if best.interval is None:
        return words("reliability.accepted_no_interval", **told)
    lo, hi = (_bound(end / accepted, words) for end in best.interval)
    return words(f"reliability.accepted_{verdict}", lo=lo, hi=hi, **told)


def _ratio(ratio: float, words: Words) -> str:
    """Write a ratio as a fraction that has a name, or with two digits."""
    for n in FRACTIONS:
        if abs(ratio * n - 1.0) <= FRACTION_ERROR:
            return words(f"reliability.fraction_{n}")
    return _bound(ratio, words, 2)


def _bound(ratio: float, words: Words, digits: int = 3) -> str:
    """Write a ratio as so many times or as a share; near 1, digits tell it from 1."""
    digits = 4 if 0.95 < ratio < 1.05 else digits
    if ratio > 1.0:
        return words("reliability.times", x=words.number(ratio, digits))
    return words("reliability.share", share=words.percent(ratio, digits))


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
    formula = stated.formula or words.reason(limit_state_text(problem))
    if len(formula) > MOST_LETTERS:
        formula = f"{formula[:MOST_LETTERS].rsplit(' ', 1)[0]} …"
    if stated.failure:
        failure = words("reliability.failure", failure=stated.failure)
    else:
        failure = words("reliability.failure_formula", formula=formula)
    if stated.period:
        return f"{failure} {words('reliability.period', period=stated.period)}"
    return f"{failure} {words('reliability.no_period')}"


def _named(problem: Problem, stated: Stated) -> str:
    """List inputs with their units, and like ones as one; of many the first, and the count."""
    runs = runs_of_inputs(problem, stated)
    units = [stated.units.get(run[0], "") for run in runs]
    names = [
        f"{run_name(run)} [{unit}]" if unit else run_name(run)
        for run, unit in zip(runs, units, strict=True)
    ][:MOST_NAMED]
    rest = f", … ({len(problem.names)})" if len(runs) > MOST_NAMED else ""
    return f"{', '.join(names)}{rest}"


def _best(found: Sequence[Result]) -> Result:
    def width(one: Result) -> tuple[bool, bool, float]:
        known = one.variation is not None and math.isfinite(one.variation)
        return one.interval is None, bool(one.warnings), one.variation if known else math.inf  # type: ignore[return-value]

    return min(found, key=width)


def _confidence(
    best: Result, others: Sequence[Result], verdict: str, words: Words
) -> Confidence:
    cov = best.variation
    if best.interval is None or cov is None:
        return Confidence("low", words("reliability.no_interval"))
    lo, hi = best.interval
    agree = sum(lo <= one.probability <= hi for one in others)
    level: Level = "high" if cov <= GOOD else "medium" if cov <= FAIR else "low"
    if level == "high" and others and not agree:
        level = "medium"
    apart = [(one, ratio) for one in others if (ratio := _apart(best, one)) > MOST_APART]
    if level == "high" and apart:
        level = "medium"
    if best.warnings:
        level = "low"
    ends = {"lo": words.number(lo), "hi": words.number(hi)}
    said = [words("reliability.confidence", cov=words.percent(cov, 2), **ends)]
    if agree < len(others):
        known = [one.interval or (one.probability, one.probability) for one in (best, *others)]
        every = [words.number(end) for end in (min(map(min, known)), max(map(max, known)))]
        said.append(words("reliability.outside", lo=every[0], hi=every[1]))
    for one, ratio in apart:
        way = "less" if one.probability < best.probability else "more"
        times = "∞" if math.isinf(ratio) else words.number(ratio, 2)
        said.append(words(f"reliability.apart_{way}", method=_method(one, words), times=times))
    judged = verdict in ("kept", "exceeded")
    of_number = "" if judged else words(f"reliability.sure_{verdict}_{level}")
    return Confidence(level, " ".join(said), of_number)


def _apart(best: Result, other: Result) -> float:
    """Return the ratio of the larger of two probabilities to the smaller [1].

    A method in whose samples nothing failed contradicts only what lies beyond its interval.
    """
    low, high = sorted((best.probability, other.probability))
    if low > 0.0:
        return high / low
    inside = other.interval is not None and best.probability <= other.interval[1]
    return 1.0 if inside or high == low else math.inf


def _alternative(one: Result, words: Words) -> Alternative:
    p = words.number(one.probability)
    name = words("reliability.other", method=_method(one, words), p=p)
    if one.interval is None:
        return Alternative(name, words("reliability.other_none"))
    lo, hi = (words.number(end) for end in one.interval)
    return Alternative(name, words("reliability.other_interval", lo=lo, hi=hi))


def _weighed(best: Result, others: Sequence[Result], stated: Stated, words: Words) -> str:
    """Say what the answer would be by the other methods."""
    if not others:
        return ""
    accepted = stated.accepted
    if accepted is None:
        return _other_results(best, others, words)
    above = [_method(one, words) for one in others if one.probability > accepted]
    below = [_method(one, words) for one in others if one.probability <= accepted]
    if not (above and below):
        same = "exceeded" if above else "kept"
        also = "_also" if _verdict(best, stated) == same else ""
        return words(f"reliability.weighed_{same}{also}")
    return words("reliability.weighed_mixed", above=", ".join(above), below=", ".join(below))


def _other_results(best: Result, others: Sequence[Result], words: Words) -> str:
    """List the probabilities of the other methods, and how far they are from the answer."""
    p = sorted(one.probability for one in others)
    texts = [words.number(one) for one in p]
    if len(p) == 1:
        told = words("reliability.others_one", listed=texts[0])
    else:
        listed = words("reliability.and", first=", ".join(texts[:-1]), last=texts[-1])
        count = words.known(f"reliability.count_{len(p)}") or str(len(p))
        told = words("reliability.others", n=count, listed=listed)
    lower, higher = (
        _times(*pair, words) for pair in ((best.probability, p[0]), (p[-1], best.probability))
    )
    if p[-1] <= best.probability:
        return words("reliability.others_lower", told=told, factor=lower)
    if p[0] >= best.probability:
        return words("reliability.others_higher", told=told, factor=higher)
    return words("reliability.others_both", told=told, lower=lower, higher=higher)


def _times(above: float, below: float, words: Words) -> str:
    return words.number(above / below, 2) if below > 0.0 else "∞"


def _years_of(period: str) -> float | None:
    """Read the number of years of a period; None of one that is not of years."""
    found = YEARS.fullmatch(period.strip())
    if found is None:
        return None
    return float(found[1]) if found[1][0].isdigit() else 1.0


def _to_compare(best: Result, stated: Stated, words: Words) -> str:
    """Say what EN 1990 aims at within the years of the period, where it is one of years."""
    years = _years_of(stated.period)
    if not years:
        return words("reliability.do_decide")
    # Years are taken to be independent, as the indices of table B.2 for 1 and 50 years are.
    of_collapse = NormalDist().cdf(-BETA_OF_COLLAPSE)
    usual = -math.expm1(years / YEARS_OF_COLLAPSE * math.log1p(-of_collapse))
    ratio = _bound(best.probability / usual, words, 2)
    aim = _probability(usual, words, 2)
    return words("reliability.do_compare", usual=aim, ratio=ratio, years=words.number(years))


def _actions(
    best: Result, found: Sequence[Result], problem: Problem, stated: Stated, words: Words
) -> Iterator[str]:
    verdict = _verdict(best, stated)
    # What an approximation says of an accepted probability is no reason to rest.
    if verdict != "unstated" and (best.interval is not None or verdict == "exceeded"):
        yield words(f"reliability.do_{verdict}")
    for warning in best.warnings:
        yield words(
            "reliability.do_warning", method=_method(best, words), warning=words.reason(warning)
        )
    if best.interval is None:
        yield words("reliability.do_sample")
    if verdict == "unstated":
        yield _to_compare(best, stated, words)
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
    names = [words.known(f"method.{one.method}") or one.method for one in found]
    ends = [one.interval or (one.probability, one.probability) for one in found]
    trace = {
        "type": "scatter", "mode": "markers", "x": p, "y": names,
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
    """List inputs with mean, standard deviation and unit; like ones as one."""
    rows = []
    for run in runs_of_inputs(problem, stated):
        law = problem.inputs[run[0]]
        numbers = ("", "")
        if not isinstance(law, Conditional):
            numbers = (f"{law.mean:.5g}", f"{law.sd:.4g}")
        rows.append((run_name(run), *numbers, stated.units.get(run[0], "")))
    caption = (
        "A unit is empty where the file does not state it. A row of several inputs has the "
        "numbers of each."
    )
    heads = ("input", "mean", "standard deviation", "unit")
    return Table(heads, rows, caption, names=("input", "unit"))


def _design_points(
    points: Sequence[DesignPoint], problem: Problem, stated: Stated
) -> Iterator[tuple[str, ...]]:
    """List design points, inputs that are alike there as one."""
    for k, point in enumerate(points[:MOST_POINTS], start=1):
        cells = {
            name: (f"{point.x[i]:.5g}", f"{100 * point.importance[i]:.1f}")
            for i, name in enumerate(problem.names)
        }
        for run in runs_of_inputs(problem, stated):
            same = len({cells[name] for name in run}) == 1
            for part in [run] if same else [[name] for name in run]:
                yield str(k), f"{point.beta:.3f}", run_name(part), *cells[part[0]]


def _sections(
    problem: Problem, found: Sequence[Result], refused: Mapping[str, str], stated: Stated
) -> Iterator[Section]:
    rows, english = [], Words()
    for one in found:
        told = one.no_interval
        if one.interval is not None:
            told = " to ".join(english.number(end) for end in one.interval)
        cov = "" if one.variation is None else f"{100 * one.variation:.1f}"
        cells = one.method, english.number(one.probability, 4), told, f"{one.beta:.3f}", cov
        rows.append((*cells, str(one.calls)))
    heads = ("method", "P_f [1]", "95 % interval [1]", "beta [1]", "c.o.v. [%]", "calls [1]")
    notes = [f"{one.method}: {warning}" for one in found for warning in one.warnings]
    notes += [f"{method} cannot be applied: {said}" for method, said in refused.items()]
    caption = "β = −Φ⁻¹(P_f); c.o.v. is the standard deviation of the estimate over itself."
    yield Section("Results", notes, [Table(heads, rows, caption)])
    formula = stated.formula or limit_state_text(problem)
    yield Section("Failure", [formula], [_inputs(problem, stated)])
    points = next((one.design_points for one in found if one.design_points), ())
    listed = list(_design_points(points, problem, stated))
    if listed:
        told = "Importance is α², the share of the variance at the design point, of each input."
        names = ("point", "beta [1]", "input", "value", "importance [%]")
        yield Section("Design points", (), [Table(names, listed, told, names=("input",))])
