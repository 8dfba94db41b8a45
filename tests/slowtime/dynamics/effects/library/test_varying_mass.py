"""Masses that vary with time, against SciPy's integration of their equation of motion."""

import numpy as np
import pytest

from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring
from slowtime.dynamics.effects import Motion, catalogue, force_along
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.third_party_rigs.rigs import FINE, Excitation, Link, Structure, run

RATE_HZ, SAMPLES = 200.0, 800
LINKS = (Link("s1", (-1, 0), 6000.0, 4.0), Link("s2", (0, 1), 4000.0, 3.0))
AGREES = 2e-3
"""[1] Error over the motion: a cubic between points of the load, half a sample at a jump."""


def forced(more_mass, shaken=False):
    """Run the rig; return the input at the samples, and what accelerometers tell."""
    fine = np.arange((SAMPLES - 1) * FINE + 1) / (RATE_HZ * FINE)
    loads = np.zeros((len(fine), 2))
    tones = np.sum([np.sin(2 * np.pi * hz * fine + hz**2) for hz in range(2, 15)], axis=0)
    loads[:, 1] = 0.0 if shaken else tones
    given = Excitation(RATE_HZ, SAMPLES, loads, tones * shaken, np.zeros((2, 2)))
    told = run(Structure((3.0, 2.0), LINKS, more_mass=more_mass), given)
    return tones[::FINE, None], told["a"]


BASE_INPUT = Input(channel="u", kind="base_acceleration", unit="m/s^2", hold="band_limited")
FORCE_INPUT = Input(channel="u", kind="force", node="f2", unit="N", hold="band_limited")


def plant(effect, shaken=False):
    ends = {-1: "base", 0: "f1", 1: "f2"}
    return Plant.of(
        Description(
            name="rig",
            nodes=(Node(id="f1", mass_kg=3.0), Node(id="f2", mass_kg=2.0)),
            elements=tuple(
                Spring(
                    id=one.name,
                    between=(ends[one.between[0]], ends[one.between[1]]),
                    stiffness_n_per_m=one.stiffness,
                    damping_n_s_per_m=one.damping,
                )
                for one in LINKS
            ),
            inputs=(BASE_INPUT if shaken else FORCE_INPUT,),
            sensors=tuple(
                Sensor(channel=f"a{i}", quantity="acceleration", node=f"f{i}", unit="m/s^2")
                for i in (1, 2)
            ),
            effects=(effect,),
        )
    )


def falls(t):
    return t / 4.0


def jumps(t):
    return float(t >= 1.9975)


@pytest.mark.parametrize("more", [-0.3, 0.5])
@pytest.mark.parametrize(
    ("kind", "share", "shaken"),
    [
        ("mass_drift", falls, False),
        ("mass_drift", falls, True),
        ("mass_jump", jumps, False),
        ("mass_jump", jumps, True),
    ],
)
def test_the_motion_is_that_of_the_mass_in_the_equation(kind, share, more, shaken):
    u, truth = forced(lambda t: np.array([0.0, more * share(t)]), shaken)
    times = {"span_s": 4.0} if kind == "mass_drift" else {"t_jump_s": 1.9975}
    model = plant({"effect": kind, "node": "f2", "dm_kg": more, **times}, shaken)
    found = model.simulate(model.values, u, RATE_HZ)
    assert np.all((found - truth).std(axis=0) < AGREES * truth.std(axis=0))
    none = model.values.copy()
    none[model.parameters.index(("effect", 0, "dm_kg"))] = 0.0
    assert np.any((model.simulate(none, u, RATE_HZ) - truth).std(axis=0) > 0.1)


def test_the_force_along_a_motion_is_that_of_the_run():
    model = plant({"effect": "mass_drift", "node": "f2", "dm_kg": 0.4, "span_s": 4.0})
    u, _ = forced(None)
    told = model.run(model.values, u, RATE_HZ)
    a = told.rates[:, 3]
    seen = Motion(e=told.states[:, 1], v=told.states[:, 3], a=a, times=told.times)
    known = force_along(catalogue()["mass_drift"], {"dm_kg": 0.4, "span_s": 4.0}, seen)
    np.testing.assert_allclose(known, told.forces[:, 0], atol=2e-3 * np.abs(known).max())


def test_a_mass_that_is_not_there_yet_costs_no_more_steps_than_one_that_is():
    u, _ = forced(None)
    work = []
    for instant in (-1.0, 100.0):
        jump = {"effect": "mass_jump", "node": "f2", "dm_kg": 0.4, "t_jump_s": instant}
        model = plant(jump)
        with metered() as meter:
            model.simulate(model.values, u, RATE_HZ)
        work.append(meter.spent)
    assert work[1] < 1.5 * work[0]
