"""The plant under trial and the blind cases' own integrators say the same of the same model."""

import numpy as np
import pytest

from slowtime.dynamics.plant import Plant
from slowtime_services.models import read_description
from tests.blind.draws import draft
from tests.blind.equations import System
from tests.blind.files import model_text
from tests.blind.law import Placed
from tests.blind.laws import LAWS, LISTED
from tests.blind.motion import move
from tests.blind.rig import Element, Rig
from tests.blind.sensing import Sensor, measured
from tests.blind.signals import Signal, excitation, knot_rate
from tests.blind.test_motion import HERE
from tests.blind.world import World

RIG = Rig((1.9, 2.1), (Element("j0", -1, 0, 4100.0, 2.3), Element("j1", 0, 1, 3900.0, 2.2)))
RATE_HZ, SECONDS = 256.0, 3.0
SENSORS = tuple(Sensor(q, i) for q in ("displacement", "acceleration") for i in (0, 1))
KNOTS_HZ = knot_rate(RATE_HZ, 24.0)
TIMES = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
START = [1e-3, -1e-3, 0.02, 0.03]
KINDS = [
    name
    for name in LISTED
    if LAWS[name].where in ("element", "node") and name != "pendulum_sine"
]


def faded(values):
    """Away at both ends, where nobody knows how a band-limited signal goes on."""
    ramp = np.clip(np.arange(len(values)) / (0.3 * KNOTS_HZ), 0, 1)
    return values * np.sin(np.pi / 2 * ramp) ** 2 * np.sin(np.pi / 2 * ramp[::-1]) ** 2


def wave(seed, size):
    rng = np.random.default_rng(seed)
    return Signal.through(
        size * faded(excitation("random", (1.0, 16.0), SECONDS + 0.5, KNOTS_HZ, rng)), KNOTS_HZ
    )


@pytest.mark.parametrize("name", KINDS)
def test_the_plant_moves_as_our_own_integrators_say(name, tmp_path):
    law = LAWS[name]
    place = {"element": "j1", "node": "m2"}[law.where]
    p = draft(name, np.random.default_rng(8), HERE).at(1.0)
    shaken = name in ("coulomb", "cubic_hardening", "extra_dof")
    signal = wave(3, 0.8) if shaken else wave(3, 1.3)
    effect = Placed(law, place, p)
    system = System(RIG, (effect,), {} if shaken else {1: signal}, (signal,) if shaken else ())
    start = [*START, *[0.0] * (system.states - 4)]
    ours = measured(move(system, TIMES, start, scale=(3e-3, 0.1)), SENSORS)
    world = World(
        RIG, RIG, (0.01, 0.1), (), ("base",) if shaken else ("m2",), 1.0, RATE_HZ, SENSORS,
        (1.0,) * 4, False, (), HERE.campaign_s, (1e-3, 0.1),
    )  # fmt: skip
    told = dict(p)
    if "campaign_s" in told:
        told["span_s"] = told.pop("campaign_s")
    entry = {"effect": name, law.where: place} | told
    if "side" in entry:
        entry["side"] = int(entry["side"])
    line = ", ".join(f"{key}: {value}" for key, value in entry.items())
    path = tmp_path / "model.yaml"
    path.write_text(model_text(world) + f"effects:\n  - {{{line}}}\n")
    plant = Plant.of(read_description(path))
    order = [(kind, node) for kind in ("displacement", "velocity") for node in RIG.nodes]
    known = dict(zip(order, START, strict=True))
    state0 = np.array([known.get(name, 0.0) for name in plant.state_names])
    theirs = plant.simulate(plant.values, signal.at(TIMES)[:, None], RATE_HZ, state0=state0)
    error = np.sqrt(np.mean((theirs - ours) ** 2, axis=0)) / ours.std(axis=0)
    assert error.max() < 1e-3, error
