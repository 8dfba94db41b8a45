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
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import plotly

VIEWER = Path(__file__).parent / "wireframe.js"
"""The viewer of mode shapes in space, an ECMAScript module that the twin's page runs too."""

PLOTLY = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"

_SECTION = re.compile(r"<section>\n<h2>(.*?)</h2>\n(.*?)\n</section>", re.DOTALL)
_CHART = re.compile(
    r'<div class="chart" role="img" aria-label="([^"]*)">'
    r'<script type="application/json">([^<]*)</script></div>'
)

STYLE = """
:root { color-scheme: light dark;
        --ink: #1d2327; --paper: #ffffff; --soft: #5b6770; --line: #d6dce0; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8ecef; --paper: #14181b; --soft: #a3b0b8; --line: #353d43; }
}
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
p.soft, caption { color: var(--soft); text-align: left; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.3rem 0.7rem 0.3rem 0;
         border-bottom: 1px solid var(--line); }
.wide { overflow-x: auto; } .chart { height: 26rem; }
"""

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
    .map(([k, v]) => [k, { gridcolor: line, zerolinecolor: line, ...v }]));
  Plotly.newPlot(place, data, { margin: { t: 24, r: 16 }, paper_bgcolor: 'rgba(0,0,0,0)',
    plot_bgcolor: 'rgba(0,0,0,0)', font: { color: ink }, legend: { orientation: 'h', y: 1.12 },
    ...layout, ...axes }, { responsive: true, displaylogo: false });
}
}
unpacked(document.querySelector('#library')).then((text) => {
  const library = document.createElement('script');
  library.textContent = text;
  document.head.append(library);
  draw();
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
    """Traces and layout for plotly.js, and a description of the chart."""

    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]
    words: str


@dataclasses.dataclass(frozen=True, slots=True)
class Scene:
    """Mode shapes on a wireframe, as `slowtime_services.wireframes.scene_of` gives them."""

    scene: Mapping[str, Any]
    words: str


@dataclasses.dataclass(frozen=True, slots=True)
class Section:
    """A heading, sentences, and the items below them."""

    heading: str
    words: Sequence[str] = ()
    shown: Sequence[Table | Chart | Scene] = ()


def write_page(path: Path, title: str, lead: str, sections: Sequence[Section]) -> None:
    """Write the page; names out of records are shown, never run."""
    shown = [one for section in sections for one in section.shown]
    draws = any(isinstance(one, Chart) for one in shown)
    moves = any(isinstance(one, Scene) for one in shown)
    body = "\n".join(
        [
            f"<h1>{html.escape(title)}</h1>",
            f"<p>{html.escape(lead)}</p>",
            *(_section(section) for section in sections),
        ]
    )
    scripts = (
        f'<script id="library" type="application/gzip">{_library()}</script>\n'
        f"<script>{DRAW}</script>"
    )
    scripts = scripts if draws else ""
    if moves:
        viewer = VIEWER.read_text(encoding="utf-8")
        scripts += f'\n<script type="module">\n{viewer}\ndrawAll();\n</script>'
    path.write_text(
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n{scripts}\n</body>\n</html>\n",
        encoding="utf-8",
    )


@functools.cache
def _library() -> str:
    """Plotly.js, packed to a third of its size; browsers since 2023 unpack it by themselves."""
    packed = gzip.compress(PLOTLY.read_bytes(), mtime=0)
    return base64.b64encode(packed).decode("ascii")


def charts_in(page: str) -> Iterator[tuple[str, Chart]]:
    """Yield the charts of a page that `write_page` wrote, each below its heading."""
    sections, _, _ = page.partition("<script>")
    for heading, inside in _SECTION.findall(sections):
        for words, figure in _CHART.findall(inside):
            drawn = json.loads(figure)
            yield (
                html.unescape(heading),
                Chart(drawn["data"], drawn["layout"], html.unescape(words)),
            )


def _section(section: Section) -> str:
    words = [f"<p>{html.escape(sentence)}</p>" for sentence in section.words]
    shown = [_item(one) for one in section.shown]
    inside = "\n".join(words + shown)
    return f"<section>\n<h2>{html.escape(section.heading)}</h2>\n{inside}\n</section>"


def _item(shown: Table | Chart | Scene) -> str:
    if isinstance(shown, Table):
        return _table(shown)
    return _chart(shown) if isinstance(shown, Chart) else _scene(shown)


def _scene(scene: Scene) -> str:
    content = json.dumps(scene.scene, allow_nan=False).replace("<", "\\u003c")
    return (
        f'<div class="scene"><script type="application/json">{content}</script></div>\n'
        f'<p class="soft">{html.escape(scene.words)}</p>'
    )


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{html.escape(cell)}</th>' for cell in table.headings)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
        for row in table.rows
    )
    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    return (
        f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _chart(chart: Chart) -> str:
    figure = json.dumps({"data": chart.data, "layout": chart.layout}, allow_nan=False)
    figure = figure.replace("<", "\\u003c")
    return (
        f'<div class="chart" role="img" aria-label="{html.escape(chart.words)}">'
        f'<script type="application/json">{figure}</script></div>\n'
        f'<p class="soft">{html.escape(chart.words)}</p>'
    )
