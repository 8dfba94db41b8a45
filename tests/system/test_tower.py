"""A tower in space under 24 channels, from samples to the page: the whole house, over Zenoh."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from playwright.sync_api import expect

pytestmark = [pytest.mark.system, pytest.mark.browser, pytest.mark.long]

TOWER = Path(__file__).parents[2] / "docs/examples/lattice_tower.yaml"
RATE_HZ, WINDOW_S = 40.0, 120.0
LEARN, LATER = 6, 6
SOFTER = "middle braces"


def softened(model, group, factor):
    """The tower with another modulus in the elements of one group."""
    changed = json.loads(json.dumps(model))
    frame = changed["frame"]
    steel = frame["materials"][0]
    frame["materials"].append(steel | {"id": "softer", "young_pa": factor * steel["young_pa"]})
    for element in frame["elements"]:
        if element.get("group") == group:
            element["material"] = "softer"
    return changed


def recorded(folder, model, name, windows, seed):
    """Samples of the tower in the wind."""
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(model))
    subprocess.run(
        [sys.executable, "-m", "slowtime_cli", "simulate", "--model", f"{name}.yaml",
         "--duration", str(windows * WINDOW_S), "--rate-hz", str(RATE_HZ),
         "--seed", str(seed), "--noise", "--out", f"{name}.npz"],
        cwd=folder, check=True, timeout=300,
    )  # fmt: skip
    return np.load(folder / f"{name}.npz")


def test_the_group_that_lost_a_tenth_is_named_and_drawn(house, visit, tmp_path):
    model = yaml.safe_load(TOWER.read_text())
    channels = [sensor["channel"] for sensor in model["sensors"]]
    built = recorded(tmp_path, model, "built", LEARN, 1)
    softer = recorded(tmp_path, softened(model, SOFTER, 0.9), "softer", LATER, 2)
    both = {name: np.concatenate([built[name], softer[name]]) for name in channels}
    np.savez(tmp_path / "both.npz", rate_hz=RATE_HZ, **both)  # type: ignore[arg-type]
    house.router()
    house.twin()
    names = [one["name"] for one in model["frame"]["parameters"]]
    house.put(
        "/api/v1/twins/lab.tower",
        {"changes": "elements", "model": model, "parameters": dict.fromkeys(names, 0.2),
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
    house.until(lambda: len(house.history("lab.tower")) == LEARN + LATER, "all windows")
    last = house.history("lab.tower")[-1]
    assert last["valid"], last["reasons"]
    assert last["suspects"] == [SOFTER]
    for name, one in last["elements"].items():
        # Errors of what was learnt from six windows are in all later ones.
        true = -0.1 if name == SOFTER else 0.0
        assert abs(one["value"] - true) < 4.0 * one["sd"]

    page = visit(house, "#lab.tower")
    canvas = page.locator('[id="lab.tower"] .wireframe canvas')
    expect(canvas).to_have_attribute("data-changed", SOFTER)
    expect(canvas).to_have_attribute("data-points", "12")
    expect(page.locator('[id="lab.tower"] .verdict')).to_contain_text(f"{SOFTER} has lost")
    assert page.complaints == []
