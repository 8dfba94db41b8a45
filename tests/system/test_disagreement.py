"""An effect enters unannounced, is noticed, named, adopted and undone: the whole house."""

import json
import urllib.error
import urllib.request
from typing import Any

import pytest

pytestmark = [pytest.mark.system, pytest.mark.slow]

SECONDS, ENTERS, PATIENCE_S = 10.0, 10_000, 150.0
MODEL: dict[str, Any] = {
    "slowtime_model": 1,
    "name": "rig",
    "nodes": [
        {"id": f"m{i}", "mass_kg": mass} for i, mass in ((1, 1.9), (2, 2.1), (3, 1.5))
    ],
    "elements": [
        {
            "id": f"j{i}", "between": between,
            "stiffness_n_per_m": stiffness, "damping_n_s_per_m": damping,
        }
        for i, between, stiffness, damping in (
            (1, ["base", "m1"], 4100.0, 2.3),
            (2, ["m1", "m2"], 3900.0, 2.2),
            (3, ["m2", "m3"], 3500.0, 2.0),
        )
    ],
    "inputs": [{"channel": "u", "kind": "force", "node": "m1", "unit": "N"}],
    "sensors": [
        {"channel": f"a{i}", "quantity": "acceleration", "node": f"m{i}", "unit": "m/s^2"}
        for i in (1, 2, 3)
    ],
    "tolerance": {"stiffness": 0.02, "damping": 0.15},
}  # fmt: skip
# The rig is not quite as its file claims, within tolerance.
REAL = MODEL | {
    "elements": [
        element | {"stiffness_n_per_m": element["stiffness_n_per_m"] * factor}
        for element, factor in zip(MODEL["elements"], (1.01, 0.985, 1.015), strict=True)
    ]
}
# On an element of the model, and between points that none joins.
FRICTION = {"effect": "coulomb", "element": "j2", "friction_n": 1.5}
DRAG = {"effect": "quadratic_damping", "element": "unknown", "c2_n_s2_per_m2": 60.0}
BESIDE = {"id": "unknown", "between": ["base", "m3"], "stiffness_n_per_m": 1e-6}


def edge(effect: dict[str, Any]) -> dict[str, Any]:
    """Settings of an edge that hears a rig into which an effect enters."""
    elements = REAL["elements"] + ([] if effect is FRICTION else [BESIDE])
    structure = {
        "kind": "model",
        "model": REAL | {"elements": elements},
        "effects": [effect],
        "enters": ENTERS,
        "seconds": SECONDS,
        "rate_hz": 100.0,
        "interval_s": SECONDS,
        "input_rms": 5.0,
        "band_hz": [0.5, 15.0],
        "sensor": {"noise": 0.02},
        "seed": 5,
    }
    return {
        "site": "lab",
        "asset": "rig",
        "extract": {"method": "peak", "channels": ["a3"], "window_s": SECONDS},
        "publish": {"linger_s": 1.0},
        "input": {"kind": "simulated", "every_s": 0.4, "structure": structure},
    }


TWIN = "/api/v1/twins/lab.rig"
GAP = {"every_s": 0.2, "seconds": SECONDS, "learn": 8}


