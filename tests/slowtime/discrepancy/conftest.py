"""A rig of masses on a line, integrated by scipy: no code in common with what is tested."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import scipy.signal as sps
from scipy.integrate import solve_ivp

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import (
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Tolerance,
)

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
LETTERS: dict[str, Any] = {"x": "displacement", "v": "velocity", "a": "acceleration"}
MODES = {"states": "xva", "accelerations": "a", "partial": "a"}


@dataclasses.dataclass(frozen=True)
class Rig:
    """What is claimed of a rig, and what is true of it."""

    description: Description
    masses: np.ndarray
    stiffnesses: np.ndarray
    dampings: np.ndarray


@dataclasses.dataclass(frozen=True)
class Wrong:
    """What the model lacks: a force (e, v, t) on an element, base motion, a sensor's fault."""

    element: int | None = None
    force: object = None
    base_rms: float = 0.0
    sensor: int | None = None
    fault: object = None


def make_rig(rng, masses=3, mode="states", drive="force", stiffness_sd=0.01):
    """Draw a chain from the base on; true constants scatter about the claimed ones."""
    mass = rng.uniform(0.8, 1.25, masses)
    stiffness = 900.0 * rng.uniform(0.8, 1.25, masses)
    damping = 0.0016 * stiffness
    listened = [i for i in range(masses) if mode != "partial" or i != 1]
    description = Description(
        name="chain",
        nodes=tuple(Node(id=f"m{i + 1}", mass_kg=m) for i, m in enumerate(mass)),
        elements=tuple(
            Spring(
                id=f"j{i}",
                between=("base" if i == 0 else f"m{i}", f"m{i + 1}"),
                stiffness_n_per_m=k,
                damping_n_s_per_m=c,
            )
            for i, (k, c) in enumerate(zip(stiffness, damping, strict=True))
        ),
        inputs=(
            Input(channel="u", kind="force", node=f"m{masses}", unit="N")
            if drive == "force"
            else Input(channel="u", kind="base_acceleration", unit="m/s^2"),
        ),
        sensors=tuple(
            Sensor(
                channel=f"{letter}{i + 1}",
                quantity=LETTERS[letter],
                node=f"m{i + 1}",
                unit=UNITS[LETTERS[letter]],
                frame="absolute" if letter == "a" else "relative_to_base",
            )
            for letter in MODES[mode]
            for i in listened
        ),
        tolerance=Tolerance(stiffness=stiffness_sd, damping=0.1),
    )
    errors = rng.uniform(-1.7, 1.7, (2, masses))
    return Rig(
        description,
        mass,
        stiffness * (1 + stiffness_sd * errors[0]),
        damping * (1 + 0.1 * errors[1]),
    )


def multisine(rng, seconds, band_hz, rms):
    """A function of time with a random phase on every line of a band, and any period."""
    lines = np.arange(np.ceil(band_hz[0] * seconds), np.floor(band_hz[1] * seconds) + 1, 2)
    omega = 2 * np.pi * lines / (1.13 * seconds)
    phase = rng.uniform(0, 2 * np.pi, len(omega))
    size = rms * np.sqrt(2 / len(omega))
    return lambda t: size * np.cos(np.multiply.outer(t, omega) + phase).sum(axis=-1)


def shake(rig, rng, *, seconds, rate_hz, level, wrong, kick=0.0, start_s=0.0):
    """Integrate one record without noise; give inputs and outputs."""
    masses = len(rig.masses)
    on_base = rig.description.inputs[0].node is None
    drive = multisine(rng, seconds, (0.7, 11.0), level * (1.0 if on_base else 2.0))
    unseen = multisine(rng, seconds, (0.7, 11.0), wrong.base_rms)

    def base(t):
        moved = drive(t) if on_base else 0.0 * t
        return moved + unseen(t) if wrong.base_rms else moved

    def rates(t, state):
        e = np.diff(state[:masses], prepend=0.0)
        v = np.diff(state[masses:], prepend=0.0)
        inner = rig.stiffnesses * e + rig.dampings * v
        if wrong.element is not None:
            inner[wrong.element] += wrong.force(e[wrong.element], v[wrong.element], start_s + t)
        outer = -inner
        outer[:-1] += inner[1:]
        outer[-1] += 0.0 if on_base else drive(t)
        return np.concatenate([state[masses:], outer / rig.masses - base(t)])

    times = np.arange(round(seconds * rate_hz)) / rate_hz
    start = kick * rng.standard_normal(2 * masses) * np.repeat([0.01, 0.2], masses)
    found = solve_ivp(
        rates, (0, times[-1]), start, "DOP853", times, rtol=1e-6, atol=1e-9, max_step=0.03
    )
    state = found.y.T
    acceleration = (
        np.array([rates(t, s)[masses:] for t, s in zip(times, state, strict=True)])
        + np.asarray(base(times))[:, None]
    )
    motion = {
        "displacement": state[:, :masses],
        "velocity": state[:, masses:],
        "acceleration": acceleration,
    }
    outputs = np.stack(
        [motion[s.quantity][:, int(s.node[1:]) - 1] for s in rig.description.sensors], axis=1
    )
    return drive(times)[:, None], outputs


def noise_like(rng, outputs, snr_db, pole):
    """White or first-order noise, so many decibels below each channel."""
    white = rng.standard_normal((len(outputs) + 300, outputs.shape[1]))
    shaped = sps.lfilter([1.0], [1.0, -pole], white, axis=0)[300:] * np.sqrt(1 - pole**2)
    return shaped * outputs.std(axis=0) * 10 ** (-snr_db / 20)


@pytest.fixture(scope="session")
def campaign():
    """Give a function that draws a rig and its records; see the arguments."""

    def draw(
        seed,
        wrong=Wrong(),
        *,
        masses=3,
        mode="states",
        drive="force",
        snr_db=30.0,
        stiffness_sd=0.01,
        pole=0.0,
        kick=0.0,
        levels=(1.0, 2.0),
        seconds=8.0,
        rate_hz=64.0,
    ):
        rng = np.random.default_rng(seed)
        rig = make_rig(rng, masses, mode, drive, stiffness_sd)
        trials, start = [], 0.0
        for level in levels:
            inputs, outputs = shake(
                rig, rng, seconds=seconds, rate_hz=rate_hz, level=level, wrong=wrong,
                kick=kick * level, start_s=start,
            )  # fmt: skip
            noise = noise_like(rng, outputs, snr_db, pole)
            if wrong.sensor is not None:
                outputs[:, wrong.sensor] = wrong.fault(outputs[:, wrong.sensor])
            trials.append(
                Trial(inputs=inputs, outputs=outputs + noise, rate_hz=rate_hz, start_s=start)
            )
            start += seconds + 20.0
        return rig, tuple(trials)

    return draw


@pytest.fixture(scope="session")
def wrong():
    """Give the class that says what a model lacks."""
    return Wrong
