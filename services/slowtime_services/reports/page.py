"""HTML files of text, tables and charts that need no other file.

The drawing library is written into the file, so that it opens without a network and in years.
The charts can be read out of it again, by who draws them beside other things.
"""

import base64
import dataclasses
import functools
import gzip
import html
import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import plotly

from .first_page import FirstPage, first_page
from .pdf import print_page
from .words import Words

VIEWER = Path(__file__).parent / "wireframe.js"
"""The viewer of mode shapes in space, an ECMAScript module that the twin's page runs too."""

POLES = Path(__file__).parent / "poles.js"
"""Chooses poles of a stabilisation diagram, and saves the file of the choice."""

PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"

_SECTION = re.compile(r"<section>\n<h2[^>]*>(.*?)</h2>\n(.*?)\n</section>", re.DOTALL)
_NUMBER = re.compile(r"[-+−]?\d[\d.,]*(e[-+−]?\d+)?")
_CHART_TEXT = (
    r'<div class="chart" role="img" aria-label="([^"]*)">'
    r'<script type="application/json">([^<]*)</script></div>'
)
_CHART = re.compile(_CHART_TEXT)
_PICTURE = re.compile(rf'<div class="picture" data-heading="([^"]+)"><figure>{_CHART_TEXT}')

_SENTENCE_END = re.compile(r"(?<=[.!?])\s+(?=[^\Wa-z\d_]|[“±])")
LEAST_WORDS = 4
"""Words [1] from which a sentence is not written twice: "± is one sd." may be."""

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")

DRAW = """
async function unpacked(place) {
  const bytes = Uint8Array.from(atob(place.textContent), (letter) => letter.charCodeAt(0));
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(plain).text();
}
function draw() {
const dark = matchMedia('(prefers-color-scheme: dark)').matches;
const ink = dark ? '#e8ecef' : '#1d2327', line = dark ? '#353d43' : '#d6dce0';
for (const place of document.querySelectorAll('.chart')) {
  const { data, layout } = JSON.parse(place.querySelector('script').textContent);
  place.textContent = '';
  const axes = Object.fromEntries(Object.entries(layout).filter(([k]) => /^[xy]axis/.test(k))
    .map(([k, v]) => [k, { gridcolor: line, zerolinecolor: line, automargin: true, ...v }]));
  Plotly.newPlot(place, data, { margin: { t: 24, r: 16, b: 44 }, paper_bgcolor: 'rgba(0,0,0,0)',
    plot_bgcolor: 'rgba(0,0,0,0)', modebar: { bgcolor: 'rgba(0,0,0,0)' },
    separators: document.documentElement.lang === 'de' ? ',.' : '.,',
    font: { color: ink }, legend: { orientation: 'h', y: 1.02, yanchor: 'bottom' },
    ...layout, ...axes }, { responsive: true, displaylogo: false });
}
}
unpacked(document.querySelector('#library')).then((text) => {
  const library = document.createElement('script');
  library.textContent = text;
  document.head.append(library);
  draw();
  document.dispatchEvent(new Event('drawn'));
});
"""


@dataclasses.dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells below their headings."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclasses.dataclass(frozen=True, slots=True)
class Chart:
    """Traces and layout for plotly.js, and a description of the chart.

    Parameters
    ----------
    words
        Description, for those who do not see the chart as well.
    hint
        What can be done with the chart on a screen; paper leaves it out.
    caption
        Sentences of the description that stand below it; None for all of them.
    """

    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]
    words: str
    hint: str = ""
    caption: str | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Scene:
    """Mode shapes on a wireframe, as `slowtime_services.wireframes.scene_of` gives them."""

    scene: Mapping[str, Any]
    words: str


@dataclasses.dataclass(frozen=True, slots=True)
class PoleChoice:
    """A stabilisation diagram whose poles are clicked to choose modes.

    Its traces "mode" and "other pole" hold the poles.

    Parameters
    ----------
    ending, text
        Of the file of the choice, to which each click adds an edit; it is named after the page.
    """

    chart: Chart
    ending: str
    text: str