def send(house, method, path, body=None):
    """Answer and status of a request, whatever it says."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(
        house.url + path, data, {"Content-Type": "application/json"}, method=method
    )
    try:
        with urllib.request.urlopen(request, timeout=300) as answer:
            return answer.status, json.loads(answer.read())
    except urllib.error.HTTPError as error:
        return error.code, json.loads(error.read())


def kinds(house):
    return [event["kind"] for event in house.get(f"{TWIN}/events?limit=1000")["events"]]


def judged(house):
    """Whether each of three records that are heard from now on is beyond the limit."""
    seen = len(house.get(f"{TWIN}/gap")["readings"])
    house.until(
        lambda: len(house.get(f"{TWIN}/gap")["readings"]) >= seen + 4, "more", PATIENCE_S
    )
    return [reading["disagrees"] for reading in house.get(f"{TWIN}/gap")["readings"][-3:]]


@pytest.mark.parametrize(
    ("effect", "place", "number"),
    [(FRICTION, "j2", "friction_n"), (DRAG, "base-m3", "c2_n_s2_per_m2")],
    ids=["on an element", "beside all elements"],
)
def test_an_effect_that_enters_unannounced_is_noticed_named_adopted_and_undone(
    house, effect, place, number
):
    house.router()
    config = house.home / "twin.json"
    config.write_text(json.dumps({"gap": GAP}))
    house.twin("--config", str(config))
    house.put(TWIN, {"changes": "stiffness", "model": MODEL})
    registered = house.get(TWIN)["registration"]
    assert send(house, "POST", f"{TWIN}/diagnoses", {"raw": {}})[0] == 409
    settings = edge(effect)
    house.edge(settings)

    house.until(lambda: "gap_learnt" in kinds(house), "the gap to be learnt", PATIENCE_S)
    learnt = house.get(f"{TWIN}/gap")
    assert learnt["expected"] < 0.05
    assert judged(house) == [False] * 3
    # How fast the learning goes depends on the machine, an epoch's number does not.
    assert house.end("edge") == 0
    later = settings | {"input": settings["input"] | {"first_epoch": ENTERS - 2}}
    heard = len(house.history("lab.rig"))
    house.edge(later)
    house.until(lambda: "disagreement" in kinds(house), "the disagreement", PATIENCE_S)
    assert house.get(f"{TWIN}/gap")["state"] == "disagreeing"
    (event,) = [
        e
        for e in house.get(f"{TWIN}/events?limit=1000")["events"]
        if e["kind"] == "disagreement"
    ]
    assert event["details"]["gap"] > 3 * learnt["expected"]
    house.until(lambda: len(house.history("lab.rig")) >= heard + 8, "records with friction")

    body = event["details"]["suggests"] | {"quick": True}
    body["raw"]["duration_s"] = 40.0
    status, job = send(house, "POST", f"{TWIN}/diagnoses", body | {"holdout_s": SECONDS})
    assert (status, job["state"]) in ((202, "queued"), (202, "running"))
    one = f"{TWIN}/diagnoses/{job['number']}"
    stages = set()

    def ended():
        now = house.get(one)
        stages.add(now["stage"])
        return now["ended_ns"] is not None

    house.until(ended, "the diagnosis", PATIENCE_S)
    found = house.get(one)
    assert found["state"] == "done", found["error"]
    assert len(stages) >= 3
    (named,) = found["report"]["effects"]
    assert (named["effect"], named["where"]["id"]) == (effect["effect"], place)
    value = named["parameters"][number]["value"]
    assert abs(value / effect[number] - 1) < 0.04
    gap = found["report"]["gap"]
    assert gap["augmented"] < 1.3 * gap["noise_floor"] < 0.3 * gap["refitted_nominal"]

    assert send(house, "POST", f"{one}/undo")[0] == 409
    assert judged(house) == [True] * 3
    assert send(house, "POST", f"{one}/adopt")[0] == 200
    assert judged(house) == [False] * 3
    shown = house.get(f"{TWIN}/gap")
    assert shown["state"] == "watching"
    assert all(r["nominal"] > 5 * r["in_use"] for r in shown["readings"][-3:])
    model = house.get(TWIN)["registration"]["model"]
    assert [one["effect"] for one in model["effects"]] == [effect["effect"]]
    assert place in [one["id"] for one in model["elements"]]
    assert send(house, "POST", f"{one}/undo")[0] == 200
    assert judged(house) == [True] * 3
    assert house.get(TWIN)["registration"] == registered
    said = kinds(house)
    order = ["gap_learnt", "disagreement", "diagnosed", "adopted", "agreement", "undone"]
    places = [said.index(kind) for kind in order]
    assert places == sorted(places)
    assert said.count("disagreement") == 2
    assert house.end("twin") == 0
