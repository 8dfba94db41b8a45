"""A report in German is German throughout: laws of all kinds and of all that is composed."""

import ast
import dataclasses
import html
import json
import re
from pathlib import Path

import pytest

from slowtime.discrepancy.diagnosis import Experiment, Rival
from slowtime.discrepancy.report import notes, sentences
from slowtime.dynamics.effects import Place
from slowtime.dynamics.effects.effect_catalogue import catalogue
from slowtime.reliability import Problem, Result, marginal
from slowtime_cli.records.mac_charts import mac_charts
from slowtime_services.diagnose import document_of, write_report
from slowtime_services.reports import Chart, Section, Table, Words, page_text
from slowtime_services.reports.details import in_language
from slowtime_services.reports.kinds.reliability import write_reliability_report
from slowtime_services.reports.words import FOLDER
from tests.services.diagnose.slide import told
from tests.services.reports.reports_of_each_kind import (
    WRITERS,
    modal_result,
    modes_with_shapes,
)

ROOT = Path(__file__).parents[3]
GERMAN, ENGLISH = (
    json.loads((FOLDER / f"{tag}.json").read_text(encoding="utf-8")) for tag in ("de", "en")
)
LEAST_WORDS = 3
"""Words of an English text from which it is looked for [1]: single ones may be names."""

OWNERS = ("the beam breaks", "50 years", "order a repair for an age of 3 years from now on")
"""What owners have written, and an option of a kind that is not known: they stay."""

FUNCTION_WORDS = re.compile(
    r"\b(the|of|is|are|were|and|or|with|without|from|which|that|not|no|for|by|to|it|its)\b",
    re.IGNORECASE,
)
COMPOSED = (
    "slowtime/discrepancy",
    "slowtime/reliability",
    "slowtime/history_diagnosis/reporting",
)
GAP = "\0"


def undecided(path, language):
    """Write the report of a diagnosis that names two rivals and an experiment."""
    rivals = (
        Rival("coulomb", Place("element", "j"), 0.5),
        Rival("nothing_missing", Place("element", "j"), 0.4),
    )
    sentence = (
        "These records do not tell whether something is missing. Possible explanations: Dry "
        "friction (coulomb) at element j or nothing, or only wrong constants of the model."
    )
    advice = Experiment("Repeat the strongest record at half its level.", level=0.5)
    found = dataclasses.replace(
        told(), verdict="undecided", effects=(), undecided=rivals, experiment=advice,
        sentence=f"{sentence} Experiment that would decide: {advice.sentence}"
        + sentences.NEARER,
        notes=(notes.LOUD, notes.FLOATS, notes.LITTLE, notes.NOT_KEPT),
    )  # fmt: skip
    write_report(path, found, document_of(found, records=["a.csv"]), language=language)


def warned(path, language):
    """Write the report of an estimate with warnings, and of a method that does not apply."""
    problem = Problem({"x": marginal("normal", mean=5.0, sd=1.0)}, lambda x: x[:, 0])
    said = (
        "After 2000 calls the coefficient of variation is 0.2, not the 0.05 aimed at. Allow "
        "more calls, or use another method."
    )
    found = [
        Result("subset", 1.8e-3, (1.2e-3, 2.6e-3), "", 0.2, 2000, warnings=(said,)),
        Result("mean-value", 1e-3, None, "an approximation of unknown error", None, 3),
    ]
    refused = {"form": "No part has a design point. Use a sampling method instead."}
    write_reliability_report(path, "b.yaml", problem, found, refused, seed=1, language=language)


EVERY = {**WRITERS, "shapes": modes_with_shapes, "undecided": undecided, "warned": warned}


def visible(page):
    """All that a reader of a page sees or hears: texts, descriptions, and texts of figures."""
    body = page.partition("<body>")[2]
    figures = re.findall(r'<script type="application/json">(.*?)</script>', body, re.DOTALL)
    texts = re.findall(r'(?:aria-label|title)="([^"]*)"', body)
    body = re.sub(r"<script.*?</script>", "", body, flags=re.DOTALL)
    texts += re.findall(r">([^<]+)<", body)
    for figure in figures:
        drawn = json.loads(figure)
        texts += list(
            strings_in({part: drawn.get(part) for part in ("data", "layout", "words")})
        )
    return [" ".join(html.unescape(text).split()) for text in texts]


