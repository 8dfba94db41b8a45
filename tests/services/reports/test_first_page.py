"""Every kind of report has the same first page, in both languages, on paper and on a phone."""

import copy
import dataclasses
import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from slowtime.dynamics.description import Description, Node, Spring
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.subspace.stabilisation import Stabilisation
from slowtime_cli.records.mode_tables import (
    AMBIENT,
    _spectra_caption,
    line_sections,
    mode_table,
)
from slowtime_services.diagnose.first_pages import sketch_of
from slowtime_services.reports import (
    LANGUAGES,
    FirstPage,
    Improvement,
    PrintingError,
    Table,
    Words,
    level_of,
    pdf,
)
from slowtime_services.reports.first_page import Confidence, first_page, made_on
from slowtime_services.reports.kinds.mode_doubts import doubts_of
from slowtime_services.reports.kinds.modes import Compared, modes_page
from slowtime_services.reports.kinds.plan import plan_page, write_plan_report
from slowtime_services.reports.kinds.plan_details import plan_sections
from slowtime_services.reports.kinds.plan_options import amount_text
from slowtime_services.reports.kinds.plan_pictures import change_chart
from slowtime_services.reports.kinds.state import (
    Reference,
    _picture,
    state_page,
    write_state_report,
)
from slowtime_services.reports.page import STYLE
from slowtime_services.reports.words import FOLDER
from tests.services.reports.reports_of_each_kind import (
    CHANNELS,
    WRITERS,
    modal_result_of,
    mode_at,
    plan_answer,
    states,
)

SAYS = {
    ("modes", "en"): ["Which natural frequencies and modes of vibration does “tower” have?",
                      "2.5000 ± 0.0050 Hz",
                      "1.20 ± 0.10 %", "7 Hz", "few orders", "10.00 Hz", "40 Hz", "600 s",
                      "Data tower.csv", "Measured (UTC) 2026-03-04 10:20"],
    ("modes", "de"): ["Welche Eigenfrequenzen und Moden hat „tower“?", "2,5000 ± 0,0050 Hz",
                      "1,20 ± 0,10 %",
                      "Abtastrate", "eine Mode verdecken können"],
    ("diagnosis", "en"): ["What does the model slide lack?", "cubic hardening at element j",
                          "gap symmetric", "Against the model as given the error falls by",
                          "Against the refitted model", "50 Hz", "learn.npz", "element j"],
    ("diagnosis", "de"): ["Was fehlt dem Modell slide?", "kubische Versteifung an Element j",
                          "Gegenüber dem gegebenen Modell sinkt der Fehler um",
                          "Gegenüber dem angepassten Modell"],
    ("reliability", "en"): ["How probable is a failure of Beam?", "That is too high: ",
                            "With 95 % certainty it is between 0.03", "Data beam.yaml",
                            "first-order approximation: 0.0385",
                            "The answer is the same by all of these: too high.",
                            "better; it matters most (about 50 % of the uncertainty)"],
    ("reliability", "de"): ["Wie wahrscheinlich ist ein Versagen von Beam?",
                            "Mit 95 % Sicherheit liegt sie zwischen 0,03", "Das ist zu viel: ",
                            "Näherung erster Ordnung: 0,0385",
                            "Die Antwort ist nach allen diesen dieselbe: zu viel.",
                            "zählt am meisten (etwa 50 % der Unsicherheit)"],
    ("plan", "en"): ["What is to be done with Tower, and by when?",
                     "Last safe day to order a repair: 2028-12-28 (in 2.1 years).",
                     "61,200 EUR", "order a repair for an age of 3 years", "0.5 years",
                     "Sure that waiting is cheaper than acting today.", "Data demo.tower"],
    ("plan", "de"): ["Was ist mit Tower zu tun, und bis wann?",
                     "Letzter sicherer Tag, eine Reparatur zu bestellen: 2028-12-28 "
                     "(in 2,1 Jahren).", "61.200 EUR", "0,5 Jahren",
                     "Sicher, dass Abwarten billiger ist, als heute zu handeln."],
    ("state", "en"): ["Has lab.beam changed, and by how much?",
                      "At 40 d, by the last reading alone, the natural frequency has "
                      "fallen by 13.40 ± 0.58 %",
                      "equally sure that the stiffness fell, if mass,",
                      "unchanged, the stiffness has fallen by 25.0 ± 1.0 %.",
                      "33.3 ± 1.8 % more mass instead", "3 (The nominal model is"],
    ("state", "de"): ["Hat sich lab.beam geändert, und um wie viel?",
                      "Bei 40 d ist die Eigenfrequenz, nach der letzten Messung allein, "
                      "gegenüber dem Bezug der Anmeldung "
                      "um 13,40 ± 0,58 % gesunken.",
                      "ist die Steifigkeit um 25,0 ± 1,0 % gesunken.",
                      "stattdessen 33,3 ± 1,8 % mehr Masse"],
}  # fmt: skip

"""Kinds whose details are in the language of the page."""

EACH = [(kind, language) for kind in WRITERS for language in LANGUAGES]


def written(tmp_path, kind, language, ending="html"):
    path = tmp_path / f"{kind}.{ending}"
    WRITERS[kind](path, language)
    return path


