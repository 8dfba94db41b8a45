"""The page shows fatigue damage with its band, and virtual quantities of the last window."""

import pytest
from playwright.sync_api import expect

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import (
    CurveOfMessage,
    Fatigue,
    FatiguePoint,
    Virtual,
    VirtualQuantity,
)
from slowtime_schemas.streams import FATIGUE, VIRTUAL

TWIN = "/api/v1/twins/lab.beam"
pytestmark = pytest.mark.browser

T0 = 1_790_000_000_000_000_000


def messages():
    common = {"site": "lab", "asset": "beam", "boot": "b1", "time_base": "recorded"}
    for n in range(1, 6):
        yield FATIGUE, Fatigue(
            **common, sequence=n, start_ns=T0, t_ns=T0 + n * 3_600_000_000_000,
            points=(
                FatiguePoint(
                    name="k1.stress", unit="MPa", source="virtual", damage=1e-6 * n,
                    closed_damage=1e-6 * n, ln_sd=0.5, slope=3.0, seconds=3600.0 * n,
                    curve=CurveOfMessage(constant=1e12, slope=3.0),
                ),
            ),
        )  # fmt: skip
    yield VIRTUAL, Virtual(
        **common, sequence=0, start_ns=T0, t_ns=T0 + 10**9, rate_hz=4.0, lowest_hz=0.5,
        valid=True,
        quantities=(
            VirtualQuantity(name="top", unit="m", values=(0.1, -0.3, 0.2), sd=(0.01,) * 3),
        ),
    )  # fmt: skip


@pytest.mark.long
def test_damage_and_virtual_quantities_are_shown(serving, visit, ageing, eventually):
    server = serving()
    server.feed(ageing(12))
    assert eventually(lambda: server.count() == 12)
    for stream, one in messages():
        key = stream.key("lab", "beam")
        server.bus.publish(key, encode(one), encoding=stream.encoding, replayed=True)
    assert eventually(lambda: server.get(f"{TWIN}/virtual").json()["windows"])
    assert eventually(lambda: server.get(f"{TWIN}/fatigue").json()["points"])
    page = visit(server, "#lab.beam")
    row = page.locator('[id="lab.beam"] [data-point="k1.stress"]')
    expect(row.locator("td").nth(0)).to_have_text("5.0e\u22126")
    expect(row.locator("td").nth(3)).to_contain_text("years")
    expect(row.locator("svg.spark")).to_have_count(1)
    figure = page.locator('[id="lab.beam"] [data-quantity="top"]')
    expect(figure).to_contain_text("largest \u22120.3 ± 0.0196 m in the last time window")
