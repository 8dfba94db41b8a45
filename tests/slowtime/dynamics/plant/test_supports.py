"""Supports that are moved, and measured forces: laws that hold whatever the numbers."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.interpolate import CubicSpline, make_interp_spline

from slowtime.dynamics.channels import InputKind
from slowtime.dynamics.description import (
    BASE,
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Support,
    assemble,
)
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.plant.imposed import driven_by
from slowtime.dynamics.plant.sensing import base_of
from slowtime.dynamics.units import Quantity

RATE = 200.0
T = np.arange(800) / RATE
CUBIC = {"effect": "cubic_hardening", "element": "k2", "k3_n_per_m3": 4e5}
RUB = {"effect": "coulomb", "element": "k1", "friction_n": 3.0}


def smooth(seed, samples=800, size=0.01):
    """Displacement [m] without power above a tenth of the sampling rate, not zero at first."""
    rng = np.random.default_rng(seed)
    lines = rng.standard_normal((12, 2)) / np.arange(1, 13)[:, None]
    phase = 2 * np.pi * np.arange(1, 13)[:, None] * np.arange(samples) / samples * 3
    return size * (lines[:, 0] @ np.cos(phase) + lines[:, 1] @ np.sin(phase))


def rested(*arguments, **named):
    """The same, begun and ended at rest: derivatives at ends know one side only."""
    moved = smooth(*arguments, **named)
    return moved * np.hanning(len(moved))


def pair(*effects, first="left", last="right", **changes):
    """Two masses between two supports."""
    supports = tuple(Support(id=name) for name in dict.fromkeys((first, last)) if name != BASE)
    return Description(
        name="pair",
        nodes=(Node(id="m1", mass_kg=2.0), Node(id="m2", mass_kg=1.5)),
        supports=supports,
        elements=(
            Spring(id="k1", between=(first, "m1"), stiffness_n_per_m=900.0,
                   damping_n_s_per_m=2.0),
            Spring(id="k2", between=("m1", "m2"), stiffness_n_per_m=700.0,
                   damping_n_s_per_m=1.0),
            Spring(id="k3", between=("m2", last), stiffness_n_per_m=800.0,
                   damping_n_s_per_m=3.0),
        ),
        effects=effects,
        **changes,
    )  # fmt: skip


def imposed(node, quantity="displacement", **changes):
    kinds: dict[str, tuple[InputKind, str]] = {
        "displacement": ("imposed_displacement", "m"),
        "velocity": ("imposed_velocity", "m/s"),
        "acceleration": ("imposed_acceleration", "m/s^2"),
    }
    kind, unit = kinds[quantity]
    return Input(
        channel=f"{quantity} of {node}", kind=kind, node=node, unit=unit, **changes,
    )  # fmt: skip


def motion_of(*nodes, frame="absolute", unit="m"):
    return tuple(
        Sensor(channel=f"x_{node}", quantity="displacement", node=node, unit=unit, frame=frame)
        for node in nodes
    )


def simulated(description, *inputs):
    plant = Plant.of(description)
    return plant.simulate(plant.values, np.stack(inputs, axis=1), RATE)


@pytest.mark.parametrize("effects", [(), (CUBIC,), (RUB,), (CUBIC, RUB)], ids=len)
def test_moving_all_supports_alike_is_moving_the_base(effects):
    moved = smooth(1)
    both = pair(
        *effects, inputs=(imposed("left"), imposed("right")), sensors=motion_of("m1", "m2")
    )
    based = pair(
        *effects, first=BASE, last=BASE, sensors=motion_of("m1", "m2"),
        inputs=(Input(channel="b", kind="base_displacement", unit="m"),),
    )  # fmt: skip
    np.testing.assert_allclose(
        simulated(both, moved, moved), simulated(based, moved[:]), atol=2e-9
    )


def test_a_base_may_be_moved_by_displacement_velocity_or_acceleration():
    moved = rested(2)
    velocity = make_interp_spline(T, moved, k=7).derivative()(T)
    acceleration = make_interp_spline(T, moved, k=7).derivative(2)(T)
    drives: tuple[tuple[InputKind, str, np.ndarray], ...] = (
        ("base_displacement", "m", moved),
        ("base_velocity", "m/s", velocity),
        ("base_acceleration", "m/s^2", acceleration),
    )
    seen = []
    for kind, unit, series in drives:
        rig = pair(
            first=BASE, last=BASE, inputs=(Input(channel="b", kind=kind, unit=unit),),
            sensors=motion_of("m1", "m2", frame="relative_to_base"),
        )  # fmt: skip
        seen.append(simulated(rig, series)[:-40])
    size = np.abs(seen[0]).max()
    np.testing.assert_allclose(seen[1], seen[0], atol=2e-5 * size)
    np.testing.assert_allclose(seen[2], seen[0], atol=1e-4 * size)


def test_linear_supports_superpose():
    left, right = smooth(3), smooth(4)
    rig = pair(inputs=(imposed("left"), imposed("right")), sensors=motion_of("m1", "m2"))
    np.testing.assert_allclose(
        simulated(rig, left, 0 * right) + simulated(rig, 0 * left, right),
        simulated(rig, left, right),
        atol=1e-12,
    )


def test_a_support_without_input_moves_with_the_base():
    acceleration = 20 * smooth(5)
    base = Input(channel="b", kind="base_acceleration", unit="m/s^2")
    rig = pair(inputs=(base,), sensors=motion_of("m1", "left"))
    held = pair(first=BASE, last=BASE, inputs=(base,), sensors=motion_of("m1", BASE))
    np.testing.assert_allclose(
        simulated(rig, acceleration), simulated(held, acceleration), atol=1e-13
    )


def test_a_support_held_in_space_is_left_behind_by_the_base():
    """Absolute coordinates by another road: the left end shakes, the right one stands."""
    left = smooth(6)
    moving = Input(channel="b", kind="base_displacement", unit="m")
    rig = pair(
        first=BASE, inputs=(moving, imposed("right")), sensors=motion_of("m1", "m2", "right")
    )
    other = pair(last=BASE, inputs=(imposed("left"),), sensors=motion_of("m1", "m2", BASE))
    plant = Plant.of(rig)
    start = np.zeros(4)
    start[:2] = -left[0]
    start[2:] = -make_interp_spline(T, left, k=5).derivative()(0.0)
    both = plant.simulate(plant.values, np.stack([left, 0 * left], axis=1), RATE, state0=start)
    plant = Plant.of(other)
    alone = plant.simulate(plant.values, left[:, None], RATE, state0=np.zeros(4))
    np.testing.assert_allclose(both, alone, atol=1e-9)


def test_a_nonlinear_joint_at_a_support_is_integrated_as_by_scipy():
    left = rested(7, size=0.02)
    hard = dict(CUBIC, element="k1")
    rig = pair(hard, inputs=(imposed("left"),), sensors=motion_of("m1", "m2"))
    spline = CubicSpline(T, left, bc_type="natural")
    speed = spline.derivative()
    mass, k, c = (2.0, 1.5), (900.0, 700.0, 800.0), (2.0, 1.0, 3.0)

    def rates(t, state):
        x1, x2, v1, v2 = state
        e, v = x1 - spline(t), v1 - speed(t)
        first = k[0] * e + c[0] * v + hard["k3_n_per_m3"] * e**3
        middle = k[1] * (x2 - x1) + c[1] * (v2 - v1)
        last = -k[2] * x2 - c[2] * v2
        return [v1, v2, (middle - first) / mass[0], (last - middle) / mass[1]]

    found = solve_ivp(
        rates, (0, T[-1]), np.zeros(4), t_eval=T, rtol=1e-10, atol=1e-12, max_step=1 / RATE
    ).y[:2].T  # fmt: skip
    plant = Plant.of(rig)
    seen = plant.simulate(plant.values, left[:, None], RATE, state0=np.zeros(4))
    np.testing.assert_allclose(seen, found, atol=2e-5 * np.abs(found).max())


FORCES = (
    *(Sensor(channel=f"f_{e}", quantity="force", element=e, unit="N") for e in ("k1", "k3")),
    *(Sensor(channel=f"r_{n}", quantity="force", node=n, unit="N") for n in ("left", "right")),
    *(Sensor(channel=f"a_{m}", quantity="acceleration", node=m, unit="m/s^2")
      for m in ("m1", "m2")),
)  # fmt: skip


@pytest.mark.parametrize("effects", [(), (CUBIC,), (RUB, dict(CUBIC, element="k3"))], ids=len)
def test_reactions_balance_inertia_and_are_the_forces_of_the_end_elements(effects):
    rig = pair(*effects, inputs=(imposed("left"), imposed("right")), sensors=FORCES)
    k1, k3, left, right, a1, a2 = simulated(rig, smooth(8), smooth(9)).T
    np.testing.assert_allclose(left + right, 2.0 * a1 + 1.5 * a2, atol=1e-9)
    np.testing.assert_allclose(left, -k1, atol=1e-12)
    np.testing.assert_allclose(right, k3, atol=1e-12)


def test_supports_do_the_work_that_is_stored_and_lost():
    """Energy balance of a linear pair: integral of reaction times velocity."""
    ends = ("left", "right", "m1", "m2")
    quantities: tuple[tuple[Quantity, str], ...] = (("displacement", "m"), ("velocity", "m/s"))
    moving = tuple(
        Sensor(channel=f"{q} {n}", quantity=q, node=n, unit=unit)
        for q, unit in quantities
        for n in ends
    )
    rig = pair(inputs=(imposed("left"), imposed("right")), sensors=(*FORCES[2:4], *moving))
    fine = rested(10, samples=4000), rested(11, samples=4000)
    plant = Plant.of(rig)
    told = plant.simulate(plant.values, np.stack(fine, axis=1), 5 * RATE)
    reaction, x, v = told[:, :2], told[:, 2:6], told[:, 6:]
    pairs = ((0, 2, 900.0, 2.0), (2, 3, 700.0, 1.0), (3, 1, 800.0, 3.0))
    stored = 0.5 * (2.0 * v[:, 2] ** 2 + 1.5 * v[:, 3] ** 2)
    lost = np.zeros(len(x))
    for i, j, k, c in pairs:
        stored += 0.5 * k * (x[:, j] - x[:, i]) ** 2
        lost += c * (v[:, j] - v[:, i]) ** 2
    power = (reaction * v[:, :2]).sum(axis=1)
    balance = simpson(power - lost, dx=1 / (5 * RATE))
    size = simpson(np.abs(power), dx=1 / (5 * RATE))
    assert stored[-1] - stored[0] == pytest.approx(balance, abs=1e-5 * size)


def test_a_driven_node_takes_the_force_of_mass_spring_damper_and_law():
    """An actuator moves the only mass: its force is known in closed form."""
    omega, size = 9.0, 0.02
    x = size * np.sin(omega * T)
    v, a = size * omega * np.cos(omega * T), -(omega**2) * x
    rig = Description(
        name="characterisation",
        nodes=(Node(id="m", mass_kg=0.7),),
        elements=(
            Spring(id="k2", between=(BASE, "m"), stiffness_n_per_m=300.0,
                   damping_n_s_per_m=4.0),
        ),
        effects=(CUBIC,),
        inputs=(Input(channel="x", kind="imposed_displacement", node="m", unit="m"),),
        sensors=(
            Sensor(channel="f", quantity="force", node="m", unit="N"),
            Sensor(channel="base", quantity="force", node=BASE, unit="kN"),
        ),
    )  # fmt: skip
    assert rig.dofs == ()
    force, base = simulated(rig, x).T
    inner = 300.0 * x + 4.0 * v + 4e5 * x**3
    middle = slice(40, -40)  # derivatives at the ends know one side only
    np.testing.assert_allclose(force[middle], (0.7 * a + inner)[middle], atol=2e-3)
    np.testing.assert_allclose(base[middle], -1e-3 * inner[middle], atol=2e-6)


GAIN = {"effect": "input_gain", "input": "displacement of left", "gain": 1.1}


@pytest.mark.parametrize("effects", [(), (CUBIC, GAIN), (dict(CUBIC, element="k1"),)], ids=len)
def test_slopes_are_differences(effects):
    rig = pair(
        *effects, inputs=(imposed("left"), imposed("right", "velocity")),
        sensors=(*FORCES, *motion_of("m1", "left")),
    )  # fmt: skip
    plant = Plant.of(rig)
    inputs = np.stack([smooth(12), 5 * smooth(13)], axis=1)
    free = [name for name in plant.parameters if plant.entries[name].fitted]
    start = np.array([0.003, -0.002, 0.1, 0.05])
    _, slopes = plant.sensitivities(plant.values, inputs, RATE, free, state0=start)
    assert slopes.shape[2] == len(free) + 4
    for column, name in enumerate(free):
        at = plant.parameters.index(name)
        step = np.zeros(len(plant.values))
        step[at] = 1e-5 * abs(plant.values[at])
        above, below = (
            plant.simulate(plant.values + sign * step, inputs, RATE, state0=start)
            for sign in (1, -1)
        )
        wanted = (above - below) / (2 * step[at])
        size = np.abs(wanted).max(axis=0) + 1e-30
        np.testing.assert_allclose(
            slopes[:, :, column] / size, wanted / size, atol=2e-4, err_msg=str(name)
        )


def test_a_gain_of_a_base_displacement_has_its_slope():
    gain = {"effect": "input_gain", "input": "b", "gain": 1.2}
    rig = pair(
        gain, first=BASE, last=BASE, sensors=motion_of("m1", BASE),
        inputs=(Input(channel="b", kind="base_displacement", unit="mm"),),
    )  # fmt: skip
    plant, moved = Plant.of(rig), 1e3 * smooth(14)[:, None]
    name = ("effect", 0, "gain")
    _, slopes = plant.sensitivities(plant.values, moved, RATE, [name], state0=np.zeros(4))
    step = np.where([one == name for one in plant.parameters], 1e-4, 0.0)
    above, below = (
        plant.simulate(plant.values + sign * step, moved, RATE, state0=np.zeros(4))
        for sign in (1, -1)
    )
    np.testing.assert_allclose(slopes[:, :, 0], (above - below) / 2e-4, atol=1e-8)
    np.testing.assert_allclose(slopes[:, 1, 0], 1e-3 * moved[:, 0], atol=1e-9)


def test_integrating_what_was_differentiated_gives_every_sample_back():
    """Noise and all: springs feel the displacement as it was measured."""
    rng = np.random.default_rng(0)
    noisy = smooth(15) + 0.005 * rng.standard_normal(len(T))
    rig = pair(inputs=(imposed("left"),), sensors=motion_of("left"))
    np.testing.assert_allclose(simulated(rig, noisy)[:, 0], noisy, atol=1e-9)
    based = pair(
        first=BASE, sensors=motion_of(BASE),
        inputs=(Input(channel="b", kind="base_displacement", unit="m"),),
    )  # fmt: skip
    np.testing.assert_allclose(simulated(based, noisy)[:, 0], noisy, atol=1e-9)


def test_noise_of_a_displacement_does_to_its_velocity_at_most_what_is_said():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(4000)
    found = driven_by(noise[:, None], ["band_limited"], [2], 1 / RATE)
    gained = found.coefficients[:, 0] @ (1 / RATE / np.arange(1, 5))
    velocity = found.start[1, 0] + np.cumsum(gained)
    rms = np.sqrt(np.mean(velocity[40:-40] ** 2))
    assert 0.6 < rms / (np.pi * RATE / np.sqrt(3)) < 1.0


def test_the_velocity_of_a_sine_is_as_good_as_is_said():
    for share in (0.05, 0.1, 0.25):
        omega = 2 * np.pi * share * RATE
        found = driven_by(np.sin(omega * T)[:, None], ["band_limited"], [2], 1 / RATE)
        gained = found.coefficients[:, 0] @ (1 / RATE / np.arange(1, 5))
        velocity = found.start[1, 0] + np.concatenate([[0], np.cumsum(gained)[:-1]])
        error = np.abs(velocity - omega * np.cos(omega * T))[100:-100].max() / omega
        assert error < 2 * (2 * np.pi * share) ** 6 / 5040


def test_supports_do_not_change_the_linear_structure():
    rig = pair(inputs=(imposed("left"),))
    held = pair(first=BASE, last=BASE)
    np.testing.assert_array_equal(assemble(rig).stiffness, assemble(held).stiffness)
    assert rig.dofs == held.dofs == ("m1", "m2")


def test_a_base_that_starts_in_motion_goes_on():
    along = np.zeros((50, 1, 1))
    x, v, a = base_of(along, 0.1, np.array([[2.0], [3.0]])).motion
    np.testing.assert_allclose(x[:, 0], 2.0 + 0.3 * np.arange(50))
    assert (v == 3.0).all()
    assert not a.any()


def test_where_supports_begin_displaced_the_structure_is_carried_along():
    """Nothing is thrown about: at constant displacements all stays in static equilibrium."""
    rig = pair(inputs=(imposed("left"), imposed("right")), sensors=motion_of("m1", "m2"))
    seen = simulated(rig, np.full(200, 0.01), np.full(200, -0.02))
    x = np.linalg.solve([[1600.0, -700.0], [-700.0, 1500.0]], [900 * 0.01, 800 * -0.02])
    np.testing.assert_allclose(seen, np.tile(x, (200, 1)), atol=1e-12)
    end = dataclasses.replace(rig, sensors=motion_of("left"))
    assert simulated(end, np.full(200, 0.01), np.full(200, 0.0))[0, 0] == 0.01


def test_friction_of_a_driven_damper_has_the_sign_of_its_velocity():
    """Nothing can stick where both ends are prescribed."""
    x = 0.02 * np.sin(9.0 * T)
    rig = Description(
        name="rubbing",
        nodes=(Node(id="m", mass_kg=0.7),),
        elements=(Spring(id="k1", between=(BASE, "m"), stiffness_n_per_m=300.0),),
        effects=(RUB,),
        inputs=(Input(channel="x", kind="imposed_displacement", node="m", unit="m"),),
        sensors=(
            Sensor(channel="f", quantity="force", element="k1", unit="kN"),
            Sensor(channel="base", quantity="force", node=BASE, unit="N"),
        ),
    )
    plant = Plant.of(rig)
    name = ("effect", 0, "friction_n")
    told, slopes = plant.sensitivities(plant.values, x[:, None], RATE, [name])
    wanted = 300.0 * x + 3.0 * np.sign(np.cos(9.0 * T))
    turning = np.abs(np.cos(9.0 * T)) < 1e-3
    np.testing.assert_allclose(told[~turning, 0], 1e-3 * wanted[~turning], atol=1e-9)
    np.testing.assert_allclose(told[~turning, 1], -wanted[~turning], atol=1e-9)
    np.testing.assert_allclose(
        slopes[~turning, 1, 0], -np.sign(np.cos(9.0 * T))[~turning], atol=1e-6
    )
