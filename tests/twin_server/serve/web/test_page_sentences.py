"""The page in a real Chromium: sentences that the server composes, in German."""

import re

import pytest
from playwright.sync_api import expect

from slowtime.evolution.reasons import Reason
from slowtime_services.client import Client
from twin_server.estimate.elements.suspects import SuspectGroup, size
from twin_server.history import states
from twin_server.pipeline.monitoring import gap
from twin_server.serve.conclusion import Evidence, conclude

pytestmark = pytest.mark.browser

TWIN = "/api/v1/twins/lab.beam"
AT = 40
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
    "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.3}]},
    "costs": {"failure": 1e6, "repair": 4e4, "inspection": 2e3, "time_unit": "slow_time"},
    "decision": {
        "failure": {"quantity": "stiffness_change", "below": -0.5},
        "horizon": 60.0, "inspection": {"name": "visit", "sd": 0.02},
    },
    "limit_states": [
        {"name": "buckling", "kind": "threshold", "quantity": "stiffness_change", "below": -0.4}
    ],
}  # fmt: skip
TRANSLATED = """async (texts) => {
  const { translated } = await import('/assets/sentences.js');
  return texts.map((text) => translated(text));
}"""
ENGLISH = re.compile(r"\b(?:the|is|of|and|with|not|has|are|by|that|from)\b", re.I)
"""Words by which English is recognised; none of them is German."""


@pytest.fixture(scope="module")
def house(serving, ageing, eventually):
    """A server with a beam below its limit that is as built again, of which much is told."""
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    for message in [*ageing(AT), *ageing(6, loss=0.0, first=AT, seed=1)]:
        server.feed([message])
    client = Client(server.url)
    assert eventually(lambda: client.recorded_events("lab.beam").questions)
    event = next(e for e in client.alarms("lab.beam"))
    client.acknowledge("lab.beam", event["event_id"], by="Ann", note="Seen.")
    client.change("lab.beam", {"name": "Balken"}, person="Ann", text="A name.")
    repair = {"event": "r1", "kind": "repair", "person": "Ann", "slow_time": 10.0}
    client.record_event("lab.beam", repair)
    return server


def sentences():
    """Sentences that functions of the server compose."""
    bits = [int(bit) for bit in (*Reason, *states._OURS)]
    reasons = {text for bit in bits for text in states.sentences(bit)}
    assert len(reasons) == len(Reason) + len(states._OURS)
    yield from sorted(reasons)
    readings = [{"in_use": 0.123}]
    for state in ("off", "waiting", "learning", "watching", "disagreeing"):
        yield gap._sentence(state, readings)
    sizes = size("j2", -0.08, 0.01), size("m1.mass", 0.124, 0.004)
    yield SuspectGroup("j2", sizes[:1]).sentence
    yield SuspectGroup("j2 or m1.mass", sizes).sentence
    late = Evidence(reasons=0, alive=True, late_s=1234, set_aside=3)
    yield from (one.text for one in conclude(late).findings)


def test_sentences_of_the_server_are_german(house, visit):
    page = visit(house, "?lang=de", locale="de-DE")
    expect(page.locator("html")).to_have_attribute("lang", "de")
    texts = list(sentences())
    found = page.evaluate(TRANSLATED, texts)
    assert [text for text, own in zip(texts, found, strict=True) if own is None] == []
    # What stands in backquotes is to be typed as it is.
    plain = [re.sub(r"`[^`]*`", "", own) for own in found]
    assert [own for own in plain if ENGLISH.search(own)] == []
    assert "Der nächste Messwert ist seit 1234 s überfällig." in found
    assert (
        "Das Modell erklärt die Messungen: Seine freie Simulation weicht um 12,3% ab." in found
    )
    told = "Die Messwerte. Etwas anderes"
    assert page.evaluate(TRANSLATED, [told, "", "Nothing known of it."]) == [None] * 3
    values = page.evaluate(
        TRANSLATED,
        [
            "No inspection within 1,234.5 days is worth its cost.",
            "Acknowledged by Dr. 1.5: 2.5 mm, see 2026-12-01. The alarm: Stiffness change below"
            " −10 % with 97.5 % certainty: −19.5 %, 95 % interval −20.1 to −18.9 %.",
        ],
    )
    assert values == [
        "Keine Inspektion innerhalb von 1.234,5 Tagen ist ihre Kosten wert.",
        "Quittiert von Dr. 1.5: 2.5 mm, see 2026-12-01. Der Alarm: Steifigkeitsänderung unter "
        "−10 % mit 97,5 % Sicherheit: −19,5 %, 95-%-Intervall −20,1 bis −18,9 %.",
    ]


LEFT = """root => [...root.querySelectorAll('[lang=en]')]
  .filter((one) => one.textContent.trim() && one.tagName !== 'OPTION')
  .map((one) => one.textContent)"""
SHOWN = """root => {
  for (const one of root.querySelectorAll('details')) one.open = true;
  return root.innerText;
}"""


def test_a_twin_is_german_in_all_its_details(house, visit):
    page = visit(house, "?lang=de#lab.beam", locale="de-DE")
    twin = page.locator('[id="lab.beam"]')
    expect(twin.locator(".plan .sentence")).to_contain_text("erwartete Kosten")
    expect(twin.locator(".risk tbody tr")).to_have_count(1)
    expect(twin.locator(".crossings tbody tr")).to_have_count(2)
    expect(twin.locator(".questions li")).to_contain_text("Wurde etwas repariert?")
    assert twin.evaluate(LEFT) == []
    text = twin.evaluate(SHOWN)
    expect(twin.locator(".revisions li")).to_contain_text("A name.")
    # What people have written stays as they have.
    for own in ("A name.", "Seen."):
        assert own in text
        text = text.replace(own, "")
    lines = [line for line in text.splitlines() if ENGLISH.search(line)]
    assert lines == []
    assert "Quittiert von Ann" in text
    assert "Reparatur, eingetragen von Ann: behobener Anteil unbekannt." in text
    assert page.complaints == []
