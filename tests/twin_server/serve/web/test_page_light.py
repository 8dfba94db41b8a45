"""The page is light: one script, packed and kept, and few bytes until the first picture."""

import re

import pytest

from tests.conftest import PATIENCE_MS
from twin_server.serve.web_bundle import bundled

MOST_BYTES = 150_000
"""[bytes] Until the first picture. Source: 0.75 s at 1.6 Mbit/s, a slow mobile connection."""


@pytest.mark.browser
@pytest.mark.parametrize(
    ("place", "picture"),
    [("", "svg.spark"), ("#lab.beam", '[data-quantity="frequency_hz"] svg.drawing')],
)
def test_few_bytes_come_before_the_first_picture(
    serving, ageing, eventually, browser, place, picture
):
    server = serving()
    server.feed(ageing(1000))
    assert eventually(lambda: server.count() == 1000)
    page = browser.new_page()
    try:
        wire, sizes = page.context.new_cdp_session(page), []
        wire.on("Network.loadingFinished", lambda told: sizes.append(told["encodedDataLength"]))
        wire.send("Network.enable")
        # Each reading comes after the first picture, which does not wait for them.
        page.route(re.compile(r"/history\?max_points=1000$"), lambda route: None)
        page.goto(f"{server.url}/{place}")
        page.locator(picture).first.wait_for(timeout=PATIENCE_MS)
        assert 10_000 < sum(sizes) < MOST_BYTES
    finally:
        page.close()


def test_the_script_is_kept_for_good_and_the_page_that_names_it_is_asked_anew(server):
    page = server.get("/")
    [script] = set(re.findall(r"/assets/app-[0-9a-f]+\.js", page.text))
    assert page.headers["cache-control"] == "no-cache"
    answer = server.get(script)
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-encoding"] == "gzip"
    again = server.client.get("/", headers={"If-None-Match": page.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    plain = server.client.get(script, headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.content == answer.content


def test_modules_stay_apart_and_come_after_what_they_import():
    sources = {
        "a.js": 'import { x as y } from "./b.js";\nconst x = 2;\nexport { };\n',
        "b.js": "export const x = 1, f = (a = 3) => a;\nexport function g() {}\n",
    }
    with pytest.raises(ValueError, match="no import or export of a known form"):
        bundled(sources, "a.js")
    sources["a.js"] = 'import { x as y } from "./b.js";\nconst x = 2;\n'
    text = bundled(sources, "a.js").text
    assert text.index("$b = await") < text.index("const { x: y } = $b;")
    assert "return { x, f, g };" in text
    other = bundled(sources | {"b.js": sources["b.js"] + "g();\n"}, "a.js")
    assert other.name != bundled(sources, "a.js").name


@pytest.mark.parametrize(
    ("sources", "said"),
    [
        ({"a.js": 'import { b } from "./b.js";\n'}, "b.js, which a.js needs, is missing"),
        (
            {
                "a.js": 'import { b } from "./b.js";\n',
                "b.js": 'import { a } from "./a.js";\n',
            },
            "a.js → b.js → a.js: modules import each other",
        ),
    ],
)
def test_what_cannot_be_put_together_is_refused(sources, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        bundled(sources, "a.js")


def test_answers_are_packed_for_those_who_ask_and_streams_are_not(server):
    history = "/api/v1/twins/lab.beam/history"
    packed = server.client.get(history, headers={"Accept-Encoding": "gzip"})
    plain = server.client.get(history, headers={"Accept-Encoding": "identity"})
    assert packed.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert packed.json() == plain.json()
    live = f"{server.url}/api/v1/twins/lab.beam/live"
    with server.client.stream("GET", live, headers={"Accept-Encoding": "gzip"}) as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        assert "content-encoding" not in stream.headers
