"""What holds of every report, of whatever kind, in either language."""

import collections
import copy
import dataclasses
import html
import json
import math
import re

import pytest

from slowtime.reliability import METHODS, Problem, Result, estimate, marginal
from slowtime_schemas.files.diagnosis import SearchEnd
from slowtime_services.diagnose import document_of, write_report
from slowtime_services.diagnose.first_pages import diagnosis_page
from slowtime_services.diagnose.report import _signed_percent
from slowtime_services.problem_files.stated import Stated
from slowtime_services.reports import LANGUAGES, Chart, Section, Table, Words, page_text
from slowtime_services.reports.first_page import first_page, measured_on, subject_of
from slowtime_services.reports.kinds.plan import plan_page
from slowtime_services.reports.kinds.plan_options import option_words
from slowtime_services.reports.kinds.reliability import (
    reliability_page,
    write_reliability_report,
)
from slowtime_services.reports.kinds.state import state_page
from slowtime_services.reports.page import STYLE
from slowtime_services.reports.words import FOLDER
from tests.services.diagnose.slide import told
from tests.services.reports.reports_of_each_kind import (
    MEASURED_NS,
    WRITERS,
    modes_with_shapes,
    plan_answer,
    states,
)

EACH = [(kind, language) for kind in WRITERS for language in LANGUAGES]
ON_SCREEN = re.compile(
    r"\b(click|drag|hover|zoom|legend switches|arrow keys|klick|zieh|tippen)", re.IGNORECASE
)
"""Words of what can be done with a mouse or keys."""


def page_of(tmp_path, kind, language):
    path = tmp_path / f"{kind}.html"
    WRITERS[kind](path, language)
    return path.read_text(encoding="utf-8")


def without_dates(page):
    """Leave out the marks of dates, which keep lines from breaking these."""
    return re.sub(r'<span class="date">([^<]*)</span>', r"\1", page)


def blocks_of(page):
    """Visible texts, each of one element."""
    body = without_dates(page).partition("<body>")[2]
    body = re.sub(r"<script.*?</script>", "", body, flags=re.DOTALL)
    return [" ".join(html.unescape(text).split()) for text in re.findall(r">([^<]+)<", body)]


def printed(page):
    """Page as paper has it: without what the style sheet hides in print."""
    return re.sub(r'<span class="hint">[^<]*</span>', "", page)


@pytest.mark.parametrize(("kind", "language"), EACH)
def test_no_sentence_stands_twice_in_a_report(tmp_path, kind, language):
    """Names of options and effects may be in a table and beside the answer; sentences not."""
    counted = collections.Counter(
        sentence.casefold()
        for block in blocks_of(page_of(tmp_path, kind, language))
        for sentence in re.split(r"(?<=[.!?]) ", block)
        if sentence.endswith((".", "!", "?")) and len(sentence.split()) >= 5
    )
    assert [one for one, count in counted.items() if count > 1] == []


def test_sentences_that_were_said_before_are_left_out_and_empty_sections_with_them():
    said = "The tower has lost a tenth of its stiffness."
    chart = Chart([], {}, f"{said} A line is drawn.")
    sections = [
        Section("Reasons", [f"{said} It is the third storey."], [chart]),
        Section("Again", [said]),
        Section("Table", (), [Table(("a",), [("b",)], said)]),
    ]
    page = page_text("Title", said, sections)
    assert page.count(said) == 2  # the lead, and the description of the chart for the blind
    assert ">It is the third storey.<" in page
    assert "<figcaption>A line is drawn.</figcaption>" in page
    assert "Again" not in page


def test_a_dated_sentence_of_the_first_page_is_left_out_of_the_details():
    said = "The last safe order is on 2027-12-15 by the costs."
    first = plan_page(plan_answer(), Words("en"))
    first = dataclasses.replace(first, definition=said)
    page = page_text("t", "l", [Section("Reasons", [said, "Nothing else."])], first=first)
    assert without_dates(page).count(said) == 1


@pytest.mark.parametrize(("kind", "language"), EACH)
def test_every_first_page_tells_when_the_data_were_measured_and_the_report_was_made(
    tmp_path, kind, language
):
    page, words = page_of(tmp_path, kind, language), Words(language)
    facts = dict(re.findall(r"<dt>([^<]*)</dt><dd>([^<]*)</dd>", without_dates(page)))
    assert facts[words("facts.measured")]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", facts[words("facts.made")])


