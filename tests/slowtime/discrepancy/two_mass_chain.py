"""Two masses on a line, pushed at the first: the rig of most tests of the search."""

import dataclasses

import numpy as np

from slowtime.discrepancy.records import Trial
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant

RATE = 64.0
FEW = (
    "cubic_hardening",
    "quadratic_damping",
    "input_delay",
    "coulomb",
    "sensor_gain",
    "input_gain",
)
KINDS = {name: kind for name, kind in catalogue().items() if name in FEW}
TWO = dataclasses.replace(
    chain([2.0, 1.5], [900.0, 700.0], dampings_n_s_per_m=[1.6, 1.2]),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=tuple(
        one
        for n in ("m1", "m2")
        for one in (
            Sensor(channel=f"x_{n}", quantity="displacement", node=n, unit="m"),
            Sensor(channel=f"v_{n}", quantity="velocity", node=n, unit="m/s"),
        )
    ),
    tolerance=Tolerance(stiffness=0.02, damping=0.15),
)
FIRST, SECOND = (Place("element", element.id) for element in TWO.elements)
CUBIC = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 2e4})
STRONG = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 4e5})
DRAG = Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 30.0})
LATE = Effect("input_delay", Place("input", "u"), {"delay_s": 0.01})


def records_of(effects, *, of=TWO, count=2, samples=500, seed=3, noise=0.005):
    """Give records of a rig that has some effects, at levels from 6 N to 14 N."""
    rng = np.random.default_rng(seed)
    entries = (*of.effects, *(e.entry() for e in effects))
    truth = Plant.of(dataclasses.replace(of, effects=entries))
    found = []
    for level in np.linspace(6.0, 14.0, count):
        push = np.convolve(rng.standard_normal(samples), np.hanning(7), "same")[:, None] * level
        clean = truth.simulate(truth.values, push, RATE)
        own = noise * clean.std(axis=0) * rng.standard_normal(clean.shape)
        found.append(Trial(inputs=push, outputs=clean + own, rate_hz=RATE))
    return tuple(found)
