"""The first page of every report: question, answer, confidence, one picture, what to do.

Alternatives that fit as well stand beside the answer. An improvement is stated against the
model as given and against the refitted one. Of what, where and when the data are stands below.
"""

import dataclasses
import datetime
import html
import importlib.metadata
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

from slowtime_schemas.slow_times import FIRST_CLOCK_S

from .words import Words

Kind = Literal["modes", "diagnosis", "reliability", "plan", "state"]
Level = Literal["high", "medium", "low"]

SURE, LIKELY = 0.95, 0.7
"""Probabilities [1] from which confidence is called high and medium. Source: 0.95 is the
customary level of a test, 0.7 is what makes an answer more than twice as likely as all else."""


LONG_ANSWER = 150
"""Letters of an answer [1] from which it is set smaller: beyond four lines, the facts below
would leave the sheet."""

LONG_FACT = 45
"""Letters of a fact [1] from which it has a row of its own: two lines of a column in print."""

_DATE, _PERCENT = re.compile(r"\d{4}-\d\d-\d\d"), re.compile(r"(?<=\d) %")

MOST_ALTERNATIVES = 6
"""Other answers on a first page [1]: with more, it is none."""


def level_of(probability: float) -> Level:
    """Name the confidence of an answer by its probability."""
    return "high" if probability >= SURE else "medium" if probability >= LIKELY else "low"


@dataclasses.dataclass(frozen=True, slots=True)
class Confidence:
    """How sure an answer is, in a word, and the number with what it means.

    Parameters
    ----------
    said
        What is sure and what is not, in place of the word: for answers that decide only a part
        of the question. Empty for the word of the level.
    """

    level: Level
    number: str
    said: str = ""


@dataclasses.dataclass(frozen=True, slots=True)
class Alternative:
    """Another answer that the data allow, and its probability or cost with unit."""

    name: str
    measure: str


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Improvement:
    """Error of a model before and after, against measurements.

    Parameters
    ----------
    given, refitted, final
        Error of the model as given; with its constants refitted and nothing added (None where
        nothing was refitted); and of the corrected model [unit].
    floor
        Error that the noise alone leaves [unit]; None if unknown.
    unit
        Unit of all four, such as %.
    meaning
        Definition of the error.
    """

    given: float
    refitted: float | None
    final: float
    floor: float | None
    unit: str
    meaning: str


@dataclasses.dataclass(frozen=True, slots=True)
class Sketch:
    """A structure as points and lines between them; the places that the answer is about.

    Parameters
    ----------
    points
        Name, and coordinates to the right and up, of each point.
    lines
        Name, and the names of the two ends, of each line.
    marked
        Names of points and lines that are drawn strongly.
    """

    points: Sequence[tuple[str, float, float]]
    lines: Sequence[tuple[str, str, str]]
    marked: Sequence[str] = ()


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class FirstPage:
    """Contents of a first page.

    Parameters
    ----------
    subject
        Name of the structure; see `subject_of` for where none is known.
    question, answer
        A sentence each.
    measured
        When the data were measured, as `measured_on` writes it.
    definition
        What a word of the answer means, such as failure; empty where none needs it.
    actions
        What to do, the most urgent first.
    alternatives
        Other answers, beside this one.
    beside
        Heading of the alternatives; empty for the usual one of the kind.
    weighed
        What the alternatives would change, or what speaks against them; empty for nothing.
    facts
        Labels of the catalogue, such as `facts.rate`, and their values.
    place
        Where on the structure; empty for the whole.
    """

    kind: Kind
    subject: str
    question: str
    answer: str
    confidence: Confidence
    actions: Sequence[str]
    measured: str
    definition: str = ""
    alternatives: Sequence[Alternative] = ()
    beside: str = ""
    weighed: str = ""
    improvement: Improvement | None = None
    facts: Sequence[tuple[str, str]] = ()
    sketch: Sketch | None = None
    place: str = ""


def made_at() -> datetime.datetime:
    """Instant of a report, or SOURCE_DATE_EPOCH, for reports that are to be compared.

    References
    ----------
    .. [1] https://reproducible-builds.org/specs/source-date-epoch/
    """
    fixed = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.datetime.now(datetime.UTC)
    if fixed.isdecimal():
        now = datetime.datetime.fromtimestamp(int(fixed), datetime.UTC)
    return now


def made_on() -> str:
    """Date of a report."""
    return f"{made_at():%Y-%m-%d}"


Span = tuple[int | None, float | None]
"""Time of the first sample [ns since 1970] and length [s]; None where the file does not say."""