def test_dates_are_of_calendars_only():
    words = Words()
    day_s = 86_400.0
    assert measured_on([(MEASURED_NS, 600.0)], words) == "2026-03-04 10:20"
    assert measured_on([(MEASURED_NS, 600.0), (MEASURED_NS, 3 * day_s)], words) == (
        "2026-03-04 to 2026-03-07"
    )
    for start in (None, 0, 946_684_800_000_000_000):  # a counter, and a file without a date
        assert measured_on([(start, 10.0)], words) == "not stated in the file"


@pytest.mark.parametrize(("kind", "language"), EACH)
def test_paper_holds_no_instructions_for_a_screen(tmp_path, kind, language):
    page = page_of(tmp_path, kind, language)
    assert not [text for text in blocks_of(printed(page)) if ON_SCREEN.search(text)]


def test_instructions_for_a_screen_are_there_on_it(tmp_path):
    path = tmp_path / "modes.html"
    modes_with_shapes(path, "en")
    page = path.read_text()
    assert "The legend switches modes on and off." in page
    assert not [text for text in blocks_of(printed(page)) if ON_SCREEN.search(text)]
    print_rules = "".join(re.findall(r"@media print \{[^@]*", STYLE))
    assert re.search(r"\.hint\b[^{]*\{ display: none", print_rules)
    assert re.search(r"\bfigure\b[^{]*\{ break-inside: avoid", print_rules)


@pytest.mark.parametrize(("kind", "language"), EACH)
def test_a_chart_and_its_caption_are_one_block(tmp_path, kind, language):
    page = page_of(tmp_path, kind, language)
    charts = page.count('<div class="chart"')
    one_block = (
        r'<figure><div class="chart"[^>]*><script[^>]*>[^<]*</script></div>\s*<figcaption'
    )
    assert charts > 0
    assert len(re.findall(one_block, page)) == charts


@pytest.mark.parametrize(("kind", "language"), EACH)
def test_the_subject_is_no_file_name(tmp_path, kind, language):
    page = page_of(tmp_path, kind, language)
    for part in ("kind", "question"):
        found = re.search(rf'<p class="{part}">([^<]*)</p>', page)
        assert found is not None
        assert not re.search(r"\.(csv|json|ya?ml|npz|dat|mcap|mat|py)\b", found[1])


def test_a_structure_without_a_name_is_called_by_the_stem_of_its_file():
    assert subject_of("Tower", "wn_01.dat", Words()) == "Tower"
    assert subject_of("", "wn_01.dat", Words("de")) == "„wn 01“"


def test_one_phrase_stands_for_each_sense_of_an_interval(tmp_path):
    """An interval of an estimate is of 90 % or 95 %; a range of futures is of 9 of 10."""
    for language in LANGUAGES:
        messages = (FOLDER / f"{language}.json").read_text()
        assert not re.search(r"5\W{0,3}(to|bis|–)\W{0,3}95", messages)
    page = page_of(tmp_path, "plan", "en")
    assert "90\N{NO-BREAK SPACE}% interval: 9,100 EUR to 15,800 EUR" in page
    assert "9 of 10 futures: from" in page
    assert not re.search(r"\b5 (to|and) 95 %", page)


