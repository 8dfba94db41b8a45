"""An own effect that was adopted works in the twin where its operator has named the part."""

import json
import shutil
import sys

import pytest

from tests.services.plugins.own_effects import EFFECTS
from tests.services.plugins.test_plugins import installed as installed
from tests.twin_server.serve.conftest import PRETENDS, RIG, Diagnosing
from twin_server.settings import DiagnoseSettings, GapSettings

SOFTENING = '{"effect": "softening_spring", "element": "j2", "k_n_per_m": 1.0, "d_m": 0.01}'
ORDER = {
    "load": {"kind": "harmonic", "amplitude": 1.0, "frequency_hz": 2.0}, "on": "m1",
    "quantity": "displacement", "duration_s": 2.0, "draws": 20,
}  # fmt: skip


@pytest.fixture
def rig(serving, eventually, installed, tmp_path):
    """Start a server whose diagnoses find an own effect; it may load some parts."""
    (tmp_path / "site/own_effects.py").write_text(EFFECTS)
    installed("effects", "soft", "own_effects:GOOD")
    script = tmp_path / "pretends.py"
    found = '{"effect": "coulomb", "element": "j2", "friction_n": 0.5}'
    assert found in PRETENDS
    script.write_text(
        PRETENDS.replace(found, SOFTENING).replace(
            '"effect": "coulomb"', '"effect": "softening_spring"'
        )
    )
    made = []

    def start(*effects):
        server = serving(
            diagnosis=[sys.executable, str(script)],
            gap=GapSettings(every_s=0.05, seconds=6.0, learn=4, tune=1),
            diagnose=DiagnoseSettings(effects=effects),
        )
        made.append(Diagnosing(server, eventually))
        made[-1].hear(1)
        number = made[-1].post("/diagnoses", {"raw": {"duration_s": 6.0}}).json()["number"]
        assert made[-1].ended(number)["state"] == "done"
        return made[-1], made[-1].post(f"/diagnoses/{number}/adopt")

    yield start
    for one in made:
        one.edge.close()


@pytest.mark.long
def test_it_is_adopted_and_its_model_compared(rig):
    server, answer = rig("soft")
    assert answer.status_code == 200, answer.text
    model = server.server.get(server.twin).json()["registration"]["model"]
    assert model["effects"][0]["effect"] == "softening_spring"
    server.learn()
    assert "effect_failed" not in server.kinds()
    reading = server.gap()["readings"][-1]
    assert reading["in_use"] != reading["nominal"]


@pytest.mark.long
def test_one_that_is_gone_costs_the_comparison_of_its_own_model_only(rig, tmp_path):
    server, answer = rig("soft")
    assert answer.status_code == 200, answer.text
    shutil.rmtree(tmp_path / "site/bad_parts-1.0.dist-info")
    server.learn()
    assert server.kinds().count("effect_failed") == 1
    reading = server.gap()["readings"][-1]
    assert reading["in_use"] == reading["nominal"]


@pytest.mark.long
@pytest.mark.parametrize("effects", [("soft",), ()])
def test_a_twin_whose_model_has_it_is_run_or_says_what_to_do(
    serving, ageing, eventually, installed, tmp_path, effects
):
    (tmp_path / "site/own_effects.py").write_text(EFFECTS)
    installed("effects", "soft", "own_effects:GOOD")
    own = serving(diagnose=DiagnoseSettings(effects=effects))
    model = RIG | {"effects": [json.loads(SOFTENING)]}
    body = {"model": model, "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
    assert own.client.put("/api/v1/twins/lab.beam", json=body).status_code == 201
    own.feed(ageing(20))
    assert eventually(lambda: own.count() == 20)
    answer = own.client.post("/api/v1/twins/lab.beam/simulate", json=ORDER)
    if effects:
        assert answer.status_code == 200, answer.text
        assert answer.json()["outputs"]["m1"]["peak"]["value"] > 0.0
    else:
        assert answer.status_code == 422
        assert "The model has softening_spring, which is no effect of slowtime" in answer.text
        assert "diagnose.effects of the server's settings" in answer.text


@pytest.mark.long
def test_without_its_name_in_the_settings_it_is_refused_with_what_to_do(rig):
    _, answer = rig()
    assert (answer.status_code, answer.json()["type"][-16:]) == (409, "effect-not-there")
    told = answer.json()["detail"]
    assert "found softening_spring, which slowtime does not know" in told
    assert "may load effects from: none. An operator must name" in told
    assert "diagnose.effects" in told