STRUCTURE = ("type", "mode", "meta", "fill", "dash", "symbol", "color", "colorscale", "xref")


def strings_in(value, key=""):
    """Texts of a figure, without settings of the drawing library."""
    if isinstance(value, dict):
        for name, inside in value.items():
            if name not in STRUCTURE:
                yield from strings_in(inside, name)
    elif isinstance(value, list):
        for inside in value:
            yield from strings_in(inside, key)
    elif isinstance(value, str) and key in ("name", "text", "x", "y", "how", "save", "saved"):
        yield value


@pytest.fixture(params=EVERY)
def page(tmp_path, request):
    path = tmp_path / "report.html"
    EVERY[request.param](path, "de")
    return path.read_text(encoding="utf-8")


def literal(english):
    """An English text as a pattern, with any value in the place of each."""
    parts = [re.escape(part) for part in re.split(r"\{\w+\}", english)]
    return re.compile(r"(?<!\w)" + ".{1,200}?".join(parts) + r"(?!\w)")


def test_no_english_text_of_the_messages_is_in_a_german_report(page):
    texts = "\n".join(visible(page))
    english = [*ENGLISH["messages"].values(), *GERMAN["sentences"], *GERMAN["headings"]]
    german = {*GERMAN["messages"].values(), *GERMAN["sentences"].values()}
    long = [
        text for text in english
        if len(re.findall(r"[A-Za-z]{2,}", re.sub(r"\{\w+\}", "", text))) >= LEAST_WORDS
    ]  # fmt: skip
    assert len(long) > 500
    assert [text for text in long if text not in german and literal(text).search(texts)] == []


def test_no_function_word_of_english_is_in_a_german_report(page):
    assert 'lang="en"' not in page
    texts = "\n".join(visible(page))
    for own in OWNERS:
        texts = texts.replace(own, "")
    found = [line for line in texts.splitlines() if FUNCTION_WORDS.search(line)]
    assert found == []


def test_numbers_of_german_details_have_decimal_commas(page):
    body = re.sub(r"<script.*?</script>", "", page.partition("</header>")[2], flags=re.DOTALL)
    cells = [html.unescape(cell) for cell in re.findall(r"<td[^>]*>([^<]*)</td>", body)]
    assert [cell for cell in cells if re.search(r"(?<![\w.])\d+\.\d{1,2}(?!\d|\.)", cell)] == []


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_every_effect_of_the_catalogue_has_german_words(name):
    kind, words = catalogue()[name], Words("de")
    for text in (kind.words, kind.sentence, kind.family, name.replace("_", " ")):
        assert words.told(text), text
    assert [one.meaning for one in kind.parameters if not words.told(one.meaning)] == []


