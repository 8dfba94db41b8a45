"""Every kind of the list: its force along a known motion is its equation."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.dynamics.effects import (
    Friction,
    Hidden,
    Kind,
    Law,
    Motion,
    Parameter,
    SensorChange,
    catalogue,
    force_along,
    simple_kinds,
)

RATE = 400.0
T = np.arange(2000) / RATE
E = 2e-3 * np.sin(7.0 * T) + 1e-3 * np.cos(19.0 * T)
V = 14e-3 * np.cos(7.0 * T) - 19e-3 * np.sin(19.0 * T)
A = -98e-3 * np.sin(7.0 * T) - 361e-3 * np.cos(19.0 * T)
SEEN = Motion(e=E, v=V, a=A, times=T)

FORCES = {
    "cubic_hardening": ({"k3_n_per_m3": 3e7}, 3e7 * E**3),
    "cubic_softening": ({"k3_n_per_m3": -3e7}, -3e7 * E**3),
    "quadratic_stiffness": ({"k2_n_per_m2": -5e4}, -5e4 * E**2),
    "saturating_stiffness": (
        {"ks_n_per_m": 900.0, "es_m": 1e-3},
        900.0 * (1e-3 * np.tanh(E / 1e-3) - E),
    ),
    "gap_symmetric": (
        {"kg_n_per_m": 800.0, "gap_m": 1e-3},
        800.0 * (np.maximum(E - 1e-3, 0) + np.minimum(E + 1e-3, 0)),
    ),
    "gap_one_sided": (
        {"kg_n_per_m": 800.0, "gap_m": 1e-3, "side": -1.0},
        800.0 * np.minimum(E + 1e-3, 0),
    ),
    "coulomb": ({"friction_n": 4.0}, 4.0 * np.sign(V)),
    "stribeck": (
        {"friction_n": 4.0, "static_n": 6.0, "vs_m_per_s": 0.01},
        (4.0 + 2.0 * np.exp(-((V / 0.01) ** 2))) * np.sign(V),
    ),
    "quadratic_damping": ({"c2_n_s2_per_m2": 50.0}, 50.0 * np.abs(V) * V),
    "viscous_damping": ({"dc_n_s_per_m": 3.0}, 3.0 * V),
    "van_der_pol": (
        {"cn_n_s_per_m": 3.0, "e0_m": 1e-3},
        3.0 * (-1 + (E / 1e-3) ** 2) * V,
    ),
    "stiffness_loss": ({"dk_n_per_m": 70.0}, -70.0 * E),
    "missing_spring": ({"k_n_per_m": 70.0}, 70.0 * E),
    "missing_damper": ({"c_n_s_per_m": 3.0}, 3.0 * V),
    "added_mass": ({"dm_kg": 0.3}, -0.3 * A),
    "mass_jump": ({"dm_kg": 0.3, "t_jump_s": 2.0}, -0.3 * A * (T >= 2.0)),
    "mass_drift": ({"dm_kg": 0.3}, -0.3 * A * T / T[-1]),
    "stiffness_jump": ({"dk_n_per_m": 70.0, "t_jump_s": 2.0}, -70.0 * E * (T >= 2.0)),
    "stiffness_drift": ({"dk_n_per_m": 70.0}, -70.0 * E * T / T[-1]),
    "parametric": (
        {"dk_n_per_m": 70.0, "frequency_hz": 3.0, "phase_rad": 0.4},
        70.0 * np.cos(6 * np.pi * T + 0.4) * E,
    ),
    "pendulum_sine": ({"k": 5e6}, 5e6 * (np.sin(E) - E)),
    "harmonic_force": (
        {"amplitude_n": 2.0, "frequency_hz": 3.0, "phase_rad": 0.4},
        2.0 * np.sin(6 * np.pi * T + 0.4),
    ),
}
NO_FORCE = {
    "base_motion": ("base", "random input", ("rms_m_per_s2",)),
    "input_gain": ("input", "input", ("gain",)),
    "input_delay": ("input", "input", ("delay_s",)),
    "input_bias": ("input", "input", ("bias",)),
    "sensor_bias": ("sensor", "sensor", ("bias",)),
    "sensor_drift": ("sensor", "sensor", ("drift_total",)),
    "sensor_gain": ("sensor", "sensor", ("gain",)),
    "sensor_saturation": ("sensor", "sensor", ("clip",)),
    "sensor_dropout": ("sensor", "sensor", ()),
    "sensor_clock": ("sensor", "sensor", ("skew",)),
    "sensor_delay": ("sensor", "sensor", ("delay_s",)),
    "sensor_misplaced": ("sensor", "sensor", ("node_number",)),
    "gyroscopic_coupling": ("element", "gyroscopic coupling", ("g_n_s_per_m",)),
}
MEMORY = {
    "bouc_wen": ("element", "hysteresis", ("kh_n_per_m", "zy_m", "n")),
    "extra_dof": (
        "node",
        "extra degree of freedom",
        ("mass_kg", "frequency_hz", "damping_n_s_per_m"),
    ),
}


def test_the_catalogue_holds_the_list_and_says_of_each_what_it_is():
    kinds = catalogue()
    simple = {kind.name for kind in simple_kinds(kinds)}
    assert simple == {*FORCES, *NO_FORCE, *MEMORY}
    for name, kind in kinds.items():
        assert kind.name == name
        assert kind.equation
        assert kind.sentence.endswith(".")
    for name, (where, family, parameters) in (NO_FORCE | MEMORY).items():
        kind = kinds[name]
        needed = tuple(p.name for p in kind.parameters if p.default is None)
        assert (kind.where, kind.family, needed) == (where, family, parameters)


@pytest.mark.parametrize("name", FORCES)
def test_the_force_along_a_motion_is_the_equation(name):
    parameters, truth = FORCES[name]
    found = force_along(catalogue()[name], parameters, SEEN)
    np.testing.assert_allclose(found, truth, rtol=1e-9, atol=1e-12 * np.abs(truth).max())


@pytest.mark.parametrize("name", FORCES)
def test_a_force_grows_with_its_strength(name):
    kind, (parameters, truth) = catalogue()[name], FORCES[name]
    grown = {
        key: value * (3.0 if key in (kind.strength, *kind.scales) else 1.0)
        for key, value in parameters.items()
    }
    np.testing.assert_allclose(
        force_along(kind, grown, SEEN), 3.0 * truth, rtol=1e-9, atol=1e-12
    )


def test_hysteresis_remembers_by_its_differential_equation():
    parameters = {"kh_n_per_m": 900.0, "zy_m": 1e-3, "n": 1.5}

    def rate(t, z):
        v = 14e-3 * np.cos(7.0 * t) - 19e-3 * np.sin(19.0 * t)
        return v * (1 - np.abs(z / 1e-3) ** 1.5 * (1 + np.sign(v * z)) / 2)

    z = solve_ivp(rate, (0, T[-1]), [0.0], t_eval=T, rtol=1e-9, atol=1e-12, max_step=1e-3).y[0]
    found = force_along(catalogue()["bouc_wen"], parameters, SEEN)
    np.testing.assert_allclose(found, 900.0 * (z - E), atol=2e-4)


def test_a_hidden_mass_pushes_its_node_by_its_own_motion():
    parameters = {"mass_kg": 0.2, "frequency_hz": 4.0, "damping_n_s_per_m": 0.3}
    k = 0.2 * (8 * np.pi) ** 2

    def motion(t, state):
        a = -98e-3 * np.sin(7.0 * t) - 361e-3 * np.cos(19.0 * t)
        return [state[1], -a - (k * state[0] + 0.3 * state[1]) / 0.2]

    r, speed = solve_ivp(motion, (0, T[-1]), [0.0, 0.0], t_eval=T, rtol=1e-10, atol=1e-13).y
    found = force_along(catalogue()["extra_dof"], parameters, SEEN)
    truth = k * r + 0.3 * speed
    np.testing.assert_allclose(found, truth, atol=1e-3 * np.abs(truth).max())


def test_any_phase_is_a_sum_of_two():
    kind = catalogue()["parametric"]
    assert kind.quadrature == "phase_rad"
    one = {"dk_n_per_m": 1.0, "frequency_hz": 3.0}
    cosine, sine, mixed = (
        force_along(kind, one | {"phase_rad": phase}, SEEN) for phase in (0.0, np.pi / 2, 0.7)
    )
    np.testing.assert_allclose(mixed, np.cos(0.7) * cosine + np.sin(0.7) * sine, atol=1e-12)


def test_shapes_are_allowed_and_make_a_force():
    rng = np.random.default_rng(3)
    shaken = dataclasses.replace(SEEN, e=E + 1e-5 * rng.standard_normal(len(T)))
    for kind in catalogue().values():
        if kind.is_surface:
            continue
        shapes = kind.shapes(shaken)
        assert shapes
        for shape in shapes:
            faults = [kind.parameter(name).refuses(value) for name, value in shape.items()]
            assert not any(faults)
        if kind.where in ("element", "node") and not kind.is_coupling:
            missing = {p.name for p in kind.parameters if p.default is None} - set(shapes[-1])
            assert missing <= {kind.strength}
            sign = -1.0 if kind.name == "cubic_softening" else 1.0
            found = force_along(kind, {str(kind.strength): sign} | dict(shapes[-1]), shaken)
            assert np.isfinite(found).all()
            assert found.any()


def test_a_fit_of_general_hysteresis_starts_at_loops_of_every_kind():
    """They dissipate, and level off or stiffen; gamma outweighs beta with either sign."""
    shapes = catalogue()["bouc_wen_general"].shapes(SEEN)
    beta, gamma = (
        np.array([shape[name] for shape in shapes]) for name in ("beta_per_mn", "gamma_per_mn")
    )
    assert (beta > 0).all()
    for sign in (-1, 1):
        assert (sign * (beta + gamma) > 0).any()
        assert (sign * (beta - gamma) > 0).any()
        assert (sign * gamma >= 2 * beta).any()
    assert (gamma == 0).any()


def test_what_is_no_force_says_so():
    with pytest.raises(ValueError, match=r"sensor_bias sits on the sensor: it is no force"):
        force_along(catalogue()["sensor_bias"], {"bias": 1.0}, SEEN)
    with pytest.raises(ValueError, match=r"coulomb needs friction_n; missing: friction_n"):
        force_along(catalogue()["coulomb"], {}, SEEN)


def uncompilable(e, v, t, z, p):
    return {}[e]


def test_a_law_that_cannot_be_compiled_says_how_to_write_it():
    kind = dataclasses.replace(
        catalogue()["cubic_hardening"], name="odd", action=Law(force=uncompilable)
    )
    with pytest.raises(ValueError, match=r"'uncompilable' cannot be compiled.*Write it with"):
        force_along(kind, {"k3_n_per_m3": 1.0}, SEEN)


def test_a_kind_that_contradicts_itself_is_refused():
    settings: dict[str, Any] = {
        "name": "own",
        "family": "own",
        "where": "element",
        "parameters": (Parameter(name="a", unit="", meaning="one"),),
        "equation": "a e",
        "source": "",
        "sentence": "It is.",
        "action": Law(force=uncompilable),
    }
    with pytest.raises(ValueError, match=r"speaks of b; its parameters are: a"):
        Kind(**settings | {"strength": "b"})
    with pytest.raises(ValueError, match=r"a SensorChange cannot sit on 'element'"):
        Kind(**settings | {"action": SensorChange(act=lambda series, times, p: series)})
    with pytest.raises(ValueError, match=r"a Friction cannot sit on 'node'"):
        Kind(**settings | {"where": "node", "action": Friction(limit=uncompilable)})
    with pytest.raises(ValueError, match=r"hidden coordinates ride on nodes"):
        Kind(**settings | {"action": Hidden(matrices=lambda p: (p, p, p), coordinates=1)})
    taken = Kind(**settings | {"name": "coulomb"})
    with pytest.raises(ValueError, match=r"called 'coulomb' already\. Rename your own"):
        catalogue([taken])


@pytest.mark.parametrize(
    ("static_n", "vs_m_per_s", "is_shown"),
    [(1.5, 0.2, True), (1.5, 0.9, False), (1.05, 0.2, False), (0.8, 0.2, False)],
)
def test_friction_that_has_not_been_seen_to_fall_is_no_stribeck_curve(
    static_n, vs_m_per_s, is_shown
):
    times = np.linspace(0.0, 10.0, 2001)
    motion = Motion(e=np.sin(times), v=np.cos(times), a=-np.sin(times), times=times)
    numbers = {"friction_n": 1.0, "static_n": static_n, "vs_m_per_s": vs_m_per_s}
    assert catalogue()["stribeck"].shown(numbers, motion) is is_shown


@pytest.mark.parametrize(("share", "is_shown"), [(0.01, False), (0.05, True), (2.0, True)])
def test_a_spring_that_levelled_off_long_before_is_a_softer_one(share, is_shown):
    times = np.linspace(0.0, 10.0, 2001)
    motion = Motion(e=np.sin(times), v=np.cos(times), a=-np.sin(times), times=times)
    numbers = {"ks_n_per_m": 5.0, "es_m": share}
    assert catalogue()["saturating_stiffness"].shown(numbers, motion) is is_shown


@pytest.mark.parametrize(("ratio", "is_shown"), [(0.0, True), (0.29, True), (0.31, False)])
def test_what_dies_within_a_period_is_no_hidden_oscillator(ratio, is_shown):
    times = np.linspace(0.0, 10.0, 2001)
    motion = Motion(e=np.sin(times), v=np.cos(times), a=-np.sin(times), times=times)
    numbers = {
        "mass_kg": 0.2,
        "frequency_hz": 3.0,
        "damping_n_s_per_m": ratio * 2 * 0.2 * 2 * np.pi * 3.0,
    }
    assert catalogue()["extra_dof"].shown(numbers, motion) is is_shown
