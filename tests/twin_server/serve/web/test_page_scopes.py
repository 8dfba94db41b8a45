"""The page in a real Chromium: whoever may only look sees no button that would be refused."""

import datetime

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter
from tests.twin_server.serve.conftest import Diagnosing
from twin_server.serve.access import TokenFile
from twin_server.settings import AccessSettings, DiagnoseSettings, GapSettings

pytestmark = pytest.mark.browser

REPAIR = {"event": "r1", "kind": "repair", "person": "Ann", "repair": {"restored_share": 1.0}}
OPERATED = {
    "state": (
        "Change the limits", "Change the costs", "Record a repair or inspection",
        "Correct: Repair", "Undo: Repair",
    ),
    "diagnosis": ("Find what the model lacks", "Find what drives", "Adopt"),
    "recordings": ("Replay",),
}  # fmt: skip
"""Buttons of each view that the server wants an operator for."""


@pytest.fixture(scope="module")
def guarded(serving, pretender, ageing, eventually, tmp_path_factory):
    """A server with tokens, a diagnosed rig whose repair is recorded, and a recording."""
    home = tmp_path_factory.mktemp("guarded")
    tokens = TokenFile(home / "tokens.json")
    day = datetime.timedelta(days=1)
    words = {
        scope: tokens.add(scope, scope, ["*"], day) for scope in ("viewer", "operator", "admin")
    }
    server = serving(
        diagnosis=pretender,
        access=AccessSettings(tokens=tokens.path),
        diagnose=DiagnoseSettings(recordings=home),
        gap=GapSettings(every_s=0.0),
    )
    server.client.headers["Authorization"] = f"Bearer {words['admin']}"
    made = Diagnosing(server, eventually)
    for epoch in range(2):
        made.edge.hear(epoch)
    assert made.post("/events", REPAIR).status_code == 201
    number = made.post("/diagnoses", {"raw": {"duration_s": 10.0}}).json()["number"]
    assert made.ended(number)["report"]["effects"]
    with RecordingWriter(home / "kept.mcap") as writer:
        for message in ageing(5, asset="other"):
            writer.write(FEATURES, "lab", "other", encode(message), message.t_ns)
    yield server, words
    made.edge.close()


@pytest.fixture
def enter(guarded, visit):
    """Open a view of the page with a token of a scope."""
    server, words = guarded

    def go(fragment, scope, locale="en-GB"):
        page = visit(server, fragment, locale=locale)
        page.locator("#token").fill(words[scope])
        page.locator("#token").press("Enter")
        expect(page.locator("html")).to_have_attribute("data-scope", scope)
        return page

    return go


@pytest.mark.parametrize("scope", ["viewer", "operator", "admin"])
def test_buttons_are_those_that_the_server_would_not_refuse(enter, scope):
    page = enter("#lab.rig", scope)
    acts = scope != "viewer"
    for summary in (".limits", ".costs", ".recorded"):
        page.locator(f"{summary} > summary").click()
    expect(page.locator(".recorded ol > li")).to_contain_text("Repair recorded by Ann")
    offered(page, "state", acts)
    page.get_by_role("link", name="Diagnosis").click()
    expect(page.locator(".jobs .verdict")).to_have_text("Dry friction in j2, 0.5 N.")
    offered(page, "diagnosis", acts)
    why = page.get_by_text("Your token may only look at diagnoses.")
    expect(why).to_be_hidden() if acts else expect(why).to_be_visible()
    # What a viewer may do stays.
    expect(page.locator(".jobs").get_by_role("button", name="Report")).to_be_visible()

    page.get_by_role("link", name="Recordings").click()
    card = page.locator('[data-recording="kept.mcap"]')
    expect(card.get_by_role("link", name="Download")).to_be_visible()
    offered(page, "recordings", acts)
    upload = page.get_by_label("Upload a recording")
    expect(upload).to_be_visible() if acts else expect(upload).to_be_hidden()
    delete = card.get_by_role("button", name="Delete")
    expect(delete).to_be_visible() if scope == "admin" else expect(delete).to_be_hidden()
    why = page.get_by_text("Your token may look at recordings and download them.")
    expect(why).to_be_hidden() if acts else expect(why).to_be_visible()
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []


def offered(page, view, acts):
    for name in OPERATED[view]:
        button = page.get_by_role("button", name=name).first
        expect(button).to_be_visible() if acts else expect(button).to_be_hidden()


def test_a_viewer_is_told_so_in_german(enter):
    page = enter("#lab.rig/diagnosis", "viewer", "de-DE")
    expect(page.get_by_text("Ihr Token darf Diagnosen nur ansehen.")).to_be_visible()
