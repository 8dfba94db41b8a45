"""The page in a real Chromium: repairs and inspections are recorded, drawn, and taken back."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

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
        "Repair of stiffness_change recorded by Ann Moreau: 90 % ± 10 % of the damage restored"
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

    page.get_by_role("button", name="Undo: Repair of stiffness_change").press("Enter")
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
