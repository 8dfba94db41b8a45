"""The diagnosis on the page, in a real Chromium: asked for, told of, adopted, undone."""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

PATIENCE_MS = 20_000


def test_what_the_model_lacks_is_asked_for_adopted_and_undone_on_the_page(resting, visit):
    page = visit(resting.server)
    room = page.locator('[id="lab.rig"] .diagnosis')
    expect(room).to_be_visible(timeout=PATIENCE_MS)
    room.locator("summary").click()

    room.get_by_label("quick").check()
    room.get_by_role("button", name="Ask what the model lacks").click()
    job = room.locator(".jobs > li").first
    expect(job.locator(".pill")).to_have_text("running", timeout=PATIENCE_MS)
    expect(job.locator(".stage")).to_have_text("refitting coulomb at element j2")
    assert float(job.locator("progress").get_attribute("value")) == 0.4
    job.get_by_role("button", name="Cancel").click()
    expect(job.locator(".pill")).to_have_text("cancelled", timeout=PATIENCE_MS)

    room.get_by_label("quick").uncheck()
    room.get_by_role("button", name="Ask what the model lacks").click()
    job = room.locator(".jobs > li").first
    expect(job.locator(".verdict")).to_have_text(
        "Dry friction in j2, 0.5 N.", timeout=PATIENCE_MS
    )
    bars = job.locator("table.bars tr")
    expect(bars).to_have_count(4)
    expect(bars.nth(2)).to_contain_text("with coulomb")
    job.get_by_role("button", name="Report").click()
    expect(job.frame_locator("iframe").locator("h1")).to_have_text("Dry friction")

    job.get_by_role("button", name="Adopt").click()
    undo = job.get_by_role("button", name="Undo")
    expect(undo).to_be_visible(timeout=PATIENCE_MS)
    expect(job.locator(".acts")).to_contain_text("adopted")
    undo.click()
    expect(job.get_by_role("button", name="Adopt")).to_be_visible(timeout=PATIENCE_MS)
    assert resting.kinds()[-3:] == ["diagnosed", "adopted", "undone"]
    assert page.complaints == []


def test_what_cannot_be_asked_is_said_on_the_page(resting, visit):
    page = visit(resting.server)
    room = page.locator('[id="lab.rig"] .diagnosis')
    expect(room).to_be_visible(timeout=PATIENCE_MS)
    room.locator("summary").click()
    room.get_by_role("button", name="Ask what the history follows").click()
    expect(room.get_by_role("alert")).to_contain_text(
        re.compile("A diagnosis in slow time needs"), timeout=PATIENCE_MS
    )