def measured_on(spans: Sequence[Span], words: Words) -> str:
    """Write when data were measured: from the first to the last of their spans, UTC."""
    known = [
        (start / 1e9, start / 1e9 + (long_s or 0.0))
        for start, long_s in spans
        if start is not None and start >= FIRST_CLOCK_S * 1e9
    ]
    if not known:
        return words("measured.unknown")
    first, last = (
        datetime.datetime.fromtimestamp(end, datetime.UTC)
        for end in (min(one[0] for one in known), max(one[1] for one in known))
    )
    if first.date() == last.date():
        return f"{first:%Y-%m-%d %H:%M}"
    return words("measured.span", first=f"{first:%Y-%m-%d}", last=f"{last:%Y-%m-%d}")


def subject_of(given: str, file: str, words: Words) -> str:
    """Name what a report is about.

    Parameters
    ----------
    given
        Name of the structure; empty where neither flag nor file states one.
    file
        Name of the file of the data, whose stem is quoted where there is no other name.
    """
    return given or words("subject.record", name=Path(file).stem.replace("_", " "))


def first_page(page: FirstPage, words: Words, picture: str) -> str:
    """Write it as HTML.

    Parameters
    ----------
    picture
        HTML of the one picture; empty for none.
    """
    long = ' class="long"' if len(page.answer) > LONG_ANSWER else ""
    return "\n".join(
        [
            '<header class="first">',
            f'<p class="kind">{_escaped(words(f"kind.{page.kind}"))} · '
            f"{_escaped(page.subject)}</p>",
            f'<p class="question">{_whole(page.question)}</p>',
            '<div class="beside"><div class="told">',
            f"<h1{long}>{_whole(page.answer)}</h1>",
            f'<p class="confidence {page.confidence.level}"><strong>'
            f"{_escaped(_how_sure(page.confidence, words))}</strong> "
            f"{_whole(page.confidence.number)}</p>",
            *([f'<p class="definition">{_whole(page.definition)}</p>'] * bool(page.definition)),
            "</div>",
            *_alternatives(page, words),
            "</div>",
            f'<div class="shown">{picture}{_sketch(page, words)}</div>',
            f'<div class="do"><h2>{_escaped(words("do"))}</h2><ol>',
            *(f"<li>{_whole(action)}</li>" for action in page.actions),
            "</ol></div>",
            *_improvement(page.improvement, words),
            *_facts(page, words),
            "</header>",
        ]
    )


def _escaped(text: str) -> str:
    return html.escape(text)


def _whole(text: str) -> str:
    """Escape a text whose dates, and numbers with their %, lines do not break."""
    escaped = _PERCENT.sub("\u00a0%", _escaped(text))
    return _DATE.sub(r'<span class="date">\g<0></span>', escaped)


def _how_sure(confidence: Confidence, words: Words) -> str:
    return confidence.said or words(f"confidence.{confidence.level}")


def _alternatives(page: FirstPage, words: Words) -> Iterator[str]:
    heading = page.beside or words(f"alternatives.{page.kind}")
    yield f'<aside class="alternatives"><h2>{_escaped(heading)}</h2>'
    if page.alternatives:
        yield "<ul>"
        for one in page.alternatives[:MOST_ALTERNATIVES]:
            yield f"<li>{_whole(one.name)} <span>{_whole(one.measure)}</span></li>"
        more = len(page.alternatives) - MOST_ALTERNATIVES
        if more > 0:
            yield f"<li>{_escaped(words('alternatives_more', n=more))}</li>"
        yield "</ul>"
    else:
        yield f"<p>{_escaped(words(f'no_alternatives.{page.kind}'))}</p>"
    if page.weighed:
        yield f'<p class="weighed">{_whole(page.weighed)}</p>'
    yield "</aside>"


def _improvement(one: Improvement | None, words: Words) -> Iterator[str]:
    if one is None:
        return

    def amount(value: float | None) -> str:
        return "–" if value is None else f"{words.number(value)} {one.unit}"

    yield f'<div class="improvement"><h2>{_escaped(words("improvement"))}</h2>'
    columns = {"given": one.given, "refitted": one.refitted, "final": one.final}
    if one.floor is not None:
        columns["floor"] = one.floor
    heads = "".join(f"<th>{_escaped(words(f'error.{name}'))}</th>" for name in columns)
    cells = "".join(f"<td>{_escaped(amount(value))}</td>" for value in columns.values())
    yield f'<div class="wide"><table><thead><tr>{heads}</tr></thead>'
    yield f"<tbody><tr>{cells}</tr></tbody></table></div>"
    yield f"<p>{_whole(_changes(one, words))} {_escaped(one.meaning)}</p></div>"


