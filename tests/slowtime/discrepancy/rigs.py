"""The smallest rig: a mass on a spring, pushed, of which the displacement is measured."""

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


ONE = one_mass()
PLACE = Place("element", ONE.elements[0].id)