@pytest.mark.parametrize(("kind", "language"), EACH)
def test_the_first_page_answers_and_says_how_sure_and_what_to_do(tmp_path, kind, language):
    page = written(tmp_path, kind, language).read_text(encoding="utf-8")
    assert f'<html lang="{language}">' in page
    found = re.search(r'<header class="first">(.*?)</header>', page, re.DOTALL)
    assert found is not None
    head = found[1]
    text = html.unescape(re.sub(r"<script.*?</script>|<[^>]+>", " ", head, flags=re.DOTALL))
    text = " ".join(text.split())
    for said in SAYS[kind, language]:
        assert said in text
    # One question, one answer, one picture, and a list of what to do.
    for part in ("question", "confidence", "alternatives", "do", "facts", "chart"):
        assert len(re.findall(rf'class="{part}[ "]', head)) == 1, part
    assert len(re.findall("<h1[ >]", page)) == 1
    assert re.search(r'<div class="do"><h2>[^<]*</h2><ol>\s*<li>.+</li>', head)
    # Alternatives stand beside the answer: within its row, before the picture.
    assert head.index("alternatives") < head.index('class="chart"')
    assert re.search(r'<p class="confidence (high|medium|low)"><strong>[^<]+</strong>', head)
    assert re.search(r"slowtime \d", text)
    assert made_on() in text
    if kind == "diagnosis":
        assert '<svg viewBox="0 0 640' in head
        for stray in ("It is steady.", "It is linear.", ">score<"):
            assert stray not in page


@pytest.mark.parametrize("kind", list(WRITERS))
def test_headings_of_details_are_of_the_same_language(tmp_path, kind):
    page = written(tmp_path, kind, "de").read_text(encoding="utf-8")
    body = page.partition("</header>")[2]
    for heading in re.findall(r"<h2([^>]*)>", body):
        assert "lang" not in heading
    assert 'lang="en"' not in body
    english = set(json.loads((FOLDER / "de.json").read_text())["headings"])
    cells = [html.unescape(cell) for cell in re.findall(r'<th scope="col">([^<]*)</th>', body)]
    same = {"option", "5 %", "95 %", "p-value", "beta [1]", "P_f [1]", "parameters"}
    assert not (set(cells) & english) - same - {"Option"}


def test_both_languages_have_the_same_messages_with_the_same_places():
    en, de = (json.loads((FOLDER / f"{one}.json").read_text())["messages"] for one in LANGUAGES)
    assert en.keys() == de.keys()
    for key, message in en.items():
        assert set(re.findall(r"\{\w+\}", message)) == set(re.findall(r"\{\w+\}", de[key])), key


def test_an_improvement_is_stated_against_both_models():
    page = FirstPage(
        kind="diagnosis", subject="s", question="q", answer="a",
        confidence=Confidence("high", ""), actions=["do"], measured="",
        improvement=Improvement(
            given=40.0, refitted=20.0, final=5.0, floor=1.0, unit="%", meaning="Of what."
        ),
    )  # fmt: skip
    text = " ".join(re.sub(r"<[^>]+>", " ", first_page(page, Words("en"), "")).split())
    assert "the error falls by 87.5 %." in text
    assert "to which nothing was added, it falls by 75 %." in text
    assert text.count("40 % 20 % 5 % 1 %") == 1
    assert page.improvement is not None
    tiny = dataclasses.replace(page.improvement, final=0.01)
    same = dataclasses.replace(page, improvement=dataclasses.replace(tiny, refitted=39.0))
    assert first_page(same, Words("en"), "").count("falls by 100") == 1


def test_a_change_that_is_not_certain_is_not_called_one():
    for loss, sd, level, said in (
        (0.25, 0.01, "high", "has fallen by 25.0 ± 1.0 %"),
        (0.01, 0.02, "high", "shows no change: −1.0 ± 2.0 %"),
        (0.03, 0.02, "medium", "no change of the stiffness is certain: −3.0 ± 2.0 %"),
    ):
        page = state_page("b", states(loss, sd), "stiffness", Words("en"))
        assert page.confidence.level == level
        assert said in page.answer
    # How much a change of 1 ± 2 % may be at most is known, and that is the answer.
    small = state_page("b", states(0.01, 0.02), "stiffness", Words("en"))
    assert "within ±4.9 %" in small.confidence.number


def test_what_a_frequency_knows_is_said_where_its_parts_are_not_known():
    """Stiffness and mass err together: of neither a change is certain, of their ratio it is."""
    told = states(0.1, 0.09)
    told[-1] |= {"mass_change": {"value": 0.1, "sd": 0.11}, "correlation": 0.9999}
    page = state_page("b", told, "both", Words("en"))
    assert page.answer.startswith(
        "At 40 d, by the last reading alone, the ratio of stiffness to mass has fallen by 18.18"
    )
    assert page.confidence.level == "high"
    assert any("tell stiffness from mass" in action for action in page.actions)
    assert [one.name for one in page.alternatives][:2] == [
        "18.18 ± 0.12 % less stiffness instead",
        "22.22 ± 0.17 % more mass instead",
    ]
    told[-1] |= {"correlation": 0.0}
    assert "ratio of stiffness" not in state_page("b", told, "both", Words("en")).answer


