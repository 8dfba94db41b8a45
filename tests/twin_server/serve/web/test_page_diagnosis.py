"""The diagnosis on the page, in a real Chromium: asked for, told of, adopted, undone."""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.mark.long
def test_what_the_model_lacks_is_asked_for_adopted_and_undone_on_the_page(resting, visit):
    page = visit(resting.server, "#lab.rig/diagnosis")
    room = page.locator('[id="lab.rig"] .diagnosis')
    expect(room).to_be_visible()

    room.get_by_label("quick").check()
    room.get_by_role("button", name="Find what the model lacks").click()
    job = room.locator(".jobs > li").first
    expect(job.locator(".pill")).to_have_text("running")
    expect(job.locator(".stage")).to_have_text("refitting coulomb at element j2")
    assert float(job.locator("progress").get_attribute("value")) == 0.4
    job.get_by_role("button", name="Cancel").click()
    expect(job.locator(".pill")).to_have_text("cancelled")

    room.get_by_label("quick").uncheck()
    room.get_by_role("button", name="Find what the model lacks").click()
    job = room.locator(".jobs > li").first
    expect(job.locator(".verdict")).to_have_text("Dry friction in j2, 0.5 N.")
    bars = job.locator("table.bars tr")
    expect(bars).to_have_count(4)
    expect(bars.nth(2)).to_contain_text("with coulomb")
    found = job.locator(".found-table").first
    expect(found).to_contain_text("friction 0.5 ± 0.01\u202fN")
    expect(found.locator("tbody th")).to_have_text("coulomb")
    expect(found).to_contain_text("element j2")
    expect(job.locator(".share").first).to_contain_text("90\u202f%")
    expect(job.locator(".finding")).to_contain_text("the base")
    expect(job.locator(".finding")).not_to_contain_text("base base")
    expect(job.locator(".finding")).to_contain_text("largest at 0.05 to 0.15\u202fs")
    overlay = job.locator(".overlay .plot")
    expect(overlay.locator(".legend")).to_be_visible()
    drawn = overlay.evaluate(
        "plot => [plot.data.map(t => [t.name, t.line.dash]), plot.layout,"
        " new Set(plot.data.map(t => t.line.color)).size]"
    )
    names = ["measured", "original model", "augmented"]
    assert [name for name, _ in drawn[0]] == names
    assert len({dash for _, dash in drawn[0]}) == 2, "lines are told apart by colour alone"
    assert drawn[2] == 3, "two lines have the same colour"
    assert [(span["x0"], span["x1"]) for span in drawn[1]["shapes"]] == [(0.05, 0.15)]
    assert drawn[1]["xaxis"]["title"]["text"] == "campaign time [s]"
    job.get_by_role("button", name="Report").click()
    expect(job.frame_locator("iframe").locator("h1")).to_have_text("Dry friction")

    job.get_by_role("button", name="Adopt").click()
    undo = job.get_by_role("button", name="Undo")
    expect(undo).to_be_visible()
    expect(job.locator(".acts")).to_contain_text("adopted")
    undo.click()
    expect(job.get_by_role("button", name="Adopt")).to_be_visible()
    assert resting.kinds()[-3:] == ["diagnosed", "adopted", "undone"]
    assert page.complaints == []


@pytest.mark.long
def test_a_connection_that_the_model_had_not_is_adopted_and_undone_on_the_page(resting, visit):
    client, twin = resting.server.client, resting.twin
    given = client.get(twin).json()["registration"]
    asked = {key: value for key, value in given.items() if value}
    asked["model"] = {**given["model"], "name": "open"}
    assert client.put(twin, json=asked).status_code in (200, 201)
    registered = client.get(twin).json()["registration"]

    page = visit(resting.server, "#lab.rig/diagnosis")
    room = page.locator('[id="lab.rig"] .diagnosis')
    room.get_by_role("button", name="Find what the model lacks").click()
    job = room.locator(".jobs > li").first
    expect(job.locator(".verdict")).to_have_text("Drag beside m2.")
    expect(job.locator(".found-table").first).to_contain_text("element base-m2")
    job.get_by_role("button", name="Adopt").click()
    expect(job.get_by_role("button", name="Undo")).to_be_visible()
    model = client.get(twin).json()["registration"]["model"]
    assert [one["id"] for one in model["elements"]] == ["j1", "j2", "base-m2"]
    assert model["effects"][0]["element"] == "base-m2"
    job.get_by_role("button", name="Undo").click()
    expect(job.get_by_role("button", name="Adopt")).to_be_visible()
    assert client.get(twin).json()["registration"] == registered
    assert page.complaints == []
    assert client.put(twin, json={k: v for k, v in given.items() if v}).status_code == 200


@pytest.mark.long
def test_what_cannot_be_asked_is_said_on_the_page(resting, visit):
    page = visit(resting.server, "#lab.rig/diagnosis")
    room = page.locator('[id="lab.rig"] .diagnosis')
    expect(room).to_be_visible()
    room.get_by_role(
        "button", name="Find what drives the slow change (temperature, load, time)"
    ).click()
    expect(room.get_by_role("alert")).to_contain_text(
        re.compile("A diagnosis in slow time needs")
    )
