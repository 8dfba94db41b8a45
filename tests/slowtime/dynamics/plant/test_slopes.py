"""Slopes of outputs are what differences of runs are."""

import numpy as np
import pytest

from slowtime.dynamics.plant import simulation_run

RATE = 200.0
START = np.array([1e-3, -2e-3, 1.5e-3, 0.02, -0.03, 0.01])

ENTRIES = {
    "nothing": {},
    "cubic": {"effect": "cubic_hardening", "element": "k2", "k3_n_per_m3": 1e8},
    "saturation": {
        "effect": "saturating_stiffness",
        "element": "k1",
        "ks_n_per_m": 2000.0,
        "es_m": 2e-3,
    },
    "gap": {"effect": "gap_symmetric", "element": "k2", "kg_n_per_m": 900.0, "gap_m": 1e-3},
    "coulomb": {"effect": "coulomb", "element": "k2", "friction_n": 8.0},
    "stribeck": {
        "effect": "stribeck",
        "element": "k2",
        "friction_n": 2.0,
        "static_n": 3.5,
        "vs_m_per_s": 0.02,
    },
    "song": {"effect": "van_der_pol", "element": "k2", "cn_n_s_per_m": 4.0, "e0_m": 2e-3},
    "hysteresis": {
        "effect": "bouc_wen",
        "element": "k2",
        "kh_n_per_m": 2000.0,
        "zy_m": 1e-3,
        "n": 2.0,
    },
    "jump": {
        "effect": "stiffness_jump",
        "element": "k2",
        "dk_n_per_m": 900.0,
        "t_jump_s": 7.8123,
    },
    "pulsation": {
        "effect": "parametric",
        "element": "k2",
        "dk_n_per_m": 900.0,
        "frequency_hz": 5.0,
        "phase_rad": 0.3,
    },
    "tone": {
        "effect": "harmonic_force",
        "node": "m2",
        "amplitude_n": 3.0,
        "frequency_hz": 5.0,
        "phase_rad": 0.3,
    },
    "rider": {
        "effect": "extra_dof",
        "node": "m2",
        "mass_kg": 0.2,
        "frequency_hz": 6.0,
        "damping_n_s_per_m": 0.3,
    },
    "mass": {"effect": "added_mass", "node": "m2", "dm_kg": 0.2},
    "gain": {"effect": "input_gain", "input": "u", "gain": 0.9},
    "lift": {"effect": "input_bias", "input": "u", "bias": 0.5},
    "delay": {"effect": "input_delay", "input": "u", "delay_s": 3.3e-3},
    "clipped": {"effect": "sensor_saturation", "sensor": "a_m1", "clip": 0.8},
    "clock": {"effect": "sensor_clock", "sensor": "a_m1", "skew": 2.3e-3},
    "drift": {"effect": "sensor_drift", "sensor": "a_m1", "drift_total": 0.1},
}


def differences(plant, forces, values, state, direction, size):
    """Slope of the outputs along a direction of (values, state), by central differences."""
    step = size * direction
    ends = [
        plant.simulate(
            values + sign * step[: len(values)],
            forces,
            RATE,
            state0=state + sign * step[len(values) :],
            start_s=7.0,
        )
        for sign in (1.0, -1.0)
    ]
    return (ends[0] - ends[1]) / (2 * size)


@pytest.mark.parametrize("name", ENTRIES)
def test_slopes_are_differences(rig, push, monkeypatch, name):
    # Where steps are halved hangs on the parameters, and moves the motion by its own error.
    monkeypatch.setattr(simulation_run, "TOLERANCE", 1e9)
    check(rig, push, name, size=1e-6 if name == "jump" else 1e-5, error=1e-4)


@pytest.mark.parametrize("name", ["gap", "saturation"])
def test_slopes_are_differences_of_runs_that_choose_their_steps(rig, push, name):
    check(rig, push, name, size=1e-3, error=3e-2)


def check(rig, push, name, *, size, error):
    plant = rig(*([ENTRIES[name]] if ENTRIES[name] else []))
    forces, values = push(300), plant.values
    free = [key for key in plant.parameters if plant.entries[key].fitted]
    state = np.zeros(len(plant.state_names))
    moving = [i for i, key in enumerate(plant.state_names) if key[1] in ("m1", "m2", "m3")]
    state[moving] = START
    outputs, slopes = plant.sensitivities(values, forces, RATE, free, state0=state, start_s=7.0)
    np.testing.assert_array_equal(
        outputs, plant.simulate(values, forces, RATE, state0=state, start_s=7.0)
    )
    assert slopes.shape == (300, 9, len(free) + len(state))
    for column, key in enumerate([*free, *plant.state_names]):
        direction = np.zeros(len(values) + len(state))
        if key in plant.entries:
            at = plant.parameters.index(key)
            direction[at] = abs(values[at]) or 1.0
        else:
            direction[len(values) + plant.state_names.index(key)] = (
                1e-3 if key[0] == "displacement" else 0.02
            )
        scale = np.abs(direction).max()
        truth = differences(plant, forces, values, state, direction, size)
        missed = np.sqrt(np.mean((scale * slopes[:, :, column] - truth) ** 2, axis=0))
        allowed = error * np.sqrt(np.mean(truth**2, axis=0))
        # Next to nothing may come of a number, as of a memory at its start.
        assert (missed <= allowed + 1e-9 * np.abs(outputs).max(axis=0)).all(), key


def test_slopes_to_what_is_chosen_are_refused(rig, push):
    plant = rig(ENTRIES["drift"])
    with pytest.raises(ValueError, match=r"'span_s'\) is chosen, not estimated"):
        plant.sensitivities(plant.values, push(40), RATE, [("effect", 0, "span_s")])
    with pytest.raises(ValueError, match=r"No parameter is called \('mass', 'm9'\)"):
        plant.sensitivities(plant.values, push(40), RATE, [("mass", "m9")])


def test_sensitivities_of_a_start_alone_want_no_parameter(rig, push):
    plant = rig(ENTRIES["coulomb"])
    _, slopes = plant.sensitivities(plant.values, push(40), RATE, [])
    assert slopes.shape == (40, 9, 6)
