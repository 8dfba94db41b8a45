"""The page's messages: complete in every language, all used, and no words beside them."""

import ast
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args

import pytest

from slowtime_schemas.answers.composites import CompositeKind
from slowtime_schemas.answers.diagnoses import DiagnosisState, GapState
from slowtime_schemas.answers.plans import Now
from slowtime_schemas.answers.twins import ConclusionAnswer, FindingKind
from slowtime_schemas.asset_events import AssetEventKind
from slowtime_schemas.files.diagnosis import Where
from slowtime_services.reports import VIEWER
from tests.twin_server.serve.web.javascript import arguments, literals
from twin_server.fairness import HeldKind
from twin_server.orders import Clock
from twin_server.registration.costs import TimeUnit
from twin_server.serve.routes.page import MESSAGES, WEB, languages_of

SOURCES = {path.name: path.read_text(encoding="utf-8") for path in sorted(WEB.glob("*.js"))}
INDEX = (WEB / "index.html").read_text(encoding="utf-8")
CATALOGUES = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))
    for path in sorted(MESSAGES.glob("*.json"))
}
SENTENCES = {tag: catalogue.pop("sentences", {}) for tag, catalogue in CATALOGUES.items()}
"""Of each language, what the server composes in English → the same in that language."""
ENGLISH = CATALOGUES["en"]
ROOT, GAP = Path(__file__).parents[4], "\0"
OTHERS = sorted(CATALOGUES.keys() - {"en"})
PLURALS = {"zero", "one", "two", "few", "many", "other"}
KEY = re.compile(r"[a-z][a-z0-9_]*(?:\.[a-z0-9_{}]+)+")
NO_KEYS = {
    "report.json",
    "augmented.yaml",
    "slowtime.language",
}
"""Files of a diagnosis, and the browser's name of the language chosen."""

NO_WORDS = {
    "Bearer {}", "Escape", "Hz", "({})²/Hz", "{}/shapes{}", "{}cc",
    # Names of traces, by which the page finds them; readers see the messages `chart.…`.
    "forecast band", "time to threshold", "what came after", "not told apart",
    "not valid", "{} forecast band",
    "{}, what came after",
    # Words of the server, by which the page recognises what it has sent.
    " or ", " and ", "The gap", "campaign time [s]",
    # Style sheets: fonts, selectors and classes.
    "{}px {}", "{}px", "system-ui, sans-serif", "header nav a", "thead th", "facts summary",
    "facts sensor", "facts worth",
}  # fmt: skip
"""Literals that look like words and are none that a reader sees."""

ENUMERATED = {
    "composites.kind": get_args(CompositeKind),
    "conclusion": get_args(ConclusionAnswer),
    "diagnosis.clock": get_args(Clock),
    "finding": get_args(FindingKind),
    "gap": set(get_args(GapState)) - {"off"},
    "job": get_args(DiagnosisState),
    "mark.told": get_args(AssetEventKind),
    "plan.act": get_args(Now),
    "next": get_args(FindingKind),
    "place": get_args(Where.model_fields["kind"].annotation),
    "severity": ("info", "warning", "alarm"),
    "under_way.kind": set(get_args(HeldKind)) - {"streams"},
    "unit.plan": get_args(TimeUnit),
}
"""What a key that is completed with a value of the server's must have."""


def forms(message):
    return [message] if isinstance(message, str) else list(message.values())


def placeholders(message):
    return {name for form in forms(message) for name in re.findall(r"\{(\w+)\}", form)}


def keys_in(source):
    """Keys of messages that a source names; `{}` stands for a part that it computes."""
    texts = (one.text for one in literals(source))
    return {text for text in texts if KEY.fullmatch(text) and text not in NO_KEYS}


@pytest.fixture(scope="module")
def named():
    """All keys that the page names."""
    page = set(re.findall(r'data-(?:message|label)="([^"]+)"', INDEX))
    server = {"page.own_name"}
    return page.union(server, *map(keys_in, SOURCES.values()))


def test_every_message_that_the_page_names_exists(named):
    assert len(named) > 300
    missing = [
        key
        for key in named
        if not any(re.fullmatch(key.replace("{}", r"[a-z0-9_]+"), own) for own in ENGLISH)
    ]
    assert missing == []


def test_every_message_is_used(named):
    patterns = [re.compile(re.escape(key).replace(r"\{\}", r"[a-z0-9_]+")) for key in named]
    unused = [key for key in ENGLISH if not any(one.fullmatch(key) for one in patterns)]
    assert unused == []