def test_headline_and_picture_of_a_state_are_of_the_same_quantity():
    sure, small = states(0.25), states(0.01, 0.02)
    chart = _picture(sure, "stiffness", Words("en"))
    assert chart.layout["yaxis"]["title"]["text"] == "change of frequency [%]"
    # The last point is the number of the headline.
    assert chart.data[1]["y"][-1] == pytest.approx(-13.40, abs=0.005)
    chart = _picture(small, "stiffness", Words("en"))
    assert chart.layout["yaxis"]["title"]["text"] == "change of stiffness [%]"
    assert chart.data[1]["y"][-1] == pytest.approx(-1.0)


def test_what_was_not_measured_is_not_said_to_fit():
    page = state_page("b", states(0.25), "stiffness", Words("en"))
    assert [one.name for one in page.alternatives] == ["33.3 ± 1.8 % more mass instead"]
    assert page.weighed == "Temperature, load, supports: not measured, so not ruled out."
    assert page.actions[0].startswith("Have the structure inspected")
    assert page.actions[-1].startswith("Commands: slowtime twin plan")
    assert state_page("b", states(0.01, 0.02), "stiffness", Words("en")).weighed == ""


def stepped(size):
    """Epochs of a frequency of 3 ± 0.01 Hz that steps after epoch 24."""
    rng = np.random.default_rng(1)
    told = states(0.0)
    for k, one in enumerate(told):
        hz = 3.0 * (1.0 + size * (k > 24)) + 0.01 * rng.standard_normal()
        one |= {"frequency_hz": {"value": hz, "sd": 0.01}}
    return told


def test_a_step_of_the_history_is_told_with_its_instant():
    page = state_page("b", stepped(-0.1), "stiffness", Words("en"))
    assert "Step: between 24 d and 25 d the frequency fell by about" in page.definition
    size = float(re.findall(r"fell by about ([\d.]+) %", page.definition)[0])
    assert size == pytest.approx(10.0, abs=0.5)
    assert page.actions[0].startswith("Find out first what happened at the step")
    assert "Step" not in state_page("b", stepped(0.0), "stiffness", Words("en")).definition
    # An even decline is no step.
    assert "Step" not in state_page("b", states(0.25), "stiffness", Words("en")).definition


def test_a_state_is_counted_from_the_reference_that_there_is():
    told = states()
    for one in told:
        one |= {"slow_time_unit": None, "t_ns": 0}
    learnt = state_page("b", told, "stiffness", Words("en"), reference=Reference(None, 20))
    assert "At 40 time units, by the last reading alone, the natural frequency" in learnt.answer
    assert "% since the first 20 epochs." in learnt.answer
    assert "Slow time has no unit in this file." in learnt.definition
    given = state_page("b", told, "stiffness", Words("de"), reference=Reference(4.0))
    assert "gegenüber den gegebenen 4 Hz" in given.answer
    for page in (learnt, given):
        assert not re.search("as built|seit dem Bau", page.answer + page.definition)


def test_a_state_in_seconds_of_the_calendar_has_dates(tmp_path):
    told = [
        one | {"slow_time": 1.77e9 + 86400.0 * k, "slow_time_unit": "s",
               "t_ns": round(1e9 * (1.77e9 + 86400.0 * k))}
        for k, one in enumerate(states())
    ]  # fmt: skip
    page = state_page("b", told, "stiffness", Words("en"))
    assert page.answer.startswith("At 2026-03-14 02:40 UTC, by the last reading alone, the")
    german = state_page("b", told, "stiffness", Words("de"))
    assert german.answer.startswith("Am 2026-03-14 02:40 UTC ist die Eigenfrequenz")
    facts = dict(page.facts)
    assert (facts["From"], facts["Until"]) == ("2026-02-02 02:40 UTC", "2026-03-14 02:40 UTC")
    path = tmp_path / "state.html"
    write_state_report(path, "b.csv", told, "stiffness")
    text = path.read_text(encoding="utf-8")
    assert "<td>2026-03-14 02:40</td>" in text
    assert "10⁹" not in text
    drawn = re.search(r'<script type="application/json">(.*?)</script>', text)
    assert drawn is not None
    figure = json.loads(drawn[1])
    assert figure["layout"]["xaxis"]["title"]["text"] == "date (UTC)"
    assert figure["layout"]["xaxis"]["tickformat"] == "%Y-%m-%d"
    assert figure["data"][1]["x"][-1] == "2026-03-14 02:40"


def test_a_plan_names_what_it_is_compared_with_however_dear(tmp_path):
    plan = plan_answer()
    plan["options"][2]["cost"]["value"] = 9e6
    plan["options"] += [copy.deepcopy(plan["options"][1]) for _ in range(4)]
    beside = plan_page(plan, Words("en")).alternatives
    # Of the three that are shown it is the dearest, and they stand in the order of costs.
    assert len(beside) == 3
    assert beside[-1].name == "order the repair now, done in 0.5 years"
    assert beside[0].measure == "63,000 EUR, 1,800 EUR more"