def _changes(one: Improvement, words: Words) -> str:
    """Write the change against both models, as one where both are the same in print."""
    given = _change("given", one.given, one.final, words)
    if one.refitted is None:
        return given
    both = _change("both", one.given, one.final, words)
    if both == _change("both", one.refitted, one.final, words):
        return both
    return f"{given} {_change('refitted', one.refitted, one.final, words)}"


def _change(which: str, before: float, after: float, words: Words) -> str:
    """Write by how much the error has changed since one of the models."""
    share = 1.0 - after / before if before > 0.0 else 0.0
    kind = "less" if share > 0.0 else "more" if share < 0.0 else "same"
    return words(f"improvement.{which}.{kind}", share=words.percent(abs(share), 3))


def _facts(page: FirstPage, words: Words) -> Iterator[str]:
    rows = [*page.facts]
    if page.place:
        rows.append((words("facts.place"), page.place))
    rows += [
        (words("facts.measured"), page.measured),
        (words("facts.made"), made_on()),
        (words("facts.version"), f"slowtime {importlib.metadata.version('slowtime')}"),
    ]
    yield '<dl class="facts">'
    for label, value in rows:
        wide = ' class="long"' if len(value) > LONG_FACT else ""
        yield f"<div{wide}><dt>{_escaped(label)}</dt><dd>{_whole(value)}</dd></div>"
    yield "</dl>"


SIDE, MARGIN, TALL = 640.0, 46.0, 130.0
"""Width of a sketch, its margin for names, and its greatest height within [CSS px]: with them
every first page of the tests is one sheet of A4."""

MOST_NAMES = 14
"""Points of a sketch that are all named [1]; of more, only those marked."""


ARCH = 34.0
"""[CSS px] By which a line is arched that would run through points between its ends. Source:
the height of a name and of the line that it stands on."""


def _passes(points: Mapping[str, tuple[float, float]], first: str, last: str) -> bool:
    """Whether a level line between two points runs through another."""
    (x1, y1), (x2, y2) = points[first], points[last]
    low, high = min(x1, x2), max(x1, x2)
    return y1 == y2 and any(y == y1 and low < x < high for x, y in points.values())


def _sketch(page: FirstPage, words: Words) -> str:
    """Draw the structure as SVG, the places of the answer strongly."""
    sketch = page.sketch
    if sketch is None or not sketch.points:
        return ""
    xs = [x for _, x, _ in sketch.points]
    ys = [y for _, _, y in sketch.points]
    across, up = max(xs) - min(xs), max(ys) - min(ys)
    scale = min((SIDE - 2 * MARGIN) / max(across, 1e-12), TALL / max(up, 1e-12))
    flat = {name: (x, y) for name, x, y in sketch.points}
    arched = {name for name, first, last in sketch.lines if _passes(flat, first, last)}
    height = up * scale + 2 * MARGIN + (ARCH if arched else 0.0)
    left = 0.5 * (SIDE - across * scale)
    at = {
        name: (left + (x - min(xs)) * scale, height - MARGIN - (y - min(ys)) * scale)
        for name, x, y in sketch.points
    }
    drawn = []
    for name, first, last in sketch.lines:
        (x1, y1), (x2, y2) = at[first], at[last]
        strong = ' class="strong"' if name in sketch.marked else ""
        # A quadratic curve rises half as far as its middle point.
        rise = 2 * ARCH if name in arched else 0.0
        middle = f"{(x1 + x2) / 2:.1f} {(y1 + y2) / 2 - rise:.1f}"
        drawn.append(f'<path d="M{x1:.1f} {y1:.1f} Q{middle} {x2:.1f} {y2:.1f}"{strong}/>')
        if name in sketch.marked or len(sketch.lines) <= MOST_NAMES:
            drawn.append(
                f'<text x="{(x1 + x2) / 2:.1f}" y="{(y1 + y2 - rise) / 2 - 8:.1f}"{strong}>'
                f"{_escaped(name)}</text>"
            )
    for name, (x, y) in at.items():
        strong = ' class="strong"' if name in sketch.marked else ""
        drawn.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="7"{strong}/>')
        if name in sketch.marked or len(at) <= MOST_NAMES:
            drawn.append(f'<text x="{x:.1f}" y="{y + 24:.1f}"{strong}>{_escaped(name)}</text>')
    label = _escaped(words("sketch", place=page.place or page.subject))
    return (
        f'<figure class="sketch"><svg viewBox="0 0 {SIDE:g} {height:.0f}" role="img" '
        f'aria-label="{label}">{"".join(drawn)}</svg><figcaption>{label}</figcaption></figure>'
    )
