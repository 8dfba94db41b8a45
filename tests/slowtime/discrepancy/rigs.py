"""The smallest rigs: one mass on a spring, pushed and measured, and two."""

import dataclasses

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Description, Input, Sensor, Tolerance
from slowtime.dynamics.effects import Place


def one_mass(damping_n_s_per_m: float = 1.6) -> Description:
    """Give its description."""
    return dataclasses.replace(
        chain([2.0], [800.0], dampings_n_s_per_m=[damping_n_s_per_m]),
        inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
        tolerance=Tolerance(stiffness=0.02, damping=0.15),
    )


def two_masses(damping_n_s_per_m: float) -> Description:
    """Give that of two masses, the first pushed, whose accelerations are heard."""
    return dataclasses.replace(
        chain([2.0, 1.5], [1800.0, 1500.0], dampings_n_s_per_m=[damping_n_s_per_m] * 2),
        inputs=(Input(channel="f", kind="force", node="m1", unit="N"),),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
            for i in (1, 2)
        ),
        tolerance=Tolerance(stiffness=0.02, damping=0.15),
    )


ONE = one_mass()
PLACE = Place("element", ONE.elements[0].id)
