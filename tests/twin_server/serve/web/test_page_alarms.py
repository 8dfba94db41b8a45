"""The page in a real Chromium: alarms are acknowledged by keyboard, and routes are tried."""

import time

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.client import Client
from tests.twin_server.notify.conftest import Hook
from twin_server.events.receivers import AlarmSettings

pytestmark = pytest.mark.browser


@pytest.fixture
def house(serving, features, tmp_path, eventually):
    """A server whose beam has two alarms, and a receiver that works, and one that does not."""
    secret = tmp_path / "secret"
    secret.write_text("a secret that is long enough")
    good, bad = Hook(), Hook(lambda n: 503)
    receivers = {
        name: {"kind": "webhook", "url": hook.url, "secret_file": secret}
        for name, hook in (("ops", good), ("pager", bad))
    }
    server = serving(alarms=AlarmSettings(receivers=receivers))
    body = {
        "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "confirm_readings": 1,
        "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
        "alarm_routes": [{"receiver": "ops"}, {"receiver": "pager"}],
    }  # fmt: skip
    server.client.put("/api/v1/twins/lab.beam", json=body)
    for n, frequency_hz in enumerate((3.0, 2.0, 3.0, 2.0)):
        message = features(n, frequency_hz=frequency_hz, t_ns=time.time_ns(), time_base="live")
        server.bus.publish(
            FEATURES.key("lab", "beam"), encode(message), encoding=FEATURES.encoding
        )
    assert eventually(lambda: len(good.accepted) == 2 and len(bad.requests) >= 2)
    yield server
    good.close()
    bad.close()


def test_an_alarm_is_acknowledged_by_keyboard_and_routes_are_tried(house, visit, eventually):
    page = visit(house, "#lab.beam")
    told = [
        one
        for one in house.get("/api/v1/twins/lab.beam/events").json()["events"]
        if one["kind"] == "alarm"
    ]
    expect(page.locator(".twin > .answer")).to_contain_text(
        f"(since {told[-1]['slow_time']:g} s)"
    )
    page.locator(".events summary").focus()
    page.keyboard.press("Enter")
    buttons = page.get_by_role("button", name="Acknowledge: Stiffness change below")
    expect(buttons).to_have_count(2)
    buttons.first.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".acknowledging").get_by_label("Name")).to_be_focused()
    page.keyboard.press("Escape")
    expect(buttons.first).to_be_focused()

    page.keyboard.press("Enter")
    page.keyboard.type("Ann Moreau")
    page.keyboard.press("Tab")
    page.keyboard.type("<b>On my way</b>")
    # Something else happens meanwhile, and takes nothing away from who is typing.
    Client(house.url).test_alarm("lab.beam", "ops")
    expect(page.locator(".events li", has_text="A test alarm")).to_have_count(1)
    expect(page.locator(".acknowledging").get_by_label("Note")).to_be_focused()
    expect(page.locator(".acknowledging").get_by_label("Note")).to_have_value(
        "<b>On my way</b>"
    )
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []

    page.keyboard.press("Enter")
    seen = page.locator(".seen", has_text="Acknowledged by Ann Moreau: <b>On my way</b>")
    expect(seen).to_be_visible()
    expect(seen).to_be_focused()
    expect(buttons).to_have_count(1)
    newest = Client(house.url).alarms("lab.beam")[0]
    assert newest["acknowledged"]["by"] == "Ann Moreau"

    routes = page.locator(".routes li")
    expect(routes.first).to_contain_text("ops: ")
    expect(routes.last).to_contain_text("The receiver answered 503")
    page.get_by_role("button", name="Send a test alarm").press("Enter")
    expect(page.locator(".routes [role=status]")).to_have_text("Sent to ops, pager.")
    page.reload()
    page.locator(".events summary").click()
    expect(page.locator(".seen", has_text="Acknowledged by Ann Moreau")).to_be_visible()
    assert page.complaints == []
