"""Details of a report, which the analysis writes in English, in the report's language."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any

from .contents import Chart, Item, PoleChoice, Scene, Section, Table
from .words import Words

TITLED = ("xaxis", "yaxis", "xaxis2", "yaxis2")
"""Parts of a layout that have a title."""


WORDS = re.compile(r"[A-Za-z]{2,} [A-Za-z]{2,}")
"""Two words in a row, which no formula and no name of a method has."""


FREQUENCY = re.compile(r"\d\S* Hz")
"""A name of a mode; other names of marks on an axis, as of channels, are not changed."""


class English(str):
    """A text that stays English on a page of another language."""

    __slots__ = ()


def in_language(section: Section, words: Words) -> Section:
    """Translate headings and, where they are English, the texts of a section.

    Names of channels and files, and what a person has written, stay as they are.
    """
    if words.language == "en":
        return section
    heading = words.heading(section.heading) or English(section.heading)
    if section.translated:
        shown = [
            _headed(one, words) if isinstance(one, Table) else one for one in section.shown
        ]
        return dataclasses.replace(section, heading=heading, shown=shown)
    return Section(
        heading,
        [_text(sentence, words) for sentence in section.words],
        [_item(one, words) for one in section.shown],
        translated=True,
    )


def _text(english: str, words: Words) -> str:
    """Translate sentences; a formula is of no language."""
    told = words.told(english)
    if told is not None:
        return told
    return English(english) if WORDS.search(english) else english


def _phrase(english: str, words: Words) -> str:
    return words.told(english) or words.phrase(english)


def _item(item: Item, words: Words) -> Item:
    if isinstance(item, Table):
        return _table(item, words)
    if isinstance(item, Scene):
        return dataclasses.replace(item, words=_text(item.words, words))
    if isinstance(item, PoleChoice):
        return dataclasses.replace(item, chart=_chart(item.chart, words))
    return _chart(item, words)


def _headed(table: Table, words: Words) -> Table:
    headings = [words.heading(cell) or _phrase(cell, words) for cell in table.headings]
    return dataclasses.replace(table, headings=headings)


def _table(table: Table, words: Words) -> Table:
    names = {k for k, heading in enumerate(table.headings) if heading in table.names}
    rows = [
        [cell if k in names else _phrase(cell, words) for k, cell in enumerate(row)]
        for row in table.rows
    ]
    headed = _headed(table, words)
    return dataclasses.replace(headed, rows=rows, caption=_text(table.caption, words))


def _chart(chart: Chart, words: Words) -> Chart:
    layout = dict(chart.layout)
    for name in TITLED:
        if name in layout:
            layout[name] = _titled(layout[name], words)
    if "annotations" in layout:
        layout["annotations"] = [
            {**one, "text": _phrase(one["text"], words)} for one in layout["annotations"]
        ]
    return Chart(
        [_trace(one, words) for one in chart.data],
        layout,
        _text(chart.words, words),
        _text(chart.hint, words),
    )


def _titled(part: Mapping[str, Any], words: Words) -> dict[str, Any]:
    told, title = dict(part), part.get("title")
    if isinstance(title, Mapping):
        told["title"] = {**title, "text": _phrase(title["text"], words)}
    if "ticktext" in part:
        told["ticktext"] = [
            _phrase(one, words) if FREQUENCY.fullmatch(one) else one for one in part["ticktext"]
        ]
    return told


def _trace(trace: Mapping[str, Any], words: Words) -> dict[str, Any]:
    told = dict(trace)
    if "name" in told:
        told["name"] = _phrase(told["name"], words)
    if "colorbar" in told:
        told["colorbar"] = _titled(told["colorbar"], words)
    if told.get("type") == "heatmap" and "text" in told:
        told["text"] = [_phrases(row, words) for row in told["text"]]
    if told.get("type") == "bar":
        told |= {part: _phrases(told[part], words) for part in ("x", "text") if part in told}
    return told


def _phrases(values: Sequence[Any], words: Words) -> list[Any]:
    return [_phrase(one, words) if isinstance(one, str) else one for one in values]
