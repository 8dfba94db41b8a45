"""A chain of three masses under random forces, and its equations by another integrator."""

import dataclasses
import itertools
from typing import Literal

import numpy as np
import pytest
import scipy.signal as sps
from scipy.integrate import solve_ivp

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.plant import Plant

Quantity = Literal["acceleration", "velocity", "displacement"]

RATE = 200.0
MASSES = np.array([1.9, 2.1, 1.7])
STIFFNESSES = np.array([4100.0, 3900.0, 3500.0])
DAMPINGS = np.array([2.3, 2.2, 2.0])
TIES = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
K, C = (TIES.T @ np.diag(values) @ TIES for values in (STIFFNESSES, DAMPINGS))
HEARD: tuple[tuple[Quantity, str], ...] = (
    ("displacement", "m"),
    ("velocity", "m/s"),
    ("acceleration", "g"),
)
RIG = dataclasses.replace(
    chain(MASSES.tolist(), STIFFNESSES.tolist(), dampings_n_s_per_m=DAMPINGS.tolist()),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=tuple(
        Sensor(channel=f"{quantity[0]}_{node}", quantity=quantity, node=node, unit=unit)
        for quantity, unit in HEARD
        for node in ("m1", "m2", "m3")
    ),
    tolerance=Tolerance(stiffness=0.02, damping=0.15, mass=0.0),
)
FILTER = sps.butter(4, 20.0, fs=RATE, output="sos")


def pushes(samples, seed=1, size=40.0):
    rng = np.random.default_rng(seed)
    return size * sps.sosfiltfilt(FILTER, rng.standard_normal((samples, 1)), axis=0)


class Chain:
    """The chain with a force along its second spring, integrated in pieces between samples."""

    def __init__(self, push):
        self.push, self.times = push[:, 0], np.arange(len(push)) / RATE
        self.tie, self.mobility = TIES[1], TIES[1] @ (TIES[1] / MASSES)

    def rate(self, t, state, force):
        q, v = state[:3], state[3:6]
        loads = -K @ q - C @ v - self.tie * force
        loads[0] += np.interp(t, self.times, self.push)
        return np.concatenate([v, loads / MASSES])

    def smooth(self, force, memory=None):
        """Displacements under a force (t, e, v, z), which may remember by `memory`."""

        def motion(t, state):
            seen = (t, self.tie @ state[:3], self.tie @ state[3:6], state[6:])
            extra = [] if memory is None else [memory(*seen)]
            return np.concatenate([self.rate(t, state, force(*seen)), extra])

        start = np.zeros(6 if memory is None else 7)
        return (
            solve_ivp(
                motion,
                (0, self.times[-1]),
                start,
                t_eval=self.times,
                method="DOP853",
                rtol=1e-9,
                atol=1e-13,
                max_step=1 / RATE,
            )
            .y[:3]
            .T
        )

    def rubbing(self, limit):
        """Displacements under friction, from one event to the next; and share of sticking."""
        state, mode, states, stuck = np.zeros(6), 0, [np.zeros(6)], 0.0

        def needed(t, state):
            return self.tie @ self.rate(t, state, 0.0)[3:] / self.mobility

        def motion(t, state):
            speed = max(mode * (self.tie @ state[3:]), 0.0)
            return self.rate(t, state, needed(t, state) if mode == 0 else mode * limit(speed))

        def margin(t, state):
            # Beyond by a hair, lest what has just begun ends at once.
            if mode:
                return mode * (self.tie @ state[3:]) + 1e-12
            return limit(0.0) * (1 + 1e-9) - abs(needed(t, state))

        margin.terminal, margin.direction = True, -1  # type: ignore[attr-defined]
        for begin, end in itertools.pairwise(self.times):
            t = begin
            if mode == 0 and margin(t, state) < 0:
                mode = np.sign(needed(t, state))
            while t < end - 1e-13:
                run = solve_ivp(
                    motion, (t, end), state, "DOP853", events=margin, rtol=1e-10, atol=1e-13
                )
                stuck += (run.t[-1] - t) * (mode == 0)
                t, state = run.t[-1], run.y[:, -1]
                if run.status == 1:
                    slip = self.tie @ state[3:] / self.mobility
                    state[3:] -= slip * self.tie / MASSES
                    sticks = mode != 0 and abs(needed(t, state)) <= limit(0.0)
                    mode = 0 if sticks else np.sign(needed(t, state))
            states.append(state)
        return np.array(states)[:, :3], stuck / self.times[-1]


@pytest.fixture(scope="session")
def rig():
    """Make the chain's plant with effects; inputs straight between samples, as integrated."""

    def make(*effects, hold="first", **changes):
        description = dataclasses.replace(RIG, effects=effects, **changes)
        return Plant.of(description, hold=hold)

    return make


@pytest.fixture(scope="session")
def reference():
    """The chain, integrated by another road."""
    return Chain


@pytest.fixture(scope="session")
def push():
    """Random force [N] in a band that the chain answers in."""
    return pushes