def test_a_report_on_reliability_says_what_failure_means_and_of_which_time():
    problem = Problem(
        {"r": marginal("normal", mean=5.0, sd=1.0), "s": marginal("normal", mean=2.0, sd=1.0)},
        lambda x: x[:, 0] - x[:, 1],
    )
    found = [estimate(problem, "importance", seed=1)]

    def page(**stated):
        return reliability_page(
            "b.yaml", problem, found, Words(), seed=1, stated=Stated(**stated)
        )

    full = page(failure="the beam breaks", period="50 years", accepted=1e-3)
    assert full.definition == (
        "Failure means, in the words of the file: “the beam breaks”. The probability is that "
        "of “50 years”."
    )
    ratio = found[0].probability / 1e-3
    assert found[0].interval is not None
    least = found[0].interval[0] / 1e-3
    assert full.answer.endswith(
        f"That is too high: {ratio:.2g} times the accepted 0.001, and at least {least:.3g} "
        "times it (95 %)."
    )
    assert full.actions[0].startswith("Act: strengthen")
    bare = page()
    assert "The file states no period" in bare.definition
    assert bare.actions[-1].startswith("State in the file what fails")
    assert bare.answer.endswith(
        "Whether that is too high is open: the file states no accepted probability."
    )
    # Without a verdict, what others accept is something to compare with.
    usual = 0.5 * math.erfc(3.8 / math.sqrt(2.0))
    assert "It cannot be compared with EN 1990" in bare.actions[0]
    assert "cannot be compared" in page(period="one occurrence of the loads").actions[0]
    told = page(period="50 years").actions[0]
    assert "aims at 7.2·10⁻⁵ (about 1 in 14,000) for a collapse within 50 years" in told
    times = Words().number(found[0].probability / usual, 2)
    assert f"the probability found here is {times} times that." in told
    # Of one year, table B.2 has an index of 4.7, a probability of 1.3e-6.
    assert "aims at 1.4·10⁻⁶" in page(period="a year").actions[0]
    kept = page(accepted=4 * found[0].probability)
    assert kept.actions[0].startswith("Nothing to do now")
    assert "That is acceptable: about a quarter of the accepted 0.06" in kept.answer
    assert "and at most 2" in kept.answer


def result_of(method, probability, cov=0.03):
    """Give an estimate with its interval; none where it has no coefficient of variation."""
    if cov is None:
        return Result(method, probability, None, "approximation", None, 50)
    ends = probability * (1 - 1.96 * cov), probability * (1 + 1.96 * cov)
    return Result(method, probability, ends, "", cov, 2000)


@pytest.mark.parametrize(
    ("others", "level"),
    [
        ([("subset", 1.82e-3, 0.1)], "high"),
        ([("subset", 1.82e-3, 0.1), ("form", 4.2e-5, None)], "medium"),
        ([("subset", 1.82e-3, 0.1), ("form", 1.0e-3, None)], "high"),
        ([("subset", 1.82e-3, 0.1), ("form", 7e-3, None)], "medium"),
    ],
)
def test_methods_that_disagree_never_stand_under_high_confidence(others, level):
    problem = Problem({"x": marginal("normal", mean=5.0, sd=1.0)}, lambda x: x[:, 0])
    found = [result_of("importance", 1.81e-3), *(result_of(*one) for one in others)]
    page = reliability_page("b.yaml", problem, found, Words(), seed=1)
    assert page.confidence.level == level
    assert ("first-order approximation gives" in page.confidence.number) == (level == "medium")


@pytest.mark.parametrize(
    ("accepted", "others", "said"),
    [
        (1e-3, [2e-3, 3e-3], "The answer is the same by all of these: too high."),
        (1e-2, [2e-3, 3e-3], "The answer is the same by all of these: acceptable."),
        (1.81e-3, [2e-3, 3e-3], "By all of these it is too high."),
        (1e-3, [2e-4, 3e-4], "By all of these it is acceptable."),
        (1e-3, [2e-3, 3e-4], "on the method: too high by other 0, acceptable by other 1."),
        (None, [2e-3, 3e-3], "Two other calculations give 0.002 and 0.003, up to 1.7 times "
                             "higher."),
        (None, [1e-3, 3e-3, 2e-3], "Three other calculations give 0.001, 0.002 and 0.003, from "
                                   "1.8 times lower to 1.7 times higher."),
        (None, [0.0], "One other calculation gives 0, up to ∞ times lower."),
        (1e-3, [], ""),
    ],
)  # fmt: skip
def test_a_report_on_reliability_says_what_the_other_methods_would_change(
    accepted, others, said
):
    problem = Problem({"x": marginal("normal", mean=5.0, sd=1.0)}, lambda x: x[:, 0])
    found = [result_of("importance", 1.81e-3)]
    found += [result_of(f"other {k}", p, None) for k, p in enumerate(others)]
    stated = Stated(accepted=accepted)
    page = reliability_page("b.yaml", problem, found, Words(), seed=1, stated=stated)
    assert said in page.weighed
    assert bool(said) == bool(page.weighed)
    known = result_of("importance", 1.81e-3).interval
    assert known is not None
    lo, hi = min([known[0], *others]), max([known[1], *others])
    every = f"over all methods it is between {Words().number(lo)} and {Words().number(hi)}."
    assert (every in page.confidence.number) == bool(others)


