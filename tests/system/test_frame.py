"""A storey loses stiffness while the page looks on: the whole house, over real Zenoh."""

import re

import pytest
from playwright.sync_api import expect

from slowtime_services.models import model_file_of
from slowtime_services.simulate import SimulatedFrame

pytestmark = [pytest.mark.system, pytest.mark.browser]

LOST, ENTERS, EPOCHS = -0.2, 16, 26
STRUCTURE = {
    "kind": "frame",
    "seconds": 120.0,
    "rate_hz": 30.0,
    "epochs": EPOCHS,
    "stiffness": {"storey2": {"kind": "step", "at_slow_time": ENTERS, "change": LOST}},
    "sensor": {"noise": 0.1},
    "seed": 8,
}
EDGE = {
    "site": "lab",
    "asset": "frame",
    "extract": {"method": "modes", "order": 16, "tracking": {"confirm": 3}},
    "publish": {"linger_s": 60.0},
    "input": {"kind": "simulated", "every_s": 0.3, "structure": STRUCTURE},
}
STOREYS = ("storey1", "storey2", "storey3")


@pytest.mark.long
def test_the_page_names_the_storey_that_loses_stiffness(house, visit):
    frame = SimulatedFrame(**STRUCTURE)
    model = model_file_of(frame.description).model_dump(mode="json", exclude_defaults=True)
    house.router()
    house.twin()
    learn = {"learn_epochs": 10, "confirm_readings": 2}
    house.put("/api/v1/twins/lab.frame", {"changes": "elements", "model": model, **learn})
    page = visit(house, "#lab.frame")
    expect(page.locator('[id="lab.frame"]')).to_contain_text("no features yet")
    page.evaluate("window.untouched = true")
    house.edge(EDGE)

    verdict = page.locator('[id="lab.frame"] .verdict')
    said = re.compile(
        r"^storey2 has lost (\d+)[\d.]*\u202f% ± [\d.]+\u202f% of its stiffness\.$"
    )
    expect(verdict).to_have_text(said)
    assert house.wait("edge") == 0
    house.until(lambda: len(house.history("lab.frame")) == EPOCHS, "all epochs")
    rows = page.locator('[id="lab.frame"] table.modes tbody tr')
    expect(rows).to_have_count(3)
    expect(rows.locator("svg .shape")).to_have_count(3)
    expect(rows.locator("svg .band")).to_have_count(3)
    chart = page.locator('[id="lab.frame"] [data-quantity="elements"]')
    expect(chart).to_have_attribute("data-suspects", "storey2")
    assert page.evaluate("window.untouched")
    assert page.complaints == []

    points = house.history("lab.frame")
    judged = points[10:]
    assert all(point["valid"] for point in judged)
    accused = [point["suspects"] for point in judged]
    assert accused[: ENTERS - 10].count([]) >= ENTERS - 11
    assert accused[ENTERS - 10 :].count(["storey2"]) >= EPOCHS - ENTERS - 2
    held = [
        point["elements"][name]["lo"] <= point["truth"][name] <= point["elements"][name]["hi"]
        for point in judged
        for name in STOREYS
    ]
    assert sum(held) / len(held) > 0.85
    # A jump of 6 % takes the tracker three windows to believe; nobody gets another name.
    named = [
        {mode["identity"] for mode in modes} - {None}
        for modes in zip(*(point["modes"] for point in points), strict=True)
    ]
    assert named == [{1}, {2}, {3}]
    events = house.get("/api/v1/twins/lab.frame/events")["events"]
    assert [e["details"]["suspect"] for e in events if e["kind"] == "element_changed"] == [
        "storey2"
    ]
