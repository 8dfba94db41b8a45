"""Simulations that start displaced, or moving."""

import dataclasses

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.builders import beam, chain
from slowtime.dynamics.description import (
    DescriptionError,
    Input,
    Sensor,
    Start,
    Support,
    assemble,
)
from slowtime.dynamics.elements import Spring
from slowtime.dynamics.structure import state_matrix
from slowtime.dynamics.units import Quantity
from slowtime_services.models import model_text, run_model
from slowtime_services.models.model_reader import parse_model

RATE = 100.0
QUANTITIES: tuple[tuple[Quantity, str], ...] = (
    ("displacement", "m"),
    ("velocity", "m/s"),
    ("acceleration", "m/s^2"),
)
PAIR = dataclasses.replace(
    chain([2.0, 1.0], [300.0, 200.0], dampings_n_s_per_m=[3.0, 0.5]),
    sensors=tuple(
        Sensor(channel=f"{quantity[0]}{node}", quantity=quantity, node=node, unit=unit)
        for quantity, unit in QUANTITIES
        for node in ("m1", "m2")
    ),
    initial=(
        Start(node="m1", displacement_m=0.02),
        Start(node="m2", displacement_m=-0.01, velocity_m_per_s=0.3),
    ),
)
PUSHED = dataclasses.replace(
    PAIR, inputs=(Input(channel="u", kind="force", node="m2", unit="N"),)
)


def by_lsim(push):
    """The same equation, integrated by scipy."""
    structure = assemble(PAIR)
    a = state_matrix(structure)
    b = np.array([[0.0], [0.0], [0.0], [1.0]])
    c = np.vstack([np.eye(4), a[2:]])
    d = np.vstack([np.zeros((4, 1)), b[2:]])
    times = np.arange(len(push)) / RATE
    return sps.lsim((a, b, c, d), push, times, X0=[0.02, -0.01, 0.0, 0.3])[1]


def test_a_free_decay_is_that_of_lsim():
    seen = run_model(PAIR, {}, RATE, samples=500)
    np.testing.assert_allclose(
        np.stack(list(seen.values()), axis=1), by_lsim(np.zeros(500)), atol=1e-10
    )


def test_a_start_and_a_force_are_those_of_lsim():
    push = np.random.default_rng(1).standard_normal(500)
    seen = run_model(PUSHED, {"u": push}, RATE, hold="first")
    np.testing.assert_allclose(np.stack(list(seen.values()), axis=1), by_lsim(push), atol=1e-10)


def test_a_start_of_the_rotation_of_a_beam_decays_as_lsim_has_it():
    tip = beam(1.0, 2.0, 0.5, elements=2, damping_s=1e-3)
    tip = dataclasses.replace(
        tip,
        sensors=(Sensor(channel="x", quantity="displacement", node="n2", unit="m"),),
        initial=(Start(node="n2.rotation", displacement_m=0.1),),
    )
    seen = run_model(tip, {}, 400.0, samples=300)["x"]
    a = state_matrix(assemble(tip))
    names = list(tip.dofs)
    start = np.zeros(8)
    start[names.index("n2.rotation")] = 0.1
    read = np.zeros((1, 8))
    read[0, names.index("n2")] = 1.0
    times = np.arange(300) / 400.0
    one = sps.lsim((a, np.zeros((8, 1)), read, [[0.0]]), None, times, X0=start)[1]
    np.testing.assert_allclose(seen, one, atol=1e-9)


def test_a_start_is_that_of_its_node_alone_where_supports_begin_displaced():
    rig = dataclasses.replace(
        PAIR,
        supports=(Support(id="crank"),),
        elements=tuple(
            dataclasses.replace(one, between=("crank", "m1"))
            if isinstance(one, Spring) and one.id == "k1"
            else one
            for one in PAIR.elements
        ),
        inputs=(Input(channel="x", kind="imposed_displacement", node="crank", unit="m"),),
        initial=(Start(node="m1", displacement_m=0.5),),
    )
    seen = run_model(rig, {"x": np.full(100, 0.1)}, RATE)
    assert seen["dm1"][0] == pytest.approx(0.5)
    # The other is carried along: a chain with a free end goes where its support goes.
    assert seen["dm2"][0] == pytest.approx(0.1)


