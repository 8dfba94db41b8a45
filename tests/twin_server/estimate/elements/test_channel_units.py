"""What each channel is measured in decides how it goes into a shape; the edge tells it."""

import json

import numpy as np
import pytest

from slowtime_schemas.codec import decode, encode
from slowtime_schemas.streams import FEATURES
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.registration.twin import Registration

LOSS = (0.0, -0.08, 0.0)
LEARN = 4
SI = ("m/s^2",) * 3


def told(model, features):
    """States, bodies and notices of a twin with such a model."""
    made = Registration(changes="elements", model=model, learn_epochs=LEARN)
    none = [0] * len(features)
    found = estimate([Twin(made, Checkpoint.start(made))], features, none, none)
    bodies = [json.loads(detail.body) for detail in found.details if detail is not None]
    said = [n for n in found.notices[0] if n.kind == "units_in_doubt"]
    return found.states, bodies, said


def changes(bodies):
    return np.array([list(body["elements"]["storey2"].values()) for body in bodies[LEARN:]])


def measured_in(features, units, factors, powers):
    """The same motion, of which each channel gives another quantity, in another unit."""

    def turned(mode):
        omega = 2 * np.pi * mode.frequency_hz.value
        worth = np.array(factors) * (1j * omega) ** (np.array(powers) - 2.0)
        shape = (np.array(mode.shape.re) + 1j * np.array(mode.shape.im)) * worth
        norm = np.linalg.norm(shape)
        sd = np.array(mode.shape.sd) * np.abs(worth) / norm
        largest = shape[np.argmax(np.abs(shape))]
        shape = shape * largest.conjugate() / abs(largest) / norm
        parts = {"re": tuple(shape.real), "im": tuple(shape.imag), "sd": tuple(sd)}
        return mode.model_copy(update={"shape": mode.shape.model_copy(update=parts)})

    return [
        m.model_copy(update={"modes": tuple(map(turned, m.modes)), "units": units})
        for m in features
    ]


@pytest.fixture(scope="module")
def plain(frame):
    """Four epochs to learn from, four with a weaker storey; no units, as older agents send."""
    made = frame(seed=3)
    return [made.epoch(i, LOSS if i >= LEARN else (0.0, 0.0, 0.0)) for i in range(2 * LEARN)]


@pytest.fixture(scope="module")
def alone(frame, plain):
    return told(frame.model, plain)


def test_sensors_of_mixed_units_tell_what_those_of_one_unit_tell(frame, plain, alone):
    mixed = measured_in(plain, ("g", "m/s", "mm"), (1 / 9.80665, 1.0, 1e3), (2, 1, 0))
    _, bodies, said = told(frame.model, mixed)
    np.testing.assert_allclose(changes(bodies), changes(alone[1]), atol=1e-8)
    # The model's sensors claim accelerations; that they are none is said, once.
    (notice,) = said
    assert (notice.row, notice.severity) == (0, "warning")
    assert "a_floor2 is in m/s, and the model's sensor gives acceleration" in notice.message
    assert "a_floor1" not in notice.message
    # What is told compares: displacements of unit norm, the largest one real.
    for body, before in zip(bodies, alone[1], strict=True):
        for mode, other in zip(body["modes"], before["modes"], strict=True):
            np.testing.assert_allclose(mode["shape"]["re"], other["shape"]["re"], atol=1e-9)
            np.testing.assert_allclose(mode["shape"]["im"], other["shape"]["im"], atol=1e-9)


def test_a_channel_in_volts_beside_accelerations_is_left_out_and_said(frame, plain):
    volts = ("m/s^2", "m/s^2", "V")
    first = told(frame.model, measured_in(plain, volts, (1, 1, 0.1), (2, 2, 2)))
    other = told(frame.model, measured_in(plain, volts, (1, 1, 7.0), (2, 2, 2)))
    np.testing.assert_allclose(changes(first[1]), changes(other[1]), atol=1e-8)
    (notice,) = first[2]
    assert (
        "a_floor3 in 'V': not a unit of motion, while other channels have one, so left out"
        in notice.message
    )
    assert all(mode["shape"] is None for body in first[1] for mode in body["modes"])


def test_a_channel_without_a_unit_beside_known_ones_has_the_model_s_and_that_is_said(
    frame, plain, alone
):
    _, bodies, said = told(
        frame.model, measured_in(plain, ("m/s^2", "", "m/s^2"), (1, 1, 1), (2, 2, 2))
    )
    np.testing.assert_allclose(changes(bodies), changes(alone[1]), atol=1e-9)
    (notice,) = said
    assert "a_floor2 has no unit while other channels have one" in notice.message


@pytest.mark.parametrize(("unit", "doubts"), [("m/s^2", 0), ("", 0), ("1", 0), ("V", 1)])
def test_channels_of_one_unit_give_the_bytes_that_older_messages_give(
    frame, plain, alone, unit, doubts
):
    states, bodies, said = told(
        frame.model, [m.model_copy(update={"units": (unit,) * 3}) for m in plain]
    )
    assert states.tobytes() == alone[0].tobytes()
    assert bodies == alone[1]
    assert len(said) == doubts


def test_a_recording_of_the_version_before_replays_bit_for_bit(frame, plain, alone):
    older = []
    for message in plain:
        content = json.loads(encode(message))
        del content["units"]
        older.append(decode(FEATURES, json.dumps(content | {"version": 2}).encode()))
    states, bodies, said = told(frame.model, older)
    assert states.tobytes() == alone[0].tobytes()
    assert (bodies, said) == (alone[1], [])


def test_what_is_in_doubt_is_said_again_only_when_it_changes(frame, plain):
    units = [SI, ("V", *SI[1:]), ("V", *SI[1:]), SI, ("mV", *SI[1:]), SI, SI, SI]
    features = [m.model_copy(update={"units": u}) for m, u in zip(plain, units, strict=True)]
    _, _, said = told(frame.model, features)
    assert [(n.row, n.details["units"]["a_floor1"]) for n in said] == [(1, "V"), (4, "mV")]