Item = Table | Chart | Scene | PoleChoice


@dataclasses.dataclass(frozen=True, slots=True)
class Section:
    """A heading, sentences, and the items below them.

    Parameters
    ----------
    translated
        Whether the texts are in the language of the page; English else.
    """

    heading: str
    words: Sequence[str] = ()
    shown: Sequence[Item] = ()
    translated: bool = False


def write_page(
    path: Path,
    title: str,
    lead: str,
    sections: Sequence[Section],
    *,
    first: FirstPage | None = None,
    picture: Chart | None = None,
    heading: str = "",
    language: str = "en",
) -> None:
    """Write the page as HTML, or as PDF where the path ends so.

    Names out of records are shown, never run.

    Parameters
    ----------
    title, lead
        Heading and sentence of a page without a first page; the title of the file.
    first, picture
        First page, and its one picture, which is not repeated below.
    heading
        Of the details to which the picture belongs; empty for none.
    language
        Of the first page, the headings, the numbers of figures and translated sections; other
        details stay English.

    Raises
    ------
    PrintingError
        Where a PDF cannot be made.
    """
    text = page_text(
        title, lead, sections, first=first, picture=picture, heading=heading, language=language
    )
    if path.suffix.lower() != ".pdf":
        path.write_text(text, encoding="utf-8")
        return
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(text, encoding="utf-8")
        print_page(page, path)


def page_text(
    title: str,
    lead: str,
    sections: Sequence[Section],
    *,
    first: FirstPage | None = None,
    picture: Chart | None = None,
    heading: str = "",
    language: str = "en",
) -> str:
    """Give the HTML of a page, as `write_page` writes it."""
    words = Words(language)
    shown = [picture, *(one for section in sections for one in section.shown)]
    draws = any(isinstance(one, Chart | PoleChoice) for one in shown)
    moves = any(isinstance(one, Scene) for one in shown)
    if first is None:
        head = [f"<h1>{html.escape(title)}</h1>", f"<p>{html.escape(lead)}</p>"]
    else:
        drawn = "" if picture is None else _chart(picture)
        drawn = f'<div class="picture" data-heading="{html.escape(heading)}">{drawn}</div>'
        head = [first_page(first, words, drawn)]
    told = _told(sections, "\n".join(head))
    body = "\n".join([*head, *(_section(section, words) for section in told)])
    scripts = (
        f'<script id="library" type="application/gzip">{_library()}</script>\n'
        f"<script>{DRAW}</script>"
    )
    scripts = scripts if draws else ""
    if any(isinstance(one, PoleChoice) for one in shown):
        scripts = f"<script>\n{POLES.read_text(encoding='utf-8')}</script>\n{scripts}"
    if moves:
        viewer = VIEWER.read_text(encoding="utf-8")
        scripts += f'\n<script type="module">\n{viewer}\ndrawAll();\n</script>'
    return (
        f'<!doctype html>\n<html lang="{language}">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n{scripts}\n</body>\n</html>\n"
    )


@functools.cache
def _library() -> str:
    """Plotly.js, packed to a third of its size; browsers since 2023 unpack it by themselves."""
    # At level 9 it would take twice as long, and be 1 % smaller.
    packed = gzip.compress(PLOTLY.read_bytes(), 5, mtime=0)
    return base64.b64encode(packed).decode("ascii")


def charts_in(page: str) -> Iterator[tuple[str, Chart]]:
    """Yield the charts of a page that `write_page` wrote, each below its heading."""
    sections, _, _ = page.partition("<script>")
    for heading, words, figure in _PICTURE.findall(sections):
        drawn = json.loads(figure)
        told = Chart(drawn["data"], drawn["layout"], html.unescape(words))
        yield html.unescape(heading), told
    for heading, inside in _SECTION.findall(sections):
        for words, figure in _CHART.findall(inside):
            drawn = json.loads(figure)
            yield (
                html.unescape(heading),
                Chart(drawn["data"], drawn["layout"], html.unescape(words)),
            )