def test_every_method_has_a_name_in_reports_of_both_languages():
    for language in LANGUAGES:
        assert Words(language).group("method").keys() == METHODS.keys()


def undecided_pages(words):
    """First pages whose answers leave the question open, whatever is sure besides."""
    for verdict in ("unknown_effect", "undecided"):
        found = dataclasses.replace(
            told(), verdict=verdict, effects=(), nothing_probability=1e-9
        )
        yield diagnosis_page(found, document_of(found), words)
    problem = Problem({"x": marginal("normal", mean=5.0, sd=1.0)}, lambda x: x[:, 0])
    sure = [result_of("importance", 1.8e-3), result_of("subset", 1.82e-3)]
    for accepted in (None, 1.8e-3):
        yield reliability_page(
            "b.yaml", problem, sure, words, seed=1, stated=Stated(accepted=accepted)
        )
    plan = plan_answer()
    yield plan_page(plan | {"decided": False, "action": "undecided"}, words)
    yield plan_page(plan | {"options": [], "sentence": "Too few."}, words)
    for loss in (0.03, None):
        epochs = states(loss or 0.0, 0.02)
        if loss is None:
            epochs[-1]["stiffness_change"] = None
        yield state_page("b", epochs, "stiffness", words)


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_answer_that_leaves_the_question_open_stands_beside_high_confidence(language):
    words = Words(language)
    pages = list(undecided_pages(words))
    assert len(pages) == 8
    for page in pages:
        shown = re.sub(r"<[^>]+>", " ", first_page(page, words, ""))
        assert words("confidence.high") not in html.unescape(shown), page.answer
        assert page.confidence.said, page.answer
    assert "fehlt" in pages[0].confidence.said or "missing" in pages[0].confidence.said


def test_inputs_of_the_same_distribution_are_written_as_one(tmp_path):
    same = {f"x{k}": marginal("normal", mean=1.0, sd=0.2) for k in range(100)}
    other = {"r": marginal("normal", mean=150.0, sd=9.0)}
    problem = Problem(same | other, lambda x: x[:, 100] - x[:, :100].sum(axis=1))
    found = [estimate(problem, "form", seed=1)]
    facts = dict(reliability_page("b.yaml", problem, found, Words(), seed=1).facts)
    assert facts["Random inputs"] == "x0 … x99 (100), r"
    write_reliability_report(tmp_path / "r.html", "b.yaml", problem, found, {}, seed=1)
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert page.count("x0 … x99 (100)</td>") == 2  # inputs, and the design point
    assert not re.search(r"<td[^>]*>x7</td>", page)


def test_a_plan_lists_all_costs_and_times_that_it_counts(tmp_path):
    page = plan_page(plan_answer(), Words())
    facts = dict(page.facts)
    assert facts["Costs used"] == (
        "failure 900,000 ± 200,000 EUR; planned repair 40,000 EUR; inspection 1,500 EUR"
    )
    assert facts["Lead time of a repair"] == "0.5 years"
    assert "Failure means: the stiffness falls by more than 30 %." in page.definition
    text = page_of(tmp_path, "plan", "en")
    table = text[text.index("Costs and times used") :]
    for item in (
        "failure", "planned repair", "inspection", "out of service", "closing, once",
        "discount rate", "from the order of a repair to its effect",
    ):  # fmt: skip
        assert f"<td>{item}</td>" in table


def test_options_have_words_in_each_language_and_new_kinds_those_of_the_server():
    plan = plan_answer()
    best = plan["options"][0]
    assert option_words(best, plan, Words()) == (
        "order a repair once the estimate reaches −25.5 %"
    )
    assert option_words(best, plan, Words("de")).startswith("eine Reparatur bestellen, sobald")
    at_once = copy.deepcopy(plan)
    at_once["last_order"]["lead_time"] = 0.0
    assert option_words(best, at_once, Words()).startswith("repair once")
    new = best | {"name": "replace_half", "words": "replace one half"}
    assert option_words(new, plan, Words("de")) == "replace one half"


