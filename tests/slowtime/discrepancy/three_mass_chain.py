"""Three masses on a line, pushed at the top: heard by one accelerometer, or by three."""

import dataclasses

import numpy as np

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Place
from slowtime.dynamics.plant import Plant

RATE = 80.0
THREE = dataclasses.replace(
    chain([2.0, 1.5, 1.0], [900.0, 700.0, 500.0], dampings_n_s_per_m=[1.6, 1.2, 1.0]),
    inputs=(Input(channel="u", kind="force", node="m3", unit="N"),),
    sensors=(Sensor(channel="a3", quantity="acceleration", node="m3", unit="m/s^2"),),
    tolerance=Tolerance(stiffness=0.02, damping=0.1),
)
EVERY = dataclasses.replace(
    THREE,
    sensors=tuple(
        Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
        for i in (1, 2, 3)
    ),
)
GROUND, MIDDLE, TOP = (Place("element", element.id) for element in THREE.elements)


def recorded(description, effects, *, seed=4, count=2, seconds=12.0, level=8.0):
    """Give records of a structure with effects, pushed at random, at 1 % of noise."""
    rng = np.random.default_rng(seed)
    truth = Plant.of(
        dataclasses.replace(description, effects=tuple(e.entry() for e in effects))
    )
    found = []
    for number in range(count):
        push = rng.standard_normal(int(seconds * RATE))
        push = level * (1 + number) * np.convolve(push, np.hanning(9) / 2, "same")[:, None]
        clean = truth.simulate(truth.values, push, RATE)
        noise = 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + noise, rate_hz=RATE))
    return tuple(found)
