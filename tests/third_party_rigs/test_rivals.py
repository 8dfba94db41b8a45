"""What no diagnosis could tell apart has no nats between it, and what it could has many."""

import dataclasses

import numpy as np
import pytest
import scipy.optimize

from .laws import EVERY, Change
from .rigs import FINE, STILL, Excitation, Link, Structure, ground_motion, run
from .rivals import Rig, Seen, _Distances, distance, told_late

RATE_HZ, SAMPLES = 100.0, 800
LINK = Link("s1", (-1, 0), 1500.0, 2.0)
ONE = Structure((2.0,), (LINK,))
TWO = Structure((3.0, 2.0), (Link("s1", (-1, 0), 4000.0, 4.0), Link("s2", (0, 1), 3000.0, 3.0)))
NOISE = 0.005


def excitation(size, every=False, seed=1):
    rng = np.random.default_rng(seed)
    count = (SAMPLES - 1) * FINE + 1
    hertz = np.fft.rfftfreq(count, 1 / (RATE_HZ * FINE))
    own = (hertz > 1) & (hertz < 15)

    def noise():
        series = np.fft.irfft(own * np.exp(2j * np.pi * rng.random(len(hertz))), count)
        return 5.0 * series / series.std()

    loads = np.zeros((count, size))
    for k in range(size):
        loads[:, k] = noise() if every or k == size - 1 else 0.0
    return Excitation(RATE_HZ, SAMPLES, loads, np.zeros(count), np.zeros((2, size)))


def with_change(structure, change):
    """Build the structure that a model without a change stands for."""
    if change.what in EVERY:
        law = EVERY[change.what].force(change.size, 0.01, 0.3, change.shape)
        return dataclasses.replace(structure, forces=((change.at, law),))
    if change.what == "mass":
        masses = np.array(structure.masses)
        masses[change.at[0]] += change.size
        return dataclasses.replace(structure, masses=tuple(masses.tolist()))
    return structure


def rig_of(structure, change, *, ambient=False):
    off = np.zeros(2 * len(structure.links))
    made = with_change(structure, change)
    return Rig(made, (change,), lambda pair: (0.01, 0.3), off, (0.03, 0.2), ambient)


def record(rig, seed=1):
    size = rig.size
    given = excitation(size, every=rig.ambient, seed=seed)
    motion = run(rig.structure, given)
    told, times = motion["a"].copy(), np.arange(SAMPLES) / RATE_HZ
    (change,) = rig.missing
    if change.what == "sensor gain":
        told[:, change.at[0]] *= 1 + change.size
    if change.what == "sensor delay":
        told[:, change.at[0]] = told_late(told[:, change.at[0]], times, change.shape)
    load = None if rig.ambient else given.loads[::FINE, -1]
    return Seen(given, motion, told, load, np.full(size, NOISE))


@pytest.mark.parametrize(
    ("structure", "change", "alike"),
    [
        (ONE, Change("sensor delay", (0,), shape=0.01), True),  # that of the input
        (ONE, Change("sensor gain", (0,), 0.25), True),  # that of the input
        (TWO, Change("sensor gain", (0,), 0.25), False),
        (TWO, Change("spring", (-1, 1), 600.0), False),
        (TWO, Change("mass", (1,), 0.4), False),
    ],
)
def test_the_best_rival_is_near_where_two_changes_do_the_same(structure, change, alike):
    rig = rig_of(structure, change)
    nats, nothing, _ = distance(rig, [record(rig)])
    # Splines between samples are right to some 1e-4 of what is seen, and so far over the noise.
    assert nats < 1e-6 * nothing if alike else nats > 100.0


def test_without_measured_forces_a_mass_alone_is_known_up_to_a_scale():
    change = Change("mass", (0,), 0.3)
    alone = rig_of(ONE, change, ambient=True)
    nats, nothing, _ = distance(alone, [record(alone)])
    assert nats < 0.1 < 3.0 < nothing
    chain = rig_of(TWO, change, ambient=True)
    assert distance(chain, [record(chain)])[0] > 10 * nats


@pytest.mark.parametrize(
    ("change", "rival"),
    [
        (Change("cubic", (-1, 0), 2.5e4), Change("stop", (-1, 0))),
        (Change("drag", (-1, 0), 0.4), Change("cubic", (-1, 0))),
    ],
)
def test_the_distance_is_that_of_a_refit_by_simulation(change, rival):
    """Where rivals are near: size, stiffness and damping are fitted to what the truth tells."""
    rig = rig_of(ONE, change)
    seen = record(rig)
    truth = seen.motion["a"][:, 0]

    def left(x):
        link = dataclasses.replace(
            LINK, stiffness=LINK.stiffness * (1 + x[0]), damping=LINK.damping * (1 + x[1])
        )
        size = change.size * x[2]
        near = with_change(Structure((2.0,), (link,)), dataclasses.replace(rival, size=size))
        given = dataclasses.replace(seen.given, start=np.array([[x[3] * 1e-3], [x[4] * 1e-2]]))
        apart = (run(near, given)["a"][:, 0] - truth) / NOISE
        return np.concatenate([apart, [x[0] / 0.03, x[1] / 0.2]])

    by_refit = scipy.optimize.least_squares(
        left, np.full(5, 1e-2), x_scale=0.01, diff_step=[1e-3], max_nfev=15
    ).cost
    found = _Distances(rig, [seen]).of(0, rival)
    assert found == pytest.approx(by_refit, rel=0.3)


def test_a_neighbour_that_stands_still_feels_the_motion_of_the_base():
    """A spring to it is one to the ground, whose motion adds a force."""
    given = excitation(1)
    ground = dataclasses.replace(given, ground=given.loads[:, 0], loads=0 * given.loads)
    stiffness = 200.0
    law = EVERY["spring"].force(stiffness, 1.0, 1.0, 1.0)
    to_still = run(dataclasses.replace(ONE, forces=(((STILL, 0), law),)), ground)
    fine = np.arange(len(given.loads)) / (RATE_HZ * FINE)
    pulled = dataclasses.replace(
        ground, loads=-stiffness * ground_motion(ground)(fine)[:, None]
    )
    to_ground = run(dataclasses.replace(ONE, forces=(((-1, 0), law),)), pulled)
    np.testing.assert_allclose(to_still["a"], to_ground["a"], atol=1e-4)
