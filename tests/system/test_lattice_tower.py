"""A tower of 20,160 degrees of freedom and 30 groups under 24 channels, up to the page."""

import json
import subprocess
import sys

import numpy as np
import pytest
from playwright.sync_api import expect

from benchmarks.methods.lattice_tower.structure import Layout, export_tower, group_names

pytest.importorskip("pyfe3d")
pytestmark = [pytest.mark.system, pytest.mark.browser, pytest.mark.slow]

RATE_HZ, WINDOW_S = 20.0, 1800.0
"""The lowest mode takes 9 s, so that a window holds some 200 of its periods."""

LEARN, LATER = 4, 4
SOFTER = "legs 4"


def run(folder, *arguments):
    command = [sys.executable, "-m", "slowtime_cli", *arguments]
    subprocess.run(command, cwd=folder, check=True, timeout=1200)


def recorded(folder, model, name, windows, seed):
    """Samples of the tower in the wind."""
    run(
        folder, "simulate", "--model", str(model), "--duration", str(windows * WINDOW_S),
        "--rate-hz", str(RATE_HZ), "--seed", str(seed), "--noise", "--out", f"{name}.npz",
    )  # fmt: skip
    return np.load(folder / f"{name}.npz")


def test_no_other_of_thirty_groups_is_named_and_the_tower_is_drawn(house, visit, tmp_path):
    model = export_tower(tmp_path / "built", Layout())
    changed = export_tower(tmp_path / "softer", Layout(), changes={SOFTER: -0.1})
    built = recorded(tmp_path, model, "built", LEARN, 1)
    softer = recorded(tmp_path, changed, "softer", LATER, 2)
    channels = [name for name in built.files if name != "t"]
    assert len(channels) == 24
    both = {name: np.concatenate([built[name], softer[name]]) for name in channels}
    np.savez(tmp_path / "both.npz", rate_hz=RATE_HZ, **both)  # type: ignore[arg-type]
    run(
        tmp_path, "reduce", str(model), "--modes", "20", "--coordinates", "64",
        "--trials", "0", "--out", "small.json",
    )  # fmt: skip
    house.router()
    house.twin()
    house.put(
        "/api/v1/twins/lab.tower",
        {"changes": "elements", "model": json.loads((tmp_path / "small.json").read_text()),
         "parameters": dict.fromkeys(group_names(), 0.2),
         "learn_epochs": LEARN, "confirm_readings": 2},
    )  # fmt: skip
    edge = {
        "site": "lab",
        "asset": "tower",
        "extract": {"method": "modes", "window_s": WINDOW_S},
        "publish": {"linger_s": 60.0},
        "input": {"kind": "file", "path": str(tmp_path / "both.npz"), "speed": 0.0},
    }
    house.edge(edge)
    house.until(
        lambda: len(house.history("lab.tower")) == LEARN + LATER, "all windows", patience_s=1800
    )
    last = house.history("lab.tower")[-1]
    assert last["valid"], last["reasons"]
    # Half an hour of wind hardly determines a tenth of one group in thirty: it may be named, and
    # no other may be.
    assert all(SOFTER in one.split(" or ") for one in last["suspects"]), last["suspects"]
    errors = [
        (one["value"] - (-0.1 if name == SOFTER else 0.0)) / one["sd"]
        for name, one in last["elements"].items()
    ]
    assert len(errors) == 30
    # Errors of what was learnt from four windows are in all later ones.
    assert max(map(abs, errors)) < 5.0

    page = visit(house, "#lab.tower")
    canvas = page.locator('[id="lab.tower"] .wireframe canvas')
    expect(canvas).to_be_visible()
    drawn = house.get("/api/v1/twins/lab.tower/shapes")
    assert len(drawn["nodes"]) == 300
    assert max(place[2] for place in drawn["nodes"]) == pytest.approx(Layout().height_m)
    assert sum(mode["measured_hz"] is not None for mode in drawn["modes"]) >= 10
    assert page.complaints == []
