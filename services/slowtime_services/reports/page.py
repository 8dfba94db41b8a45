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
from collections.abc import Iterator, Sequence
from pathlib import Path

import plotly

from .contents import Chart, Item, PoleChoice, Scene, Section, Table
from .details import English, in_language
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
        Of the page. Sentences of sections that are not translated and that the catalogue does
        not have stay English, and are marked so.

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
    sections = [in_language(section, words) for section in sections]
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
        mark = words.localised(".")
        viewer = VIEWER.read_text(encoding="utf-8")
        spoken = json.dumps(words.group("wireframe"), ensure_ascii=False)
        scripts += (
            f'\n<script type="module">\n{viewer}\ndrawAll({spoken}, "{mark}");\n</script>'
        )
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
    visible = re.sub(
        r'<script.*?</script>|<span class="date">|</span>', "", head, flags=re.DOTALL
    )
    said = [_key(html.unescape(text)) for text in re.findall(r">([^<]+)<", visible)]

    def fresh(text: str) -> str:
        kept = []
        for sentence in _SENTENCE_END.split(text):
            key = _key(sentence)
            if len(key.split()) >= LEAST_WORDS and any(key in one for one in said):
                continue
            said.append(key)
            kept.append(sentence)
        return type(text)(" ".join(kept))

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
    told = [f"<p{_of(one)}>{html.escape(one)}</p>" for one in section.words]
    shown = [_item(one, words) for one in section.shown]
    inside = "\n".join(told + shown)
    heading = f"<h2{_of(section.heading)}>{html.escape(section.heading)}</h2>"
    return f"<section>\n{heading}\n{inside}\n</section>"


def _of(text: str) -> str:
    """Mark English text on a page of another language."""
    return ' lang="en"' if isinstance(text, English) else ""


def _item(shown: Item, words: Words) -> str:
    if isinstance(shown, Table):
        return _table(shown)
    if isinstance(shown, PoleChoice):
        return _pole_choice(shown, words)
    return _chart(shown) if isinstance(shown, Chart) else _scene(shown, words)


def _pole_choice(choice: PoleChoice, words: Words) -> str:
    content = json.dumps(
        {"ending": choice.ending, "text": choice.text, "words": words.group("poles")}
    ).replace("<", "\\u003c")
    return (
        f'<div class="choice">{_chart(choice.chart)}\n<div class="poles">'
        f'<script type="application/json">{content}</script></div></div>'
    )


def _scene(scene: Scene, words: Words) -> str:
    content = json.dumps(scene.scene, allow_nan=False).replace("<", "\\u003c")
    return (
        f'<figure><div class="scene"><script type="application/json">{content}</script></div>\n'
        f"<figcaption{_of(scene.words)}>{html.escape(scene.words)}</figcaption></figure>"
    )


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{html.escape(cell)}</th>' for cell in table.headings)
    rows = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    caption = html.escape(table.caption)
    caption = f"<caption{_of(table.caption)}>{caption}</caption>" if caption else ""
    return (
        f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _cell(text: str) -> str:
    """Write a cell; a number is not broken at its sign."""
    whole = ' class="number"' if _NUMBER.fullmatch(text) else ""
    return f"<td{whole}>{html.escape(text)}</td>"


def _chart(chart: Chart) -> str:
    """Write a chart above its caption, in one block, which page breaks do not divide."""
    figure = json.dumps({"data": chart.data, "layout": chart.layout}, allow_nan=False)
    figure = figure.replace("<", "\\u003c")
    told = chart.words if chart.caption is None else chart.caption
    hint = f' <span class="hint">{html.escape(chart.hint)}</span>' if chart.hint else ""
    return (
        f'<figure><div class="chart" role="img" aria-label="{html.escape(chart.words)}">'
        f'<script type="application/json">{figure}</script></div>\n'
        f"<figcaption{_of(told)}>{html.escape(told)}{hint}</figcaption></figure>"
    )