def composed(folder):
    """Whole sentences in the code of a folder, each with a gap where a value comes."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        left_out = {
            id(inside)
            for node in ast.walk(tree)
            if isinstance(node, ast.Raise | ast.JoinedStr)
            or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
            for inside in ast.walk(node)
            if inside is not node
        }
        for node in ast.walk(tree):
            if id(node) in left_out:
                continue
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = re.sub(r"\{\w+(:[^}]*)?\}", GAP, node.value)
            elif isinstance(node, ast.JoinedStr):
                text = "".join(
                    str(part.value) if isinstance(part, ast.Constant) else GAP
                    for part in node.values
                )
            else:
                continue
            if re.fullmatch(r"[ A-Z\0].* .* .* .*\.", text, re.DOTALL):
                yield from re.split(r"(?<=[.?!]) (?=[A-Z“])", text.strip())


@pytest.mark.parametrize("folder", COMPOSED)
def test_every_whole_sentence_of_the_analysis_has_a_german_one(folder):
    every = "\n".join(re.sub(r"\{\w+\}", GAP, english) for english in GERMAN["sentences"])
    missing = []
    for sentence in composed(folder):
        parts = [part.strip(" ,.;:()'") for part in sentence.split(GAP)]
        if not all(part in every for part in parts if len(part.split()) >= LEAST_WORDS):
            missing.append(sentence.replace(GAP, "{}"))
    assert missing == []


def test_translations_have_the_values_of_the_english_ones():
    for english, own in GERMAN["sentences"].items():
        assert set(re.findall(r"\{\w+\}", english)) == set(re.findall(r"\{\w+\}", own)), english


@pytest.mark.parametrize(
    ("english", "german"),
    [
        (
            "Stick-slip friction (stribeck) at element j: friction of sliding 3.2 ± 0.1 N, "
            "friction of sticking 4.00 ± 0.20 N. Dry friction that is greater at rest and at "
            "low speed.",
            "Stick-Slip-Reibung (stribeck) an Element j: Gleitreibung 3,2 ± 0,1 N, "
            "Haftreibung 4,00 ± 0,20 N. Trockene Reibung, die in Ruhe und bei kleiner "
            "Geschwindigkeit größer ist.",
        ),
        (
            "With the updated model, the error on the held-out record falls from 30 % to "
            "2.1 %, the noise floor.",
            "Mit dem korrigierten Modell fällt der Fehler auf der zurückgehaltenen "
            "Aufzeichnung von 30 % auf 2,1 %, den Rauschboden.",
        ),
        (
            "No effect is missing, but constants are outside their tolerances: stiffness j = "
            "1,850 ± 1 N/m, mass m = 2.10 ± 0.01 kg.",
            "Kein Effekt fehlt, aber Konstanten liegen außerhalb ihrer Toleranzen: "
            "Steifigkeit j = 1.850 ± 1 N/m, Masse m = 2,10 ± 0,01 kg.",
        ),
        (
            "Of the laws in slowtime's catalogue, it most resembles Hysteresis (bouc_wen) "
            "(80 % of its force; not above 0.1 m and 2 m/s) and Dry friction (coulomb) (30 % "
            "of its force) along the motion of these records.",
            "Von den Gesetzen des Katalogs ähnelt sie längs der Bewegung dieser "
            "Aufzeichnungen am meisten: Hysterese (bouc_wen) (80 % ihrer Kraft; nicht über "
            "0,1 m und 2 m/s) und trockene Reibung (coulomb) (30 % ihrer Kraft).",
        ),
        (
            "What the model leaves unexplained stands out between 0.08 and 8.1 Hz, between 10 "
            "and 12 Hz.",
            "Was das Modell nicht erklärt, sticht hervor zwischen 0,08 und 8,1 Hz, zwischen 10 "
            "und 12 Hz.",
        ),
        (
            "What the model leaves unexplained stands out at campaign times 2.5 to 3.8 s.",
            "Was das Modell nicht erklärt, sticht hervor zu den Zeiten 2,5 bis 3,8 s der "
            "Messreihe.",
        ),
    ],
)
def test_sentences_are_translated_with_their_values(english, german):
    assert Words("de").told(english) == german
    assert Words("en").told(english) == english


def in_german(charts):
    shown = in_language(Section("Shapes", (), charts), Words("de")).shown
    return [chart for chart in shown if isinstance(chart, Chart)]


def test_figures_of_a_german_mac_have_decimal_commas():
    [chart] = in_german(mac_charts(modal_result(), []))
    assert chart.data[0]["text"][0] == ["1,00", "0,09"]
    assert chart.layout["xaxis"]["ticktext"] == ["2,5 Hz", "7 Hz"]
    # Names of channels stay, with the marks that they have.
    named = dataclasses.replace(chart, layout={"xaxis": {"ticktext": ["b 1.5"]}})
    [chart] = in_german([named])
    assert chart.layout["xaxis"]["ticktext"] == ["b 1.5"]


def test_a_german_report_quotes_what_the_file_says_of_failure_and_period(tmp_path):
    WRITERS["reliability"](tmp_path / "r.html", "de")
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "Versagen heißt nach der Datei: „the beam breaks“" in text
    assert "als Zeitraum angibt: „50 years“." in text


def test_what_nobody_has_translated_stays_and_is_marked_and_names_are_not_changed():
    table = Table(
        ("channel", "fault"), [("stuck", "stuck"), ("b 1.5", "3.2 %")], names=("channel",)
    )
    formula = "1 - moment / (0.03 * yield) ≤ 0"
    section = Section("Channels", ["A plug-in found 1.5 faults.", formula], [table])
    page = page_text("t", "l", [section], language="de")
    assert '<p lang="en">A plug-in found 1.5 faults.</p>' in page
    assert f"<p>{formula}</p>" in page
    assert "<td>stuck</td><td>hängt fest</td>" in page
    assert "<td>b 1.5</td><td>3,2 %</td>" in page
