"""Which sensors and lines of ambient records are used."""

import numpy as np
import pytest

from slowtime.discrepancy.ambient.record_lines import driven_lines, sensors_of_different_nodes
from slowtime.discrepancy.localization import LinearModel
from slowtime.dynamics.description import Description, Node, Sensor, Spring


def rig(*sensors):
    return Description(
        name="two",
        nodes=(Node(id="m1", mass_kg=1.0), Node(id="m2", mass_kg=1.0)),
        elements=(
            Spring(
                id="j0", between=("base", "m1"), stiffness_n_per_m=900.0, damping_n_s_per_m=1.4
            ),
            Spring(
                id="j1", between=("m1", "m2"), stiffness_n_per_m=800.0, damping_n_s_per_m=1.3
            ),
        ),
        sensors=tuple(
            Sensor(channel=f"{quantity[0]}{node}", quantity=quantity, node=node, unit=unit)
            for quantity, node, unit in sensors
        ),
    )


def test_of_several_sensors_at_a_node_the_acceleration_is_used():
    model = rig(
        ("displacement", "m1", "m"),
        ("velocity", "m2", "m/s"),
        ("acceleration", "m1", "m/s^2"),
        ("displacement", "m2", "m"),
    )
    assert sensors_of_different_nodes(model) == [1, 2]


@pytest.mark.parametrize("end_hz", [9.0, 14.0, 1e9])
def test_lines_beyond_the_end_of_the_forces_are_dropped(end_hz):
    sensors = [("acceleration", node, "m/s^2") for node in ("m1", "m2")]
    linear = LinearModel.of(rig(*sensors))
    hz = np.arange(1, 2001) / 100.0
    rng = np.random.default_rng(2)

    def normal(*shape):
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    response = linear.sensor_response(hz, linear.compliance(hz))
    forces = normal(len(hz), 2) * (hz < end_hz)[:, None]
    lines = np.einsum("fsd,fd->fs", response, forces) + 1e-3 * normal(len(hz), 2)
    kept = driven_lines(linear, hz, lines)
    # Bands are 0.12 Hz wide; the one with the end of the forces and its neighbours go.
    assert kept.frequency_hz[-1] < min(end_hz, 20.01)
    assert kept.frequency_hz[-1] > min(end_hz, 20.0) - 0.4
    assert kept.frequency_hz[0] < 0.2