def test_a_file_with_supports_forces_and_start_reads_back_to_the_last_digit():
    first = PAIR.elements[0]
    assert isinstance(first, Spring)
    rig = dataclasses.replace(
        PUSHED,
        supports=(Support(id="crank"),),
        elements=(*PAIR.elements, dataclasses.replace(first, id="k9", between=("crank", "m2"))),
        inputs=(
            Input(channel="x", kind="imposed_velocity", node="crank", unit="mm/s"),
            Input(channel="b", kind="base_displacement", unit="mm"),
        ),
        sensors=(
            *PAIR.sensors,
            Sensor(channel="f", quantity="force", element="k9", unit="kN", noise_sd=0.1),
            Sensor(channel="r", quantity="force", node="crank", unit="N"),
            Sensor(channel="g", quantity="force", node="base", unit="N"),
        ),
    )  # fmt: skip
    text = model_text(rig)
    again = parse_model(text, "rig.yaml")
    assert model_text(again) == text
    assert "node: base" in text
    assert "- {node: m1, displacement_m: 0.02}" in text


def test_old_files_are_written_as_they_were():
    text = model_text(dataclasses.replace(PUSHED, initial=()))
    assert not {"supports", "initial", "element:"} & {w.strip("{,:") for w in text.split()}
    assert "- {channel: u, kind: force, node: m2, unit: N}" in text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"initial": (Start(node="m7"),)}, "No node that moves freely is called 'm7'.*m1, m2"),
        ({"initial": (Start(node="m1"), Start(node="m1"))}, "used twice"),
        (
            {"inputs": (Input(channel="x", kind="imposed_displacement", unit="m"),)},
            "moves a support or a node. Name it as `node`, or declare a base_displacement",
        ),
        (
            {"inputs": (Input(channel="x", kind="imposed_velocity", node="s", unit="m/s"),)},
            "no support and no point node is called 's'.*`supports`",
        ),
        (
            {"inputs": (Input(channel="x", kind="base_velocity", node="m1", unit="m/s"),)},
            "Leave `node` out, or declare an imposed_velocity",
        ),
        (
            {"inputs": (Input(channel="x", kind="base_displacement", unit="m", hold="first"),)},
            "unbounded at each sample. Leave `hold` out",
        ),
        (
            {"inputs": (Input(channel="x", kind="base_displacement", unit="m/s^2"),)},
            "'m/s\\^2' is not a valid unit of displacement",
        ),
        (
            {
                "initial": (),
                "inputs": (
                    Input(channel="x", kind="imposed_displacement", node="m1", unit="m"),
                    Input(channel="f", kind="force", node="m1", unit="N"),
                ),
            },
            "Declare 'f' as a sensor: quantity: force, node: m1",
        ),
        (
            {
                "initial": (),
                "inputs": (
                    Input(channel="x", kind="imposed_displacement", node="m1", unit="m"),
                    Input(channel="v", kind="imposed_velocity", node="m1", unit="m/s"),
                ),
            },
            "moved by 'x' and by 'v'",
        ),
        (
            {"sensors": (Sensor(channel="f", quantity="force", node="m1", unit="N"),)},
            "nothing holds or drives 'm1'.*Allowed: base; or name an `element`",
        ),
        (
            {"sensors": (Sensor(channel="f", quantity="force", element="k7", unit="N"),)},
            "no spring element is called 'k7'. There are: k1, k2",
        ),
        (
            {"sensors": (Sensor(channel="f", quantity="force", unit="N"),)},
            "either in an `element`, or on a `node`",
        ),
        (
            {"sensors": (Sensor(channel="x", quantity="velocity", unit="m/s"),)},
            "velocity of no node",
        ),
        (
            {"sensors": (Sensor(channel="x", quantity="velocity", element="k1", unit="m/s"),)},
            "only a force is measured in an element",
        ),
        ({"supports": (Support(id="m1"),)}, "'m1' is the name of a node or of the base"),
    ],
)
def test_a_declaration_that_contradicts_itself_says_what_to_do(changes, words):
    with pytest.raises(DescriptionError, match=words):
        dataclasses.replace(PAIR, **changes)