def test_a_german_state_is_german_to_its_last_row(tmp_path):
    told, path = states() * 2, tmp_path / "state.html"
    learning = (
        "The nominal model is still being learnt from the first epochs. Wait, or give the "
        "nominal frequency and damping ratio in the twin's registration."
    )
    told = [one | {"slow_time": float(k)} for k, one in enumerate(told)]
    told[0] |= {"reasons": [learning]}
    told = [one | {"reasons": one["reasons"] and [learning]} for one in told]
    write_state_report(path, "b.csv", told, "stiffness", language="de")
    body = path.read_text(encoding="utf-8").partition("</header>")[2].partition("<script")[0]
    text = html.unescape(re.sub(r"<[^>]+>", " ", body))
    assert not re.search(r"\b(the|is|yes|no|Wait|slow|valid|shown)\b", text)
    assert "Der Bezug wird noch aus den ersten Epochen gelernt." in text
    assert "41 von 82 Epochen sind gezeigt" in text
    assert re.findall(r"<tr><td[^>]*>([^<]*)<", body)[-1] == "81"
    assert "25,0 ± 1,0" in text


def test_a_plan_whose_last_safe_day_has_passed_says_so_first():
    plan = plan_answer()
    plan["action"] = "repair"
    plan["last_order"] |= {"status": "passed", "order": None}
    page = plan_page(plan, Words("en"))
    assert page.answer.startswith("Order the repair now. The last safe time to order a repair")
    assert any(action.startswith("Order now: done 2027-05-22") for action in page.actions)
    refused = plan_page(plan | {"options": [], "sentence": "Too few."}, Words("de"))
    assert refused.answer == "Es gibt keinen Plan: Too few."


def test_a_plan_tells_the_present_state_and_how_near_the_limit_is():
    plan = plan_answer()
    plan["last_order"]["now_probability"] = 0.031
    told = plan_page(plan, Words("en")).definition
    assert told.startswith(
        "By the trend of all readings, if mass, temperature and supports are unchanged. "
        "Failure within the 0.5 years that a repair takes if ordered now: 3.1 %."
    )
    assert "“today”: the last reading (812.5 d, 2026-11-21 04:00 UTC); all times" in told
    answer = plan_page(plan, Words("en")).answer
    assert answer.endswith(
        "The stiffness is down by 18.7 ± 1.2 %; at 30 % it counts as failed."
    )
    german = plan_page(plan, Words("de")).definition
    assert german.startswith("Nach dem Verlauf aller Messungen, wenn Masse,")
    assert "um 18,7 ± 1,2 % gesunken; ab 30 %" in plan_page(plan, Words("de")).answer
    assert "Die Steifigkeit sinkt um mehr als 30 %." in german
    assert "unit" not in told
    bare = plan | {"time_unit": "slow_time", "slow_time_unit": None, "seconds": None}
    assert "slow time has no unit in this file." in plan_page(bare, Words("en")).definition


def test_differences_of_costs_follow_from_the_printed_costs():
    plan = plan_answer()
    costs = (72_146.3, 73_007.6, 74_160.4)
    for option, cost in zip(plan["options"], costs, strict=True):
        option["cost"]["value"] = cost
    plan["difference"] |= {"other": plan["options"][2]["words"], "value": 2014.1}
    plan["difference"] |= {"lo": 1903.4, "hi": 2122.2}
    page = plan_page(plan, Words("en"))
    assert [one.measure for one in page.alternatives] == [
        "73,000 EUR, 900 EUR more", "74,200 EUR, 2,100 EUR more",
    ]  # fmt: skip
    assert "– costs 2,100 EUR more (90 % interval: 1,900 EUR to 2,120 EUR)." in (
        page.confidence.number
    )
    # A printed difference outside the interval calls for more digits.
    plan["difference"] |= {"lo": 1990.0, "hi": 2030.0}
    page = plan_page(plan, Words("en"))
    assert "72,150 EUR" in page.answer
    assert "– costs 2,010 EUR more" in page.confidence.number
    assert "costs 2,010 EUR more" in reasons_of(plan, Words("en"))


def test_a_plan_tells_the_risk_of_following_it_beside_the_accepted_one():
    plan = plan_answer()
    plan["options"][0]["failures"] = 0.0
    plan["last_order"]["limit"] = 0.02
    assert plan_page(plan, Words("en")).confidence.number.endswith(
        "if the plan is followed: < 0.1 %; accepted until a repair takes effect: 2 %."
    )
    plan["options"][0]["failures"] = 1.4
    plan["last_order"]["limit"] = None
    assert "followed: at most 100 %." in plan_page(plan, Words("en")).confidence.number
    plan["options"][0]["failures"] = 0.031
    assert "followed: at most 3.1 %." in plan_page(plan, Words("en")).confidence.number


def test_a_plan_that_waits_for_a_threshold_is_one_instruction():
    plan = plan_answer()
    done = {"ahead": 2.0, "slow_time": 1543.0, "t": "2028-11-21T00:00:00+00:00"}
    plan["options"][0] |= {"repair": [done, done, done]}
    page = plan_page(plan, Words("en"))
    said = (
        "Do not order yet. Order the repair when −25.5 % is reached (expected about "
        "2028-05-22), at the latest 2028-12-28 (in 2.1 years)."
    )
    assert said in page.actions
    assert not any("Follow the plan" in one or "calendar" in one for one in page.actions)
    german = plan_page(plan, Words("de")).actions
    assert any(
        one.startswith("Noch nicht bestellen. Die Reparatur bestellen") for one in german
    )
    plan["last_order"] |= {"status": "beyond", "order": None}
    assert any("Follow the plan" in one for one in plan_page(plan, Words("en")).actions)


