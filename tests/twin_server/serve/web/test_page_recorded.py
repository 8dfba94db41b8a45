"""The page in a real Chromium: repairs and inspections are recorded, drawn, and taken back."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from slowtime_schemas.asset_events import RepairResult
from slowtime_services.client import Client

pytestmark = [pytest.mark.browser, pytest.mark.long]

TWIN = "/api/v1/twins/lab.beam"
BODY = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
AT = 40


@pytest.fixture
def house(serving, ageing, eventually):
    """A server with a beam that loses a fifth of its stiffness, and is as built again."""
    server = serving()
    server.client.put(TWIN, json=BODY)
    for message in [*ageing(AT), *ageing(6, loss=0.0, first=AT, seed=1)]:
        server.feed([message])
    assert eventually(lambda: Client(server.url).recorded_events("lab.beam").questions)
    return server


def marks(page):
    """Texts and places of the marks on the chart of stiffness."""
    plot = page.locator('[id="lab.beam"] [data-quantity="stiffness_change"]')
    return plot.evaluate(
        "plot => (plot.layout?.shapes ?? []).filter(s => s.name === 'told').map((s, i) => s.x0)"
    ), plot.evaluate("plot => (plot.layout?.annotations ?? []).map(note => note.text)")


def test_a_question_is_answered_by_recording_the_repair(house, visit, eventually):
    page = visit(house, "#lab.beam")
    question = page.locator(".recorded .questions li")
    expect(question).to_contain_text("Was something repaired? stiffness_change went from")
    assert "sudden change" in str(marks(page)) or eventually(
        lambda: "sudden change" in marks(page)[1]
    )
    question.get_by_role("button", name="Record the repair").press("Enter")
    form = page.locator(".recorded form")
    expect(form.get_by_label("What happened")).to_be_focused()
    expect(form.get_by_label("What happened")).to_have_value("repair")
    expect(form).to_contain_text("After 39")
    expect(form.get_by_label("Share [%]")).to_be_hidden()
    form.get_by_label("Restored").select_option("share")
    form.get_by_label("Share [%]").fill("90")
    form.get_by_label("Standard deviation [%]").fill("10")
    form.get_by_label("Name").fill("Ann Moreau")
    form.get_by_label("Text").fill("<b>Bolts</b> replaced")
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []
    form.get_by_role("button", name="Record", exact=True).press("Enter")

    said = (
        "Repair of stiffness change recorded by Ann Moreau: "
        "90\u202f% ± 10\u202f% of the damage restored."
    )
    expect(page.locator(".recorded [role=status]")).to_contain_text(said)
    expect(page.locator(".recorded ol li")).to_contain_text("<b>Bolts</b> replaced")
    expect(question).to_have_count(0)
    (told,) = Client(house.url).recorded_events("lab.beam").events
    assert told.repair is not None
    assert (told.slow_time, told.repair.restored_share) == (AT - 1.0, 0.9)
    # The jump is explained: its mark is that of the repair.
    assert eventually(lambda: marks(page) == ([AT - 1.0], ["repair"]))
    expect(page.locator('#legend [data-key="told"]')).to_be_visible()
    expect(page.locator('#legend [data-key="sudden"]')).to_be_hidden()

    page.get_by_role("button", name="Undo: Repair of stiffness change").press("Enter")
    expect(page.locator(".recorded ol li.reversed")).to_contain_text("undone")
    assert eventually(lambda: "repair" not in marks(page)[1])
    expect(question).to_have_count(1)
    question.get_by_role("button", name="No, it is a real change").press("Enter")
    expect(question).to_have_count(0)
    assert Client(house.url).recorded_events("lab.beam").questions[0].answered_by is not None
    assert page.complaints == []


def test_an_inspection_is_recorded_after_the_latest_reading(house, visit):
    page = visit(house, "#lab.beam")
    page.get_by_role("button", name="Record a repair or inspection").press("Enter")
    form = page.locator(".recorded form")
    form.get_by_label("What happened").select_option("inspection")
    expect(form.get_by_label("Restored")).to_be_hidden()
    form.get_by_label("Result").select_option("none")
    expect(form.get_by_label("Change [%]")).to_be_hidden()
    form.get_by_label("Damage that the inspection detects with 50 % probability [%]").fill("8")
    page.keyboard.press("Enter")
    expect(page.locator(".recorded ol li")).to_contain_text("no damage found")
    (told,) = Client(house.url).recorded_events("lab.beam").events
    assert told.slow_time == AT + 5.0
    assert told.detection is not None
    assert told.detection.probability_of_detection.a50 == pytest.approx(0.08)
    page.get_by_role("button", name="Record a repair or inspection").press("Enter")
    page.keyboard.press("Escape")
    expect(form).to_have_count(0)
    expect(page.get_by_role("button", name="Record a repair or inspection")).to_be_focused()
    # What the server refuses is said in the form, which stays.
    page.get_by_role("button", name="Record a repair or inspection").press("Enter")
    form.get_by_label("When").fill("2100-01-01T00:00")
    form.get_by_role("button", name="Record", exact=True).press("Enter")
    expect(form.get_by_role("alert")).to_contain_text("in the future")
    expect(form.get_by_role("button", name="Record", exact=True)).to_be_enabled()


def test_an_event_is_corrected_in_one_step_and_the_correction_is_undone(house, visit):
    client = Client(house.url)
    share = {"restored_share": 0.9, "restored_share_sd": 0.1}
    told = {"event": "r1", "kind": "repair", "slow_time": AT - 1.0, "repair": share}
    client.record_event("lab.beam", told | {"person": "Ann", "text": "Bolts."})
    page = visit(house, "#lab.beam")
    recorded, changes = page.locator(".recorded"), page.locator(".revisions")
    item = recorded.locator("ol > li")
    recorded.locator("summary").press("Enter")
    recorded.get_by_role("button", name="Correct: Repair recorded by Ann").press("Enter")
    form = recorded.locator("form")
    # The form holds what the event says.
    expect(form.get_by_label("What happened")).to_have_value("repair")
    expect(form.get_by_label("What happened")).to_be_focused()
    expect(form.get_by_label("Restored")).to_have_value("share")
    expect(form.get_by_label("Share [%]")).to_have_value("90")
    expect(form.get_by_label("Standard deviation [%]")).to_have_value("10")
    expect(form.get_by_label("Text")).to_have_value("Bolts.")
    page.keyboard.press("Escape")
    expect(recorded.get_by_role("button", name="Correct: Repair")).to_be_focused()
    recorded.get_by_role("button", name="Correct: Repair").press("Enter")
    form.get_by_label("Share [%]").fill("60")
    form.get_by_label("Name").fill("Bob")
    form.get_by_label("Reason").fill("Two <b>bolts</b> are old.")
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []
    form.get_by_role("button", name="Save").press("Enter")

    # One entry, with what it said before; nothing but the share has changed.
    expect(recorded.locator(".answer")).to_contain_text("Saved.")
    expect(item).to_have_count(1)
    expect(item).to_contain_text("Repair recorded by Bob: 60\u202f% ± 10\u202f% of the damage")
    expect(item.locator(".former")).to_contain_text("Two <b>bolts</b> are old. Before:")
    expect(item.locator("del")).to_contain_text("Repair recorded by Ann: 90\u202f%")
    now, was = client.recorded_events("lab.beam").events
    assert now.repair == RepairResult.model_validate(share | {"restored_share": 0.6})
    assert (now.event, now.slow_time, now.text) == ("r1.2", AT - 1.0, "Bolts.")
    assert was.reversed_by == "r1.2"
    (change,) = client.changes("lab.beam")
    assert [one.field for one in change.changes] == ["repair"]

    changes.locator("summary").press("Enter")
    expect(changes.locator("li")).to_contain_text("Bob (token a local user): Two <b>bolts</b>")
    expect(changes.locator("li del")).to_contain_text("90\u202f%")
    expect(changes.locator("li ins")).to_contain_text("60\u202f%")
    changes.get_by_role("button", name="by Bob").press("Enter")
    expect(changes.locator(".answer")).to_have_text("Put back.")
    expect(item).to_have_count(1)
    expect(item.locator(".former")).to_have_count(2)
    again = client.recorded_events("lab.beam").events[0].repair
    assert again == RepairResult.model_validate(share)
    assert page.complaints == []


def test_an_inspection_with_a_curve_of_points_is_corrected_without_losing_it(house, visit):
    client = Client(house.url)
    points = [{"damage": 0.1, "probability": 0.5}, {"damage": 0.3, "probability": 0.9}]
    law = {"detected": False, "probability_of_detection": {"points": points}}
    client.record_event(
        "lab.beam", {"event": "i1", "kind": "inspection", "detection": law, "slow_time": 12.0}
    )
    page = visit(house, "#lab.beam", locale="de-DE")
    recorded = page.locator(".recorded")
    recorded.locator("summary").press("Enter")
    said = "Inspektion, eingetragen von a local user: kein Schaden gefunden."
    expect(recorded.locator("ol > li")).to_contain_text(said)
    recorded.get_by_role("button", name="Berichtigen: Inspektion").press("Enter")
    form = recorded.locator("form")
    expect(form.get_by_label("Ergebnis")).to_have_value("none")
    expect(form.get_by_label("Steigung der Entdeckungskurve")).to_be_hidden()
    form.get_by_label("Ergebnis").select_option("found")
    form.get_by_role("button", name="Speichern").press("Enter")
    expect(recorded.locator("ol > li")).to_contain_text("eingetragen von a local user: Schaden")
    now = client.recorded_events("lab.beam").events[0]
    assert now.detection is not None
    assert now.detection["detected"]
    assert [p["damage"] for p in now.detection["probability_of_detection"]["points"]] == [
        0.1, 0.3,
    ]  # fmt: skip
    assert now.slow_time == 12.0
