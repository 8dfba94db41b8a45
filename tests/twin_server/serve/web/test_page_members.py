"""Members compared with the reference period: over REST, in Python, in words and colours."""

import json

import pytest
from playwright.sync_api import expect

from slowtime_schemas.answers.twins import State
from tests.twin_server.towers import GROUPS, epoch, full_model, tower

pytestmark = [pytest.mark.browser, pytest.mark.long]

TOWER = "/api/v1/twins/lab.tower"
SOUND, WHOLE = 14, 18
CALM, LOSS = (0.0, 0.0, 0.0), (0.0, -0.2, 0.0)
"""Epochs are a second apart, so that each comparison may hardly err: small losses wait."""
BODY = {
    "changes": "elements",
    "model": tower(),
    "parameters": dict.fromkeys(GROUPS, 0.3),
    "learn_epochs": 6,
    "assessment": {"readings": 4, "false_alarms_per_year": 0.5},
}


@pytest.fixture(scope="module")
def assessed(serving, frame, eventually):
    """A server with a tower whose upper legs are weaker from the 14th epoch on."""
    started, made = serving(), frame(seed=5, asset="tower")
    model = full_model()
    assert started.client.put(TOWER, json=BODY).status_code == 201
    epochs = [epoch(made, model, i, LOSS if i >= SOUND else CALM) for i in range(WHOLE)]
    started.feed(epochs)
    assert eventually(lambda: started.count("lab.tower") == WHOLE)
    return started


def test_rest_tells_the_verdict_with_its_rate_and_an_event(assessed):
    state = State.model_validate(assessed.get(TOWER).json())
    found = state.assessment
    assert found is not None
    assert (found.verdict, found.readings, found.reference_readings) == ("changed", 4, 6)
    ((suspect,),) = found.sets
    assert suspect.name == "upper legs"
    assert abs(suspect.loss - 0.2) < 3 * suspect.sd < 0.06
    assert found.false_alarms_per_year == 0.5
    assert 0.0 < found.false_alarm < 1e-6
    assert state.suspects == ("upper legs",)
    before = State.model_validate(assessed.get(TOWER, at="slow:13").json())
    assert before.assessment is not None
    assert before.assessment.verdict == "unchanged"
    events = assessed.get(f"{TOWER}/events").json()["events"]
    changed = [e for e in events if e["kind"] == "element_changed"]
    assert [e["slow_time"] for e in changed] == [17.0]
    assert changed[0]["details"]["assessment"]["verdict"] == "changed"


@pytest.mark.parametrize(
    ("locale", "said"),
    [
        (
            "en-GB",
            ("upper legs has lost ", "Mean of 4 readings", "reference of 6", "at most 0.5"),
        ),
        (
            "de-DE",
            ("upper legs hat ", "Mittel aus 4 Messungen", "Referenz aus 6", "höchstens 0,5"),
        ),
    ],
)
def test_the_page_names_the_member_and_colours_it_by_evidence(assessed, visit, locale, said):
    page = visit(assessed, "#lab.tower", locale=locale, reduced_motion="reduce")
    verdict = page.locator('[id="lab.tower"] .verdict')
    for text in said:
        expect(verdict).to_contain_text(text)
    canvas = page.locator('[id="lab.tower"] .wireframe canvas')
    expect(canvas).to_have_attribute("data-changed", "upper legs")
    tones = json.loads(canvas.get_attribute("data-tones"))
    assert [name for name, one in tones.items() if one["sure"]] == ["upper legs"]
    # Members without evidence have one colour, whatever the latest reading alone says.
    others = {one["tone"] for name, one in tones.items() if name != "upper legs"}
    assert len(others) == 1
    assert tones["upper legs"]["tone"] not in others
    row = page.locator('[id="lab.tower"] table.elements tr[data-changed="true"]')
    expect(row).to_contain_text("changed with" if locale == "en-GB" else "geändert mit")
    assert page.complaints == []


WORDS = """async () => {
  const { membersSaid } = await import('/assets/members.js');
  const common = {
    readings: 4, reference_readings: 6, false_alarms_per_year: 0.5, probability: {},
  };
  const one = (name, probability, loss, sd) => ({ name, probability, loss, sd });
  const sets = [[one('a', 0.62, 0.12, 0.03), one('b', 0.36, 0.09, 0.04)]];
  const of = (verdict) => membersSaid(
    { verdict, sets: verdict === 'changed' ? sets : [], ...common }, { readings: 20 },
  );
  const verdicts = ['changed', 'unchanged', 'undecided', 'not comparable'];
  return [...verdicts.map(of), membersSaid(null, { readings: 20 })];
}"""


@pytest.mark.parametrize(
    ("language", "said"),
    [
        (
            "en",
            (
                "one of these has lost stiffness: a (62\u202f%, loss 12\u202f% ± 3\u202f%); "
                "b (36\u202f%, loss 9\u202f% ± 4\u202f%).",
                "No member has lost stiffness since the reference period.",
                "cannot be told in which member",
                "not comparable with the reference",
                "once 20 readings have come",
            ),
        ),
        (
            "de",
            (
                "eines davon hat Steifigkeit verloren: a (62\u202f%, Verlust 12\u202f%",
                "Kein Bauteil hat seit der Referenzzeit Steifigkeit verloren.",
                "in welchem Bauteil, lässt sich nicht sagen",
                "nicht vergleichbar",
                "nach dem Lernen 20 Messungen",
            ),
        ),
    ],
)
def test_each_verdict_has_its_words(assessed, visit, language, said):
    page = visit(assessed, f"?lang={language}#lab.tower")
    told = page.evaluate(WORDS)
    for text, part in zip(told, said, strict=True):
        assert part in text