@pytest.mark.parametrize(
    ("now", "said"),
    [
        ("wait", "Sure that waiting is cheaper than acting today."),
        ("inspect", "Sure that this is cheaper than any other action today."),
    ],
)
def test_the_confidence_of_a_plan_says_of_what(now, said):
    plan = plan_answer()
    plan["options"][0]["now"] = now
    plan["difference"]["other"] = plan["options"][2]["words"]
    assert plan_page(plan, Words("en")).confidence.said == said
    plan["options"][2]["now"] = "wait"
    of_wait = "Sure that acting today is cheaper than waiting."
    assert plan_page(plan, Words("en")).confidence.said == (of_wait if now != "wait" else said)


def reasons_of(plan, words):
    return " ".join(next(plan_sections(plan, words)).words)


def test_an_order_and_its_repair_have_a_date_each():
    plan = plan_answer()
    done = {"ahead": 2.0, "slow_time": 1543.0, "t": "2028-11-21T00:00:00+00:00"}
    plan["options"][0] |= {"repair": [done, done, done]}
    told = reasons_of(plan, Words("en"))
    assert (
        "(order expected 2028-05-22 (in 1.5 years), repair done 2028-11-21 (in 2 years))"
        in told
    )
    german = reasons_of(plan, Words("de"))
    assert "(Bestellung voraussichtlich 2028-05-22 (in 1,5 Jahren), Reparatur fertig" in german
    # In given months a repair may wait longer than it takes: only its own date is known.
    bound = reasons_of(plan | {"months": [5, 6]}, Words("en"))
    assert "(repair expected to be done 2028-11-21 (in 2 years))" in bound
    assert "order expected" not in bound


def test_the_accepted_probability_is_told_with_its_day_and_period():
    plan = plan_answer()
    plan["last_order"] |= {"probability": 0.02, "limit": 0.02}
    told = reasons_of(plan, Words("en"))
    assert "If the repair is ordered on the last safe day, a failure before it takes" in told
    assert "is 2 %, from the last reading until a repair takes effect." in told
    facts = dict(plan_page(plan, Words("en")).facts)
    assert (
        facts["Accepted probability"] == "2 % from the last reading until a repair takes effect"
    )
    bare = plan | {"seconds": None}
    assert "If the repair is ordered at the last safe time, a" in reasons_of(bare, Words("en"))


def test_lines_break_neither_dates_nor_numbers_before_their_percent():
    page = FirstPage(
        kind="plan", subject="s", question="q", answer="Until 2027-12-15: 98.5 % <b>.",
        confidence=Confidence("high", ""), actions=["do"], measured="",
    )  # fmt: skip
    text = first_page(page, Words("en"), "")
    assert (
        '<h1>Until <span class="date">2027-12-15</span>: 98.5\N{NO-BREAK SPACE}% &lt;b' in text
    )
    assert re.search(r"\.date \{[^}]*nowrap", STYLE)