def test_what_ended_a_search_is_in_the_answer_and_what_follows_in_the_actions():
    found = dataclasses.replace(told(), verdict="unknown_effect", effects=(), seconds=12.0)
    for by, flag in (("budget", "--patience 280"), ("request", "--patience 280")):
        ended = SearchEnd(by=by, budget_s=70.0, used_s=12.0)
        page = diagnosis_page(found, document_of(found, ended=ended), Words())
        assert "tried so far explains. The search was ended" in page.answer
        assert "after 12 s" in page.answer
        assert page.actions[0].endswith(f"{flag}.")
    whole = diagnosis_page(found, document_of(found), Words())
    assert whole.answer == "An effect is missing that is not in the catalogue."
    exhausted = dataclasses.replace(found, exhausted=True)
    assert document_of(exhausted).ended == SearchEnd(by="budget", used_s=12.0)


def where_scores(*scores):
    """Give a diagnosis whose places a force explains by these log likelihoods."""
    kinds = (("element", "j"), ("node", "m"), ("input", "u"))
    document = document_of(told(), records=["learn.npz"], holdout=["judge.npz"])
    places = [
        document.where[0].model_copy(update={"kind": kind, "id": name, "score": score})
        for (kind, name), score in zip(kinds, scores, strict=True)
    ]
    return document.model_copy(update={"where": tuple(places)})


@pytest.mark.parametrize(
    ("scores", "name"),
    [
        ((400.0, 400.0, 399.0), "an unknown force at node m, input u"),
        ((400.0, 400.0, 390.0), "an unknown force at node m"),
        ((400.0, 395.0, 390.0), None),
    ],
)
def test_places_that_only_the_law_tells_apart_stand_beside_the_answer(scores, name):
    page = diagnosis_page(told(), where_scores(*scores), Words("en"))
    alike = [one for one in page.alternatives if "only the law" in one.measure]
    assert [one.name for one in alike] == ([] if name is None else [name])
    assert all(one.measure.startswith("explains as much as one at element j:") for one in alike)
    # What fits as well is not called sure, and what is less probable does not fit as well.
    assert page.beside == ("" if name is None else "Fits as well")
    said = f"sure of its kind only if this is ruled out: {name}."
    assert page.confidence.said.endswith(said if name else "")
    assert page.confidence.level == ("high" if name is None else "medium")
    todo = [one for one in page.actions if one.startswith(("Rule out", "Inspect", "Once that"))]
    assert [one.split()[0] for one in todo] == (
        ["Rule", "Inspect", "Once"] if name else ["Inspect"]
    )
    assert name is None or todo[0].startswith(f"Rule out first: {name}.")


@pytest.mark.parametrize(
    ("share", "text"),
    [(-4e-6, "0.00 %"), (0.0, "0.00 %"), (-0.021, "-2.10 %"), (0.5, "+50.00 %")],
)
def test_a_change_that_rounds_to_nothing_has_no_sign(share, text):
    assert _signed_percent(share) == text


def test_bands_are_told_from_one_frequency_to_the_other(tmp_path):
    found = told()
    document = document_of(found, records=["learn.npz"], holdout=["judge.npz"])
    bands = document.when.model_copy(update={"bands_hz": ((0.08, 8.1), (10.0, 12.0))})
    document = document.model_copy(update={"when": bands})
    for language, said in (
        ("en", "stands out between 0.08 and 8.1 Hz, between 10 and 12 Hz."),
        ("de", "sticht hervor zwischen 0,08 und 8,1 Hz, zwischen 10 und 12 Hz."),
    ):
        write_report(tmp_path / "d.html", found, document, language=language)
        assert said in (tmp_path / "d.html").read_text(encoding="utf-8")


def test_no_switch_of_a_command_is_in_what_to_do_with_usable_modes():
    for language in LANGUAGES:
        words = Words(language)
        for key in ("modes.do_use", "modes.do_use_clean"):
            assert "--" not in words(key)


def test_both_languages_head_the_same_details():
    de = json.loads((FOLDER / "de.json").read_text())["headings"]
    for heading in ("Failure", "Costs and times used", "9 of 10 futures: from", "unit"):
        assert heading in de
