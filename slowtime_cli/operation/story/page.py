"""The story as one HTML page: what happened, what the twin noticed, and how the gap closed."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slowtime_services.reports import Chart, Section, Table, Words, write_page

from .scenario import Scenario
from .summary import Document, Gathered, gap_readings, in_words

YEAR_AXIS = {"rangemode": "tozero"}
GREY, BLUE, RED = "#7b868d", "#0b6fb8", "#b3541e"


def write_story_page(
    path: Path, of: Scenario, found: Gathered, document: Document, language: str = "en"
) -> None:
    """Write the page of a run.

    Parameters
    ----------
    language
        Of headings and captions; events are shown as the twin told them.
    """
    words = Words(language)
    lead = words("story.lead", seed=of.seed, records=of.records)
    sections = list(_sections(of, found, document, words))
    write_page(path, words("story.title"), lead, sections, language=language)


def _sections(
    of: Scenario, found: Gathered, document: Document, words: Words
) -> Iterator[Section]:
    yield Section(words("story.short"), in_words(document))
    yield Section(words("story.gap"), (), [_gap_chart(of, found, document, words)], True)
    yield Section(words("story.change"), (), [_change_chart(found, document, words)], True)
    yield Section(words("story.timeline"), (), [_timeline(document, words)])
    yield Section(words("story.outlooks"), (), [_outlooks(document, words)])


def _marks(document: Document) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Vertical lines where the effect enters and leaves, and where adoptions change."""
    entered = document["entered"]
    at = [(entered["years"], entered["effect"], RED), (entered["left_years"], "", RED)]
    at += [
        (one["years"], one["kind"], BLUE)
        for one in document["decisions"]
        if one["kind"] in ("adopted", "undone")
    ]
    lines = [
        {
            "type": "line", "x0": years, "x1": years, "y0": 0, "y1": 1, "yref": "paper",
            "line": {"color": colour, "width": 1, "dash": "dot"},
        }
        for years, _, colour in at
    ]  # fmt: skip
    names = [
        {
            "x": years, "y": 1.0, "yref": "paper", "text": text, "showarrow": False,
            "xanchor": "left", "yanchor": "top", "textangle": 90, "font": {"color": colour},
        }
        for years, text, colour in at
        if text
    ]  # fmt: skip
    return lines, names


def _gap_chart(of: Scenario, found: Gathered, document: Document, words: Words) -> Chart:
    gap = gap_readings(of, found)
    years = [one["years"] for one in gap]
    lines, names = _marks(document)
    traces = [
        _line(words("story.nominal"), years, [100 * one["nominal"] for one in gap], GREY),
        _line(words("story.in_use"), years, [100 * one["in_use"] for one in gap], BLUE),
    ]
    if document["gap"]["limit"] is not None:
        limit = 100 * document["gap"]["limit"]
        traces.append(_line(words("story.limit"), [0.0, 10.0], [limit, limit], RED))
    layout = {
        "xaxis": {"title": {"text": words("story.years")}, **YEAR_AXIS},
        "yaxis": {"title": {"text": words("story.error")}, "type": "log"},
        "shapes": lines,
        "annotations": names,
        "height": 420,
    }
    return Chart(traces, layout, words("story.gap_words"))


def _change_chart(found: Gathered, document: Document, words: Words) -> Chart:
    valid = [one for one in found.states if one["valid"] and one["stiffness_change"]]
    years = [one["slow_time"] / 365.25 for one in valid]
    values = [100 * one["stiffness_change"]["value"] for one in valid]
    truth = [
        (one["slow_time"] / 365.25, 100 * one["truth"]["lasting.element.storey1"])
        for one in found.states
        if one["truth"]
    ]
    lines, names = _marks(document)
    traces = [
        {**_line(words("story.estimate"), years, values, BLUE), "mode": "markers"},
        _line(words("story.truth"), [x for x, _ in truth], [y for _, y in truth], GREY),
    ]
    layout = {
        "xaxis": {"title": {"text": words("story.years")}, **YEAR_AXIS},
        "yaxis": {"title": {"text": words("story.stiffness")}},
        "shapes": lines,
        "annotations": names,
        "height": 380,
    }
    return Chart(traces, layout, words("story.change_words"))


def _line(name: str, x: Sequence[float], y: Sequence[float], colour: str) -> dict[str, Any]:
    style = {"color": colour, "width": 1.5}
    marker = {"color": colour, "size": 3}
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": list(x), "y": list(y),
        "line": style, "marker": marker,
    }  # fmt: skip


def _timeline(document: Document, words: Words) -> Table:
    headings = [words("story.year"), words("story.by"), words("story.what")]
    rows = [
        [f"{one['years']:.2f}", words(f"story.by_{one['by'].split()[0]}"), one["text"]]
        for one in document["timeline"]
    ]
    return Table(headings, rows, words("story.timeline_words"))


def _outlooks(document: Document, words: Words) -> Table:
    told = document["outlooks"]
    headings = ["", *(f"{words('story.year')} {one['years']:.1f}" for one in told.values())]
    rows = [
        [words(f"story.{name}"), *(_cell(one.get(name)) for one in told.values())]
        for name in ("forecast", "risk", "plan", "storm")
    ]
    return Table(headings, rows, words("story.outlook_words"))


def _cell(told: Any) -> str:
    if isinstance(told, Mapping):
        return f"{1e3 * told['value']:.3g} ({1e3 * told['lo']:.3g} … {1e3 * told['hi']:.3g}) mm"
    return " ".join(told) if isinstance(told, list) else str(told)