def test_a_last_safe_day_before_the_report_says_to_read_again_first(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1800000000")  # 2027-01-15
    page = plan_page(plan_answer(), Words("en"))
    assert "has passed" not in page.answer
    assert any("at the latest 2028-12-28" in action for action in page.actions)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1900000000")  # 2030-03-17
    page = plan_page(plan_answer(), Words("en"))
    assert "(in 2.1 years). That time has passed: read again first." in page.answer
    assert page.actions[0].startswith("Read again")
    assert not any("latest" in action for action in page.actions)


def test_readings_of_a_plan_end_in_an_order_where_they_decide_nothing():
    plan = plan_answer()
    plan["options"][0] |= {"name": "read_on", "parameters": {"at": 1.5}}
    actions = plan_page(plan, Words("en")).actions
    said = (
        "Follow the plan: read for 1.5 years at most. If it is still undecided then, order the "
        "repair."
    )
    assert said in actions
    assert not any("calendar" in action for action in actions)
    undecided = plan_page(plan | {"decided": False, "action": "undecided"}, Words("en"))
    assert any(
        action.startswith("Until it is decided: read for 1.5 years at most; if it is still")
        for action in undecided.actions
    )
    plan["last_order"] |= {"status": "beyond", "order": None}
    assert said not in plan_page(plan, Words("en")).actions


def test_fixed_dates_that_do_not_pay_stand_beside_the_trigger_that_does():
    plan = plan_answer()
    nothing = copy.deepcopy(plan["options"][0]) | {"name": "nothing", "words": "run to failure"}
    nothing["cost"]["value"] = 70000.0
    plan["options"].append(nothing)
    plan["last_order"] |= {"status": "beyond", "order": None, "limit": None}
    told = " ".join(next(iter(plan_sections(plan, Words("en")))).words)
    assert "than running to failure (70,000 EUR). “order a repair once the estimate" in told
    assert "” does (61,200 EUR)." in told
    plan["options"].reverse()
    told = " ".join(next(iter(plan_sections(plan, Words("de")))).words)
    assert "als der Betrieb bis zum Versagen." in told


def test_a_german_plan_has_no_english_sentence_or_number_in_its_details(tmp_path):
    plan, path = plan_answer(), tmp_path / "plan.html"
    plan["options"][1]["parameters"] = {"age": 3.0}  # else it is of a new kind, in English
    write_plan_report(path, plan, language="de")
    page = path.read_text(encoding="utf-8")
    body = page.partition("</header>")[2]
    body = re.sub(r"<script.*?</script>", "", body, flags=re.DOTALL)
    text = html.unescape(re.sub(r"<[^>]+>", " ", body))
    assert not re.search(r"\b(the|of|is|and|wait|repair|within|cost|years)\b", text)
    assert text.count("900.000") == 2  # in a reason, and in the table of costs
    assert "900000" not in text
    assert not re.search(r"[1-9],\d{3}\b", text)


def test_a_plan_draws_readings_forecast_limit_and_the_date_of_the_action():
    plan = plan_answer()
    repairs = [plan["last_order"][end] for end in ("lo", "effect", "hi")]
    plan["options"][0]["repair"] = repairs
    chart = change_chart(plan, Words("en"))
    assert chart is not None
    band, median, read, limit = chart.data
    assert read["x"] == [-2.0, -1.0, 0.0]
    assert read["y"] == pytest.approx([-11.0, -15.0, -19.0])
    assert read["error_y"]["array"] == pytest.approx([1.2] * 3)
    assert median["y"] == pytest.approx([-18.7, -33.0])
    assert (max(band["y"]), min(band["y"])) == pytest.approx((-16.7, -52.0))
    assert limit["y"] == [-30.0, -30.0]
    titles = [chart.layout[axis]["title"]["text"] for axis in ("xaxis", "yaxis")]
    assert titles == ["time from the last reading [years]", "change of stiffness [%]"]
    lines = [shape["x0"] for shape in chart.layout["shapes"]]
    assert lines == [2.6, 2.1]
    labels = [one["text"] for one in chart.layout["annotations"]]
    # In the order of time, on different heights.
    assert labels == ["last safe order: 2028-12-28", "repair expected: 2029-06-28"]
    assert len({one["y"] for one in chart.layout["annotations"]}) == 2
    assert "repair expected: 2029-06-28 (in 2.6 years)" in chart.words
    low, high = chart.layout["yaxis"]["range"]
    assert low < -1.4 * 30.0 < 0.0 < high
    assert change_chart(plan | {"history": []}, Words("en")) is None


@pytest.mark.parametrize(
    ("name", "given", "said"),
    [
        ("repair_at", {"order": 1.0, "at": 1.5}, "order the repair: 2027-11-21"),
        ("repair_now", {"order": 0.0, "at": 0.5}, "repair done: 2027-05-22"),
        ("close_until_repair", {"order": 0.0, "at": 0.5}, "repair done: 2027-05-22"),
        ("inspect_at", {"at": 1.0}, "inspect: 2027-11-21"),
        ("read_on", {"at": 1.0}, "decide: 2027-11-21"),
        ("close", {}, "close: now"),
    ],
)
def test_the_date_of_each_action_is_marked_in_the_picture(name, given, said):
    plan = plan_answer()
    plan["options"][0] |= {"name": name, "parameters": given}
    chart = change_chart(plan, Words("en"))
    assert chart is not None
    assert said in [one["text"] for one in chart.layout["annotations"]]


def test_a_plan_that_closes_until_the_repair_says_to_order_it():
    plan = plan_answer() | {"action": "close"}
    given = {"name": "close_until_repair", "parameters": {"at": 0.5, "order": 0.0}}
    plan["options"][0] |= given | {"now": "close", "words": "close until the repair is done"}
    page = plan_page(plan, Words("en"))
    assert page.answer.startswith("Take it out of service now, and order the repair.")
    assert page.actions[0] == (
        "Follow the plan: take it out of service now, order the repair, and reopen once it is "
        "done in 0.5 years."
    )
    assert any(action.startswith("Order now: done 2027-05-22") for action in page.actions)
    plan["options"][0] |= {"name": "close", "parameters": {}}
    assert plan_page(plan, Words("en")).answer.startswith(
        "Take it out of service now, for good. "
    )


def test_of_many_observations_the_most_valuable_are_listed_and_the_others_counted():
    plan = plan_answer()
    [one] = plan["information"]
    plan["information"] = [
        one | {"name": f"sensor {k}", "kind": "readings", "net": 100.0 * k} for k in range(12)
    ]
    sections = {section.heading: section for section in plan_sections(plan, Words("en"))}
    [table] = sections["Observations on offer"].shown
    assert isinstance(table, Table)
    assert [row[0].split(",")[0] for row in table.rows] == [
        f"“sensor {k}”" for k in range(11, 6, -1)
    ]
    assert table.caption.startswith(
        "The 5 of the largest net value are shown, that first, of 12 on offer."
    )
    [costs] = sections["Costs and times used"].shown
    assert isinstance(costs, Table)
    assert sum("sensor" in row[0] for row in costs.rows) == 5
    assert dict(plan_page(plan, Words("en")).facts)["Costs used"].count("sensor") == 5
    for other in plan["information"]:
        other["net"] = -1.0  # what is not worth its cost is in no option
    assert "sensor" not in dict(plan_page(plan, Words("en")).facts)["Costs used"]
    plan["information"] = [one]
    [few] = list(plan_sections(plan, Words("en")))[-1].shown
    assert isinstance(few, Table)
    assert few.caption.startswith("The largest net value comes first.")


@pytest.mark.parametrize(("p", "level"), [(0.99, "high"), (0.8, "medium"), (0.3, "low")])
def test_confidence_is_named_by_probability(p, level):
    assert level_of(p) == level


def test_a_language_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match="Allowed: en, de"):
        Words("fr")