def _told(sections: Sequence[Section], head: str) -> Iterator[Section]:
    """Yield sections without sentences that stand before them; none that is left empty."""
    visible = re.sub(r"<script.*?</script>", "", head, flags=re.DOTALL)
    said = [_key(html.unescape(text)) for text in re.findall(r">([^<]+)<", visible)]

    def fresh(text: str) -> str:
        kept = []
        for sentence in _SENTENCE_END.split(text):
            key = _key(sentence)
            if len(key.split()) >= LEAST_WORDS and any(key in one for one in said):
                continue
            said.append(key)
            kept.append(sentence)
        return " ".join(kept)

    def with_fresh_caption(item: Item) -> Item:
        if isinstance(item, Table):
            return dataclasses.replace(item, caption=fresh(item.caption))
        if isinstance(item, Chart):
            return dataclasses.replace(item, caption=fresh(item.words))
        return item

    for section in sections:
        sentences = [one for text in section.words if (one := fresh(text))]
        shown = [with_fresh_caption(one) for one in section.shown]
        if sentences or shown:
            yield dataclasses.replace(section, words=sentences, shown=shown)


def _key(sentence: str) -> str:
    return " ".join(sentence.split()).rstrip(".").casefold()


def _section(section: Section, words: Words) -> str:
    own = "" if section.translated else _of(words)
    told = [f"<p{own}>{html.escape(sentence)}</p>" for sentence in section.words]
    shown = [_item(one, words, own) for one in section.shown]
    inside = "\n".join(told + shown)
    heading = words.heading(section.heading)
    of = _of(words) if heading is None else ""
    return (
        f"<section>\n<h2{of}>{html.escape(heading or section.heading)}</h2>\n{inside}\n"
        "</section>"
    )


def _of(words: Words) -> str:
    """Mark English text on a page of another language."""
    return "" if words.language == "en" else ' lang="en"'


def _item(shown: Item, words: Words, own: str) -> str:
    if isinstance(shown, Table):
        return _table(shown, words, own)
    if isinstance(shown, PoleChoice):
        return _pole_choice(shown, words)
    return _chart(shown, own) if isinstance(shown, Chart) else _scene(shown, words)


def _pole_choice(choice: PoleChoice, words: Words) -> str:
    content = json.dumps({"ending": choice.ending, "text": choice.text}).replace("<", "\\u003c")
    drawn = _chart(choice.chart, _of(words))
    return (
        f'<div class="choice">{drawn}\n<div class="poles"{_of(words)}>'
        f'<script type="application/json">{content}</script></div></div>'
    )


def _scene(scene: Scene, words: Words) -> str:
    content = json.dumps(scene.scene, allow_nan=False).replace("<", "\\u003c")
    return (
        f'<figure><div class="scene"><script type="application/json">{content}</script></div>\n'
        f"<figcaption{_of(words)}>{html.escape(scene.words)}</figcaption></figure>"
    )


def _table(table: Table, words: Words, own: str) -> str:
    head = "".join(
        f'<th scope="col">{html.escape(words.heading(cell) or cell)}</th>'
        for cell in table.headings
    )
    rows = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    caption = html.escape(table.caption)
    caption = f"<caption{own}>{caption}</caption>" if caption else ""
    return (
        f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _cell(text: str) -> str:
    """Write a cell; a number is not broken at its sign."""
    whole = ' class="number"' if _NUMBER.fullmatch(text) else ""
    return f"<td{whole}>{html.escape(text)}</td>"


def _chart(chart: Chart, of: str = "") -> str:
    """Write a chart above its caption, in one block, which page breaks do not divide."""
    figure = json.dumps({"data": chart.data, "layout": chart.layout}, allow_nan=False)
    figure = figure.replace("<", "\\u003c")
    caption = html.escape(chart.words if chart.caption is None else chart.caption)
    hint = f' <span class="hint">{html.escape(chart.hint)}</span>' if chart.hint else ""
    return (
        f'<figure><div class="chart" role="img" aria-label="{html.escape(chart.words)}">'
        f'<script type="application/json">{figure}</script></div>\n'
        f"<figcaption{of}>{caption}{hint}</figcaption></figure>"
    )