@pytest.mark.parametrize("prefix", ENUMERATED)
def test_a_message_stands_for_every_value_of_the_server(prefix):
    assert {f"{prefix}.{value}" for value in ENUMERATED[prefix]} <= ENGLISH.keys()


@pytest.mark.parametrize("tag", OTHERS)
def test_every_language_has_every_message(tag):
    catalogue = CATALOGUES[tag]
    assert sorted(ENGLISH.keys() - catalogue.keys()) == [], "missing"
    assert sorted(catalogue.keys() - ENGLISH.keys()) == [], "unknown"
    other = [
        key for key in ENGLISH if placeholders(ENGLISH[key]) != placeholders(catalogue[key])
    ]
    assert other == [], "other placeholders than in English"


JOINTS = re.compile(
    r"\{\w+\}|, and |, after about|\. Repair now: | now|to be done|no longer (?:below|above)"
    r"| of mode|learnt from|\), |\); |\b(?:order a repair|repair|Changed|rose|fell)\b"
)
"""Where the server puts a sentence together: at its values, and between these phrases."""


def texts_of_server():
    """What stands in the code of the server: each text, with a gap where a value comes."""
    for folder in ("twin_server", "slowtime", "schemas/slowtime_schemas"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value
                elif isinstance(node, ast.JoinedStr):
                    parts = (
                        part.value if isinstance(part, ast.Constant) else GAP
                        for part in node.values
                    )
                    yield "".join(map(str, parts))


@pytest.mark.parametrize("tag", [tag for tag in CATALOGUES if SENTENCES[tag]])
def test_every_translated_sentence_is_one_that_the_server_composes(tag):
    every = "\n".join(texts_of_server())
    strange = []
    for english, own in SENTENCES[tag].items():
        assert placeholders(english) == placeholders(own), english
        for part in JOINTS.split(english):
            if re.search("[a-z]{3}", part) and part.strip(" .,:;“”()%") not in every:
                strange.append((english, part))
    assert strange == []


@pytest.mark.parametrize("tag", CATALOGUES)
def test_messages_are_well_formed(tag):
    for key, message in CATALOGUES[tag].items():
        assert all(form.strip() for form in forms(message)), key
        if not isinstance(message, str):
            assert "other" in message, key
            assert message.keys() <= PLURALS, key
            assert "n" in placeholders(message) or "count" in placeholders(message), key


def test_german_is_not_english():
    """Words that are the same in both languages are few, and each is meant."""
    same = {key for key, text in CATALOGUES["de"].items() if text == ENGLISH[key]}
    words = {
        key for key in same if re.search(r"[a-z]{3}", re.sub(r"\{\w+\}", "", str(ENGLISH[key])))
    }
    assert words == {
        "composites.birnbaum", "composites.fussell_vesely", "composites.rate", "form.name",
        "record.text", "sign_in.token", "wireframe.amplitude", "wireframe.chosen",
        "wireframe.mode",
    }  # fmt: skip


def is_prose(text, classes):
    """Whether a literal looks like words: several in a row, or a capitalised one."""
    bare = re.sub(r"<[^>]*>|%\{[^}]*\}|\{\}", " ", text)
    words = re.findall(r"[A-Za-z][\w’'-]*", bare)
    if set(words) <= classes:
        return False
    several = re.search(r"[A-Za-z]{2,},? [A-Za-z]{2,}|^ [a-z]{2,}|[a-z]{2,} $", bare)
    return bool(several or re.search(r"(?<![\w-])[A-Z][a-z]+(?![\w-]*[A-Z(=])", bare))


def test_no_words_stand_in_the_code():
    style = (WEB / "style.css").read_text(encoding="utf-8")
    classes = set(re.findall(r"\.([a-z][\w-]*)", style))
    found = {
        (name, one.text)
        for name, source in SOURCES.items()
        for one in literals(source)
        if is_prose(one.text, classes)
    }
    assert sorted(one for one in found if one[1] not in NO_WORDS) == []
    assert NO_WORDS - {text for _, text in found} == set(), "no longer needed"


SHOWN = {
    r"\bmake\(": 1, r"\bbutton\(": 0, r"\bsay\(": 2, r"\bfield\(": 0,
    r"\blabelled\((?!text)": 0,
    r"new Option\(": 0, r"\.append\(": None, r"new Error\(": 0,
}  # fmt: skip
"""Calls that show a text, and which argument of them it is."""
SETTING = re.compile(
    r"(?:\.(?:textContent|title|placeholder) = |(?:placeholder|caption|text): |"
    r'setAttribute\("(?:aria-label|title|aria-valuetext)", )([^;\n]*)'
)


CALLS = ("t(", "parts(", "make(", "composed(", "of(", "===", "!==", "??")
"""What stands before a literal that names a message, an element or a value."""

NAMES = {
    "slowtime", "{} \u00b7 slowtime", "note", "repair",
    # Elements, classes and attributes.
    "col", "row", "td", "th", "polygon", "polyline", "title", "facts", "limit", "line",
    "line {}", "del", "ins", "writes", "facts for-viewers",
    "interval", "severity", "band", "rest", "shape", "card", "off", "faint",
    "path", "rect", "tspan", "start", "end", "none", "round", "stroke-linejoin", "mark",
    "translate({},{})", "ink", "x-tick", "y-tick", "x-title",
    # Styles of dates, kinds of axes, and what the REST interface calls things.
    "numeric", "short",
    "left", "top", "bottom", "paper", "damping_ratio", "frequency_hz",
    "amplitude", "psd", "{}/{}.json: {} {}",
}  # fmt: skip
"""Literals within what is shown that are not themselves shown, or are names."""


def shown(source):
    """Where the parts of a source stand whose value a reader sees."""
    every = literals(source)
    for call, place in SHOWN.items():
        for match in re.finditer(call, source):
            given = arguments(source, match.end() - 1, every)
            yield from given if place is None else given[place : place + 1]
    for match in SETTING.finditer(source):
        yield match.span(1)


def test_what_is_shown_is_a_message():
    found = set()
    for name, source in SOURCES.items():
        every = literals(source)
        for start, end in shown(source):
            for one in every:
                if not start <= one.start < end:
                    continue
                before = source[: one.start].rstrip()
                message = before.endswith(CALLS)
                if re.search(r"[a-z]{2}", one.text.replace("{}", "")) and not message:
                    found.add((name, one.text))
    found = {one for one in found if not KEY.fullmatch(one[1])}
    assert sorted(one for one in found if one[1] not in NAMES) == []
    assert NAMES - {text for _, text in found} == set(), "no longer needed"


class Words(HTMLParser):
    """Texts of the elements of a page, with the messages that they name."""

    def __init__(self):
        super().__init__()
        self.open, self.found, self.loose = [], {}, []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if "data-label" in given:
            self.found[given["data-label"]] = given["aria-label"]
        if "data-slot" in given and self.open:
            self.add(f"{{{given['data-slot']}}}")
        if tag not in ("meta", "link", "input"):
            self.open.append((tag, given))

    def handle_endtag(self, tag):
        assert self.open.pop()[0] == tag

    def handle_data(self, data):
        inside = {key for _, given in self.open for key in given}
        literal = {"code", "pre", "noscript", "title", "h1", "script"} & {
            t for t, _ in self.open
        }
        if "data-slot" in inside or literal:
            return
        if "data-message" in inside:
            self.add(data)
        elif re.search(r"[a-z]{2}", data):
            self.loose.append(data)

    def add(self, text):
        key = next(g["data-message"] for _, g in reversed(self.open) if "data-message" in g)
        self.found[key] = self.found.get(key, "") + text


def test_the_page_itself_has_the_english_messages():
    words = Words()
    words.feed(INDEX)
    assert [one for one in words.loose if one != "OpenAPI"] == []
    assert len(words.found) >= 30
    assert words.found == {key: ENGLISH[key] for key in words.found}


def test_the_viewer_of_shapes_has_the_english_messages():
    source = Path(VIEWER).read_text(encoding="utf-8")
    table = source[source.index("const ENGLISH = {") : source.index("};\nconst english")]
    own = dict(re.findall(r'(\w+): "([^"]*)"', table))
    known = {k.removeprefix("wireframe."): v for k, v in ENGLISH.items() if "wireframe." in k}
    assert own == known


def test_a_further_language_needs_only_a_file(tmp_path):
    for tag, catalogue in {**CATALOGUES, "eo": {"page.own_name": "Esperanto"}}.items():
        (tmp_path / f"{tag}.json").write_text(json.dumps(catalogue), encoding="utf-8")
    assert languages_of(tmp_path) == {"de": "Deutsch", "en": "English", "eo": "Esperanto"}
