"""A user's own effect: one file, and it takes part like any other."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Motion, force_along
from slowtime.dynamics.plant import Plant
from slowtime_services.models import read_description, write_model
from slowtime_services.plugins.effect_kinds import EffectFileError, known, load

MAXWELL = '''
"""A spring and a damper in a row, beside the element."""

from slowtime.dynamics.effects import Kind, Law, Parameter


def force(e, v, t, z, p):
    return z[0]


def rate(e, v, t, z, p):
    return p[0] * (v - z[0] / p[1])


KIND = Kind(
    name="maxwell_branch",
    family="viscoelasticity",
    where="element",
    parameters=(
        Parameter(name="k_n_per_m", unit="N/m", meaning="its stiffness", low=0.0),
        Parameter(name="c_n_s_per_m", unit="N s/m", meaning="its damping", low=1e-9),
    ),
    equation="z, dz/dt = k (v - z/c)",
    source="Maxwell 1867",
    sentence="The element relaxes: it is stiffer in fast motion than in slow.",
    action=Law(force=force, rates=(rate,)),
    strength="k_n_per_m",
    scales=("c_n_s_per_m",),
)
'''
ENTRY = {"effect": "maxwell_branch", "element": "k1", "k_n_per_m": 300.0, "c_n_s_per_m": 20.0}
RATE = 100.0
PUSH = np.random.default_rng(1).standard_normal(200)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "maxwell.py"
    path.write_text(MAXWELL)
    return path


def test_an_effect_of_ones_own_is_read_run_and_differentiated(file, tmp_path):
    kinds = known([file])
    one = dataclasses.replace(
        chain([2.0], [400.0], dampings_n_s_per_m=[1.0]),
        inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
        effects=(ENTRY,),
    )
    write_model(tmp_path / "model.yaml", one)
    plant = Plant.of(
        read_description(tmp_path / "model.yaml", kinds), kinds=kinds, hold="first"
    )
    found, slopes = plant.sensitivities(plant.values, PUSH[:, None], RATE, plant.parameters)
    times = np.arange(200) / RATE

    def motion(t, state):
        q, v, z = state
        pushed = np.interp(t, times, PUSH) - 400.0 * q - 1.0 * v - z
        return [v, pushed / 2.0, 300.0 * (v - z / 20.0)]

    truth = solve_ivp(
        motion, (0, times[-1]), np.zeros(3), t_eval=times, rtol=1e-9, atol=1e-12, max_step=0.01
    ).y[0]
    np.testing.assert_allclose(found[:, 0], truth, atol=1e-6 * np.abs(truth).max())
    k = plant.parameters.index(("effect", 0, "c_n_s_per_m"))
    ends = [plant.values.copy() for _ in range(2)]
    ends[0][k], ends[1][k] = 20.01, 19.99
    high, low = (plant.simulate(values, PUSH[:, None], RATE)[:, 0] for values in ends)
    np.testing.assert_allclose(slopes[:, 0, k], (high - low) / 0.02, atol=1e-8)


def test_an_effect_of_ones_own_has_a_force_along_a_motion(file):
    kind = load(file)[0]
    times = np.arange(400) / RATE
    v = np.cos(5.0 * times)
    seen = Motion(e=np.sin(5.0 * times) / 5, v=v, a=-5 * np.sin(5.0 * times), times=times)
    found = force_along(kind, {"k_n_per_m": 300.0, "c_n_s_per_m": 20.0}, seen)
    # In steady state: k i w / (i w + k / c) times the elongation.
    ratio = 300.0 * 5j / (5j + 15.0)
    truth = (ratio * np.exp(5j * times)).imag / 5
    np.testing.assert_allclose(found[200:], truth[200:], atol=1e-4 * np.abs(truth).max())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = 1", r"own\.py holds no kind of effect\. Put `KIND = Kind"),
        ("1 / 0", r"own\.py fails: ZeroDivisionError"),
        ("def", r"own\.py fails: SyntaxError"),
        (MAXWELL.replace("return z[0]", "return {}[e]"), r"own\.py: The law 'force' cannot be"),
        (MAXWELL.replace("maxwell_branch", "coulomb"), r"called 'coulomb' already\. Rename"),
        (MAXWELL.replace('strength="k_n_per_m"', 'strength="k"'), r"fails: .*speaks of k"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(tmp_path, text, says):
    path = tmp_path / "own.py"
    path.write_text(text)
    with pytest.raises(EffectFileError, match=says):
        known([path])


def test_what_is_no_python_file_is_refused(tmp_path):
    with pytest.raises(EffectFileError, match=r"model\.yaml is not a Python file"):
        load(tmp_path / "model.yaml")
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "nowhere.py")
