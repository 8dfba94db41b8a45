"""A tower of 30 groups under 24 channels, from samples over Zenoh to the page in 3-D."""

import pytest
from playwright.sync_api import expect

from benchmarks.methods.lattice_tower.record import write_record

pytest.importorskip("pyfe3d")
pytestmark = [pytest.mark.system, pytest.mark.browser, pytest.mark.slow]

GROUP = "legs 5"
PATIENCE_S = 1800.0
"""Time [s] for ten windows of an hour, each identified in five seconds of a free processor."""


def test_the_group_of_thirty_that_lost_a_tenth_is_named_and_drawn(house, visit, tmp_path):
    made = write_record(tmp_path, GROUP)
    house.router()
    house.twin()
    house.put("/api/v1/twins/lab.tower", made.registration)
    house.edge(made.edge)
    house.until(
        lambda: len(house.history("lab.tower")) == made.windows, "all windows", PATIENCE_S
    )
    last = house.history("lab.tower")[-1]
    assert last["valid"], last["reasons"]
    assert last["suspects"] == [GROUP]
    assert len(last["elements"]) == 30
    for name, one in last["elements"].items():
        assert abs(one["value"] - made.change[name]) < 4.0 * one["sd"]
    found = house.get("/api/v1/twins/lab.tower/events")["events"]
    changed = [one for one in found if one["kind"] == "element_changed"]
    assert [one["details"]["suspect"] for one in changed] == [GROUP]

    assert "Refused" not in house.said("twin")

    page = visit(house, "#lab.tower")
    canvas = page.locator('[id="lab.tower"] .wireframe canvas')
    expect(canvas).to_have_attribute("data-changed", GROUP)
    expect(page.locator('[id="lab.tower"] .verdict')).to_contain_text(f"{GROUP} has lost")
    # Two of the 24 channels are at each corner that is heard: at two corners of six levels.
    expect(canvas).to_have_attribute("data-points", "12")
    assert page.complaints == []