def test_without_a_browser_a_pdf_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setenv(pdf.BROWSER, "no-such-browser")
    with pytest.raises(PrintingError, match=r"Install Chromium.*ends in \.html"):
        written(tmp_path, "plan", "en", "pdf")


@pytest.mark.browser
@pytest.mark.long
@pytest.mark.parametrize(("kind", "language"), EACH)
def test_a_pdf_has_text_that_can_be_selected_and_clips_nothing(
    tmp_path, browser, kind, language
):
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext: install poppler-utils")
    path = written(tmp_path, kind, language, "pdf")
    page = written(tmp_path, kind, language).read_text(encoding="utf-8")

    def told(*flags):
        command = ["pdftotext", *flags, str(path), "-"]
        return subprocess.run(command, capture_output=True, check=True).stdout.decode()

    text = " ".join(told().split())
    # The first page is a sheet, down to the facts below, of which the version is the last.
    sheet, version = told("-f", "1", "-l", "1"), Words(language)("facts.version")
    assert version in sheet.split()
    for said in SAYS[kind, language][:2]:
        assert said in text
    assert not re.search(r"legend switches|arrow keys|\b[Cc]lick", text)
    # Word by word: of cells of several lines, those of a row are told line by line.
    for cell in re.findall(r"<t[dh][^>]*>([^<]*)</t[dh]>", page):
        for word in html.unescape(cell).split():
            assert word in text
    boxes = told("-bbox")
    wide = float(re.findall(r'<page width="([\d.]+)"', boxes)[0])
    assert wide == pytest.approx(595, abs=2)  # A4
    for low, high in re.findall(r'<word xMin="(-?[\d.]+)" yMin="[^"]*" xMax="([\d.]+)"', boxes):
        assert 30.0 < float(low) < float(high) < wide - 30.0


@pytest.mark.browser
@pytest.mark.long
@pytest.mark.parametrize("kind", list(WRITERS))
def test_on_a_phone_nothing_is_wider_than_the_screen(tmp_path, browser, kind):
    page = browser.new_page(viewport={"width": 400, "height": 800})
    page.goto(written(tmp_path, kind, "en").as_uri())
    page.locator(".chart .main-svg").first.wait_for(timeout=300_000)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.close()


def test_a_connection_that_was_found_is_arched_over_the_points_between_its_ends():
    nodes = tuple(Node(id=name, mass_kg=1.0) for name in ("f1", "f2"))
    chain = tuple(
        Spring(id=name, between=ends, stiffness_n_per_m=1e3)
        for name, ends in {"s1": ("base", "f1"), "s2": ("f1", "f2")}.items()
    )
    given = Description(name="rig", nodes=nodes, elements=chain)
    link = Spring(id="base-f2", between=("base", "f2"))
    found = dataclasses.replace(given, elements=(*chain, link))
    sketch = sketch_of(given, found, ["base-f2"], "ground")
    assert sketch is not None
    assert [point[:2] for point in sketch.points] == [("ground", 0.0), ("f1", 1.0), ("f2", 2.0)]
    page = FirstPage(
        kind="diagnosis", subject="rig", question="?", answer="!",
        confidence=Confidence("high", ""), actions=(), measured="", sketch=sketch,
    )  # fmt: skip
    path = r'<path d="M[\d.]+ ([\d.]+) Q[\d.]+ ([\d.]+) [\d. ]+"( class="strong")?'
    drawn = re.findall(path, first_page(page, Words(), ""))
    assert [(float(end) > float(middle), bool(strong)) for end, middle, strong in drawn] == [
        (False, False), (False, False), (True, True),
    ]  # fmt: skip


def test_a_mode_that_may_be_another_or_a_line_is_no_mode_without_reservations():
    """The headline counts the others alone, and the table says the same as the first page."""
    alike = mode_at(3.1, shape=(1.0, 0.62, 0.08))
    apart = mode_at(5.0, shape=(1.0, -0.9, 0.3))
    beside, line = mode_at(10.05, shape=(0.2, 1.0, -0.9)), mode_at(10.0, "harmonic")
    result, words = modal_result_of((mode_at(2.5), alike, apart, beside, line)), Words("en")
    page = modes_page("t", result, CHANNELS, words)
    assert page.answer == (
        "One mode can be used: 5.000 ± 0.010 Hz with a damping ratio of 1.20 ± 0.10 %; 3 more "
        "are doubtful (same shape as another mode; beside a machine’s line). Whether anything "
        "has changed or is damaged, this record alone does not tell: it is compared with "
        "nothing."
    )
    table = mode_table(result, (), words)
    mistrust = [row[table.headings.index("mistrust")] for row in table.rows]
    assert mistrust == [
        "same shape as 3.1 Hz, MAC 1.00", "same shape as 2.5 Hz, MAC 1.00", "",
        "beside a machine’s line at 10 Hz",
    ]  # fmt: skip
    [lines] = line_sections(result)
    [shown] = lines.shown
    assert isinstance(shown, Table)
    assert [row[0] for row in shown.rows] == ["10.0000 ± 0.0200"]
    assert page.confidence.level == "low"
    assert page.confidence.number.startswith("1 of 4 modes are without reservations")
    assert {one.name: one.measure for one in page.alternatives} == {
        "2.500; 3.100 Hz": "the channels do not tell them apart: some may be one mode, or its "
        "vibration at another frequency",
        "10.05 Hz": "beside a machine’s line at 10 Hz",
        "10.00 Hz": "lines of machines, which may hide a mode",
    }


