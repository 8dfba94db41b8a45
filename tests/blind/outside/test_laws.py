"""Laws that are in no list, against energies and operators in closed form."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from slowtime.dynamics.effects import catalogue
from tests.blind.draws import draft
from tests.blind.equations import System
from tests.blind.excitations.imposed import law_force
from tests.blind.law import Placed
from tests.blind.laws import LAWS, UNLISTED
from tests.blind.motion import move
from tests.blind.outside.draws import OUTSIDE_DRAWERS
from tests.blind.outside.families import FAMILIES, REASONS
from tests.blind.outside.operators import (
    play_rate,
    rate_and_state,
    renewal_rate,
    stop_rate,
)
from tests.blind.rig import Element, Rig
from tests.blind.signals import Signal
from tests.blind.test_motion import HERE

MASS, STIFFNESS = 2.0, 3900.0
SINGLE = Rig((MASS,), (Element("j0", -1, 0, STIFFNESS, 0.0),))
SILENCE = Signal.through(np.zeros(4000), 400.0)
SIZE, OMEGA = 3e-3, 2 * np.pi


def of_kind(name, strength=1.0):
    law = LAWS[name]
    parameters = draft(name, np.random.default_rng(5), HERE).at(strength)
    return Placed(law, {"element": "j0", "node": "m1"}[law.where], parameters)


def cycles(count=3):
    """A sine of the elongation, `count` seconds long."""
    times = np.arange(count * 4000 + 400) / 4000.0
    return Signal.through(SIZE * np.sin(OMEGA * times), 4000.0)


def loss_of_last_cycle(placed, count=3):
    """Work that a law takes over the last of some cycles."""
    times = np.linspace(count - 1, count, 8001)
    grid = np.concatenate([np.linspace(0, count - 1, 2001)[:-1], times])
    force = law_force(placed, cycles(count), grid)[-8001:]
    return float(np.trapezoid(force * SIZE * OMEGA * np.cos(OMEGA * times), times))


POTENTIALS = {
    "power_stiffness": lambda p, e: p["kp"] * np.abs(e) ** 2.5 / 2.5,
    "exponential_spring": lambda p, e: (
        p["force_n"] * (p["e0_m"] * np.expm1(e / p["e0_m"]) - e - e**2 / (2 * p["e0_m"]))
    ),
    "cusp": lambda p, e: p["force_n"] * np.abs(e) ** 1.5 / p["e0_m"] ** 0.5 / 1.5,
    "sine_squared": lambda p, e: (
        p["force_n"]
        * (e / 2 - p["length_m"] / (4 * np.pi) * np.sin(2 * np.pi * e / p["length_m"]))
    ),
    "cogging": lambda p, e: (
        -p["force_n"] * p["length_m"] / (2 * np.pi) * np.cos(2 * np.pi * e / p["length_m"])
    ),
    "magnet": lambda p, e: p["km"] * p["h_m"] ** 2 / 3 * (1 + (e / p["h_m"]) ** 2) ** -1.5,
    "shallow_truss": lambda p, e: (
        p["kt"] * (e**2 / 2 - p["rest_m"] * np.sqrt(e**2 + p["height_m"] ** 2))
    ),
    "slack_cable": lambda p, e: -p["ks"] * np.maximum(e - p["slack_m"], 0.0) ** 2 / 2,
}


@pytest.mark.parametrize("name", POTENTIALS)
def test_a_spring_gives_back_what_it_stored(name):
    placed = of_kind(name, 0.3)
    times = np.arange(300) / 400.0
    system = System(SINGLE, (placed,), {0: SILENCE}, ())
    moved = move(system, times, [SIZE, 0.1], scale=(SIZE, 0.1))
    e, v = moved.displacement[:, 0], moved.velocity[:, 0]
    stored = POTENTIALS[name](placed.parameters, e)
    energy = (MASS * v**2 + STIFFNESS * e**2) / 2 + stored
    assert np.ptp(stored) > 1e-3 * energy.max()
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=3e-4 * np.ptp(stored))


LOSSES = {
    "amplitude_damping": lambda p: p["ca"] * SIZE**3 * OMEGA * 4 / 3,
    "one_sided_damping": lambda p: p["ca"] * np.pi * SIZE**2 * OMEGA / 2,
    "direction_damping": lambda p: 0.0,
    "asymmetric_friction": lambda p: 4 * p["friction_n"] * SIZE,
    "wedge_friction": lambda p: 2 * p["mu"] * SIZE**2,
    "eddy_brake": lambda p: (
        _over_a_cycle(lambda v: 2 * v / p["v0"] / (1 + (v / p["v0"]) ** 2)) * p["force_n"]
    ),
    "shear_thinning": lambda p: _over_a_cycle(lambda v: p["ca"] * v / (1 + abs(v) / p["v0"])),
    "relief_damper": lambda p: _over_a_cycle(
        lambda v: p["ca"] * np.sign(v) * (min(abs(v), p["v0"]) + 0.1 * max(abs(v) - p["v0"], 0))
    ),
    "prandtl_ishlinskii": lambda p: sum(
        4 * p["kh_n_per_m"] / 5 * y * max(SIZE - y, 0.0)
        for name, y in p.items()
        if name.startswith("y")
    ),
    "self_centring": lambda p: 4 * p["kd_n_per_m"] * p["y_m"] * max(SIZE - p["y_m"], 0.0),
    "preisach": lambda p: sum(_of_a_play(p, i) for i in range(4)),
}


def _over_a_cycle(force):
    speeds = SIZE * OMEGA
    loss = quad(lambda a: force(speeds * np.cos(a)) * np.cos(a), 0, np.pi / 2, limit=200)[0]
    return 4 * speeds * loss / OMEGA


def _of_a_play(p, i):
    """A play that follows by its reach, its force taken off: it softens, and takes work."""
    reach, level = p[f"y{i}_m"], p[f"s{i}_m"]
    end = max(SIZE - reach, 0.0)
    forward = quad(lambda h: np.tanh(h / level), -end, end)[0]
    held = 4 * reach * np.tanh(end / level) if end else 0.0
    return p["force_n"] / 4 * (held + 2 * forward)


@pytest.mark.parametrize("name", LOSSES)
def test_a_cycle_costs_what_its_loop_encloses(name):
    placed = of_kind(name)
    wanted = LOSSES[name](placed.parameters)
    scale = 4 * SIZE * np.abs(law_force(placed, cycles(), np.linspace(1, 2, 200))).max()
    # An operator that is rounded loses the corners of its loop.
    assert loss_of_last_cycle(placed) == pytest.approx(wanted, abs=0.02 * scale)


@pytest.mark.parametrize("name", ["nonlinear_absorber", "rolling_body"])
def test_a_hidden_body_and_its_rig_keep_their_energy(name):
    placed = of_kind(name, 3.0)
    p = placed.parameters | {"c": 0.0}
    placed = Placed(placed.law, placed.place, p)
    system = System(SINGLE, (placed,), {0: SILENCE}, ())
    times = np.arange(400) / 400.0
    moved = move(system, times, [SIZE, 0.0, 0.0, 0.0], scale=(SIZE, 0.1))
    v, (y, u) = moved.velocity[:, 0], moved.inner.T
    turning = 0.5 if name == "rolling_body" else 0.0
    kinetic = MASS * v**2 + p["mass_kg"] * ((v + u) ** 2 + turning * u**2)
    stored = STIFFNESS * moved.displacement[:, 0] ** 2 / 2 + (
        p["k3"] * y**4 / 4
        if name == "nonlinear_absorber"
        else p["k"] * p["track_m"] ** 2 * np.sqrt(1 + (y / p["track_m"]) ** 2)
        - p["k"] * p["track_m"] ** 2
    )
    energy = kinetic / 2 + stored
    assert np.abs(y).max() > 0.1 * SIZE
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_friction_by_direction_takes_unequal_parts_of_every_half_swing():
    share, friction = 0.6, 0.5
    law = Placed(LAWS["asymmetric_friction"], "j0", {"friction_n": friction, "share": share})
    system = System(SINGLE, (law,), {0: SILENCE}, ())
    half = np.pi / np.sqrt(STIFFNESS / MASS)
    first = 12.0 * friction / STIFFNESS
    moved = move(system, half * np.arange(4), [first, 0.0], scale=(first, 0.1))
    back, forth = (2 * friction * (1 + sign * share) / STIFFNESS for sign in (-1, 1))
    swings = first - np.array([0.0, back, back + forth, 2 * back + forth])
    np.testing.assert_allclose(
        moved.displacement[:, 0], swings * [1, -1, 1, -1], rtol=0, atol=1e-6 * first
    )


def test_a_stop_and_a_play_of_one_reach_share_the_elongation():
    def rates(t, state):
        e, v = 2.3 * np.sin(t) * np.sin(0.37 * t), 0.0
        v = 2.3 * (np.cos(t) * np.sin(0.37 * t) + 0.37 * np.sin(t) * np.cos(0.37 * t))
        return [stop_rate(v, state[0], 0.7), play_rate(e, v, state[1], 0.7)]

    times = np.linspace(0, 30, 600)
    found = solve_ivp(
        rates, (0, 30), [0, 0], t_eval=times, rtol=1e-8, atol=1e-10, max_step=0.01
    )
    stop, play = found.y
    np.testing.assert_allclose(
        stop + play, 2.3 * np.sin(times) * np.sin(0.37 * times), atol=1e-6
    )
    assert 0.68 < np.abs(stop).max() <= 0.7 + 1e-6


@pytest.mark.parametrize("speed", [3e-4, 1e-2])
def test_friction_with_age_settles_at_its_logarithm_of_speed(speed):
    p = (0.6, 0.04, 0.07, 1e-3, 2e-4)

    def ageing(t, h):
        return [renewal_rate(speed, float(h[0]), p)]

    aged = solve_ivp(ageing, (0, 20 * p[4] / speed), [0.0], "LSODA", rtol=1e-9, atol=1e-12)
    settled = rate_and_state(speed, float(aged.y[0, -1]), p)
    assert settled == pytest.approx(0.6 + (0.04 - 0.07) * np.log(speed / p[3]), rel=1e-4)


def test_a_peak_is_kept_and_softens_for_good():
    placed = of_kind("softening_by_peak")
    p = placed.parameters
    force = law_force(placed, cycles(2), np.array([0.0, 0.25, 1.0 + 1 / 12, 1.25]))
    softened = p["dk_n_per_m"] * (1 - np.exp(-SIZE / p["peak_m"]))
    assert force[1:] == pytest.approx(-softened * SIZE * np.array([1, 0.5, 1]), rel=0.05)


def test_every_name_that_a_report_may_give_has_a_family():
    assert set(FAMILIES) == set(catalogue())


def test_every_law_that_is_in_no_list_has_numbers_kin_and_a_reason():
    assert set(UNLISTED) == set(OUTSIDE_DRAWERS) == set(REASONS)
    assert not set(UNLISTED) & set(catalogue())
    for name in UNLISTED:
        assert set(LAWS[name].kin) <= set(FAMILIES.values())
        assert LAWS[name].kin
