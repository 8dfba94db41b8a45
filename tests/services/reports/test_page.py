import base64
import gzip
import json
import re

from slowtime_services.reports import (
    VIEWER,
    Chart,
    Scene,
    Section,
    Table,
    charts_in,
    write_page,
)

HOSTILE = "</script><script>window.hacked = 1</script>"


def written(tmp_path, *shown):
    path = tmp_path / "page.html"
    write_page(path, f"Modes {HOSTILE}", HOSTILE, [Section("Found", [HOSTILE], shown)])
    return path.read_text(encoding="utf-8")


def test_names_out_of_records_are_shown_and_never_run(tmp_path):
    chart = Chart([{"name": HOSTILE, "x": [1.0]}], {"title": HOSTILE}, HOSTILE)
    text = written(tmp_path, Table([HOSTILE], [[HOSTILE]], HOSTILE), chart)
    assert "<script>window.hacked" not in text
    inside = re.search(r'<script type="application/json">(.*?)</script>', text)
    assert inside is not None
    assert json.loads(inside[1])["data"][0]["name"] == HOSTILE


def test_a_page_asks_nobody_for_anything(tmp_path):
    text = written(tmp_path, Chart([{"y": [1.0, 2.0]}], {}, "A line."))
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)=", text)
    packed = re.search(r'<script id="library" type="application/gzip">([^<]*)</script>', text)
    assert packed is not None
    assert b"Plotly" in gzip.decompress(base64.b64decode(packed[1]))


def test_a_page_with_charts_can_be_sent_by_mail(tmp_path):
    assert len(written(tmp_path, Chart([{"y": [1.0, 2.0]}], {}, "A line."))) < 2_500_000


def test_a_page_without_charts_does_without_the_library(tmp_path):
    assert len(written(tmp_path, Table(["f"], [["1"]]))) < 6000


def test_the_charts_of_a_page_can_be_read_out_of_it_again(tmp_path):
    first = Chart([{"name": HOSTILE, "x": [1.0]}], {"title": HOSTILE}, HOSTILE)
    second = Chart([{"y": [1.0, None]}], {}, 'A "line" & more.')
    page = written(tmp_path, first, Table(["f"], [["1"]]), second)
    assert list(charts_in(page)) == [("Found", first), ("Found", second)]
    assert list(charts_in("<h1>of somebody else</h1>")) == []


def test_a_page_with_shapes_in_space_holds_the_viewer_and_asks_nobody(tmp_path):
    scene = {"nodes": [[0, 0, 0]], "names": [HOSTILE], "lines": [], "modes": []}
    text = written(tmp_path, Scene(scene, HOSTILE))
    assert "<script>window.hacked" not in text
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)=", text)
    viewer = VIEWER.read_text(encoding="utf-8")
    assert viewer in text
    assert "</script" not in viewer
    # It is served and embedded alone.
    assert "import " not in viewer
    assert len(text) < 60_000
    inside = re.search(
        r'<div class="scene"><script type="application/json">(.*?)</script>', text
    )
    assert inside is not None
    assert json.loads(inside[1]) == scene
