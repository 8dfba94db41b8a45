"""The rig of these tests: one spring, its motion imposed and its force measured."""

import dataclasses

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor, Tolerance

RATE = 100.0
K, C = 50.0, 2.0
RIG = dataclasses.replace(
    chain([1e-3], [K], dampings_n_s_per_m=[C]),
    inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
    sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
    tolerance=Tolerance(stiffness=0.1, damping=0.3),
)
