"""Excitations and imposed motion: signals in closed form, forces by another integrator."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.blind.excitations.cases import EXCITATIONS, KINDS, build, draw, draw_design
from tests.blind.excitations.imposed import law_force
from tests.blind.files import write_case
from tests.blind.law import Placed
from tests.blind.laws import LAWS
from tests.blind.signals import Signal, excitation

RATE_HZ = 1000.0
BAND_HZ = (2.0, 20.0)


def signal(kind, seed=3):
    return excitation(kind, BAND_HZ, 30.0, RATE_HZ, np.random.default_rng(seed))


def test_a_stepped_sine_dwells_at_frequencies_within_the_band():
    values = signal("stepped_sine")
    crossings = np.flatnonzero(np.diff(np.signbit(values)))
    halves = np.diff(crossings) / RATE_HZ
    hertz = 1 / (2 * halves)
    assert BAND_HZ[0] - 0.1 < hertz.min() < 2.2
    assert 19.0 < hertz.max() < 1.05 * BAND_HZ[1]
    steady = np.abs(np.diff(hertz)) < 0.05 * hertz[1:]
    assert steady.mean() > 0.9
    assert np.mean(values**2) == pytest.approx(1.0)


def test_a_hammer_rests_between_blows_that_only_push():
    values = signal("hammer")
    assert (values >= 0).all()
    blows = np.flatnonzero(np.diff((values > 0).astype(int)) == 1)
    assert 7 <= len(blows) <= 15
    assert np.diff(blows).min() > 1.9 * RATE_HZ
    assert (values == 0).mean() > 0.95


def test_a_longer_battery_begins_with_the_same_cases_and_has_every_pair_once():
    assert draw(8, 5) == draw(60, 5)[:8]
    drawn = draw(len(EXCITATIONS) * len(KINDS), 5)
    pairs = {(design.kinds[0], design.excitation) for _, design, _ in drawn}
    assert len(pairs) == len(drawn)
    assert len({name for name, _, _ in drawn}) == len(drawn)


@pytest.fixture(scope="module")
def released():
    design = draw_design("gap_symmetric", "release", 11)
    return build("000000bb", design, 4), build(
        "000000bc", draw_design("gap_symmetric", "sweep", 11), 4
    )


def test_excitations_of_one_rig_share_masses_springs_and_the_place(released):
    one, other = released
    assert one.world.rig == other.world.rig
    assert one.world.nominal == other.world.nominal
    assert one.world.sensors == other.world.sensors
    assert one.world.effects[0].place == other.world.effects[0].place
    assert (
        one.world.effects[0].parameters["gap_m"] == other.world.effects[0].parameters["gap_m"]
    )


def test_a_release_has_no_input_and_loses_its_energy(released, tmp_path):
    case = released[0]
    folder = write_case(case, tmp_path)
    assert "inputs: []" in (folder / "model.yaml").read_text()
    listing = json.loads((folder / "case.json").read_text())
    assert len(listing["records"]) == 3
    for taken in case.taken:
        assert not taken.inputs
        size = np.abs(taken.clean).max(axis=1)
        quarter = len(size) // 4
        assert size[-quarter:].max() < 0.8 * size[:quarter].max()
    assert case.truth["effect_to_noise_db"] >= 10


def test_an_imposed_case_tells_displacement_and_force_alone(tmp_path):
    case = build("000000bd", draw_design("coulomb", "imposed", 12), 4)
    text = (write_case(case, tmp_path) / "model.yaml").read_text()
    assert "kind: force, node: m1" in text
    taken = case.taken[0]
    assert list(taken.inputs) == ["f1"]
    spring = case.world.rig.elements[0].stiffness * taken.clean[:, 0]
    friction = case.world.effects[0].parameters["friction_n"]
    left = taken.inputs["f1"] - spring
    assert np.median(np.abs(left)) == pytest.approx(friction, rel=0.5)


def test_the_force_of_a_yielding_spring_is_that_of_another_integrator():
    p = {"kh_n_per_m": 800.0, "zy_m": 1e-3, "n": 2.0}
    times = np.arange(3000) / 500.0
    motion = Signal.through(2e-3 * np.sin(2 * np.pi * np.arange(3600) / 500.0), 500.0)

    def rate(t, state):
        v = 2e-3 * 2 * np.pi * np.cos(2 * np.pi * t)
        same = 1.0 if v * state[0] > 0 else 0.0
        return [v * (1 - np.abs(state[0] / p["zy_m"]) ** 2 * same)]

    found = solve_ivp(
        rate, (0, 6), [0.0], "DOP853", times, rtol=1e-9, atol=1e-12, max_step=1e-3
    )
    wanted = p["kh_n_per_m"] * (found.y[0] - 2e-3 * np.sin(2 * np.pi * times))
    force = law_force(Placed(LAWS["bouc_wen"], "j0", p), motion, times)
    np.testing.assert_allclose(force, wanted, rtol=0, atol=1e-4 * np.abs(wanted).max())