def test_modes_beyond_the_channels_and_those_flagged_beside_a_line_are_doubtful():
    shapes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.3, 1.0), (0.0, 1.0, 1.0))
    modes = [mode_at(2.0 + k, shape=shape) for k, shape in enumerate(shapes)]
    modes[3] = dataclasses.replace(modes[3], quality=0.2)
    flagged = dataclasses.replace(modes[0], flags=("beside_a_line",))
    result = modal_result_of((flagged, *modes[1:]))
    causes = [[one.cause for one in every] for every in doubts_of(result, Words("de"))]
    assert causes == [["beside_line"], [], [], ["beyond"]]
    page = modes_page("t", result, CHANNELS, Words("de"))
    assert page.answer.startswith(
        "2 Moden sind brauchbar: 3,0000 ± 0,0060; 4,0000 ± 0,0080 Hz; 2 weitere sind"
    )
    # As many modes as channels are no reason for doubt, however alike two of them are.
    assert doubts_of(modal_result_of(tuple(modes[1:])), Words("de")) == [[], [], []]


@pytest.mark.parametrize(
    ("model_hz", "sd", "similarity", "said"),
    [
        (10.002, 0.002, 0.99, "Keep the model: all differences are at most 0.02 %, within 1 "),
        (10.05, 0.002, 0.99, "Keep the model: all differences are at most 0.5 %"),
        (10.5, 0.5, None, "Keep the model: all differences are at most 4.8 %, within 1 "),
        (10.5, 0.002, 0.4, "Refit the model to these modes (slowtime model update): at 10 Hz"),
        (10.002, 0.002, 0.4, "Check places and directions of the sensors"),
    ],
)
def test_a_report_decides_whether_a_model_is_kept(model_hz, sd, similarity, said):
    mode = dataclasses.replace(mode_at(10.0), frequency_hz=Measured(10.0, sd))
    compared = [Compared(mode.frequency_hz, model_hz, similarity)]
    words = Words("en")
    page = modes_page("t", modal_result_of((mode,)), CHANNELS, words, compared=compared)
    assert page.actions[0].startswith(said)
    assert len(page.actions) == 1
    verdict = {
        "Keep": "They agree with the model.",
        "Refit": "The model is off: by 4.8 % at 10 Hz.",
        "Check": "The frequencies agree with the model, but the shape at 10 Hz does not.",
    }
    assert page.answer.endswith(f"damping ratio of 1.20 ± 0.10 %. {verdict[said.split()[0]]}")


def test_a_report_on_modes_says_what_speaks_against_other_readings():
    alike = mode_at(5.0, shape=(1.0, -0.2, 0.3))
    modes = (mode_at(2.5), alike, mode_at(9.0, shape=(0.1, -0.6, 1.0)))
    result, words = modal_result_of(modes), Words("en")
    page = modes_page("t", result, CHANNELS, words, rate_hz=40.0)
    likeness = mac(modes[0].shape, modes[1].shape)
    said = (
        "No usable mode is another one seen twice: even of the most alike, at 2.5 and 5 Hz, "
        f"the shapes are alike in part (MAC {likeness:.2f})."
    )
    assert 0.5 < likeness < 0.9
    other = mode_at(5.0, shape=(0.1, -0.2, 1.0))
    apart = modes_page("t", modal_result_of((modes[0], other)), CHANNELS, words)
    assert "and 5 Hz, the shapes differ completely (MAC 0.00)." in apart.weighed
    assert page.weighed == f"No line of a machine is in the record. {said}"
    assert page.confidence.said == "High confidence in the frequencies."
    # The ± of each mode is on the first page, and that of the lowest once.
    assert "2.5000 ± 0.0050; 5.000 ± 0.010; 9.000 ± 0.018 Hz" in page.answer
    assert page.definition.startswith("The lowest, at 2.5000 Hz, has a damping ratio")
    shown = html.unescape(re.sub(r"<[^>]+>", "", first_page(page, words, "")))
    assert said in shown
    # Responses to measured forces are not searched for lines, and one shape has no other.
    assert modes_page("t", result, CHANNELS, words).weighed == said
    assert modes_page("t", modal_result_of(modes[:1]), CHANNELS, words).weighed == ""
    one, number = np.array([2]), np.array([2.5])
    poles = Stabilisation(one, number, number, number, number, one)
    seen = dataclasses.replace(result, stabilisation=poles)
    assert modes_page("t", seen, CHANNELS, words).weighed.endswith(
        "the rarest, at 2.5 Hz, is in 90 % of the model orders."
    )


def test_lines_of_machines_are_explained_only_where_they_are_drawn():
    words = Words("en")
    lines = (mode_at(2.5), mode_at(10.0, "harmonic"))
    for modes, drawn in ((lines, True), (lines[:1], False)):
        told = _spectra_caption(modal_result_of(modes), AMBIENT, words)
        assert ("Dashed: lines of machines." in told) == drawn


def test_small_costs_are_written_and_rounding_is_not():
    assert [amount_text(x, 39_000.0, Words()) for x in (38_953.7, -4.4e-11)] == ["39,000", "0"]
    assert [amount_text(x, 0.02, Words()) for x in (0.004, 0.0123)] == ["0.004", "0.0123"]
