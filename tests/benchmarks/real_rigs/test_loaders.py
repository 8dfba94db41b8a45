"""Loaders: facts of made inputs, and every real set where its files are."""

from typing import Any

import numpy as np
import pytest
import scipy.signal

from benchmarks.real_rigs.loaders import FRAME_S, disc_free, from_largest_peak, pulse_response
from benchmarks.real_rigs.pieces import Piece
from benchmarks.real_rigs.sets import SETS
from slowtime_services.models import read_description

MASS = np.diag([2.0, 3.0])
STIFFNESS = np.array([[9e3, -4e3], [-4e3, 4e3]])
DAMPING = 4e-4 * STIFFNESS


def test_a_decay_begins_at_its_largest_peak_of_either_sign():
    times = np.arange(400) / 20
    decay = -np.exp(-0.1 * times) * np.cos(4 * times)
    hand = np.linspace(0, -0.9, 30)
    piece = Piece(20.0, {"angle": np.concatenate([hand, decay]), "t": np.arange(430.0)})
    cut = from_largest_peak(piece, "angle")
    np.testing.assert_array_equal(cut.channels["angle"], decay)
    assert cut.channels["t"][0] == 30


def test_pulse_responses_are_those_that_the_structure_gives():
    """FRFs in closed form, and the response to the same pulse by exact stepping in time."""
    lines = np.arange(1, 4097) / 32
    s = 2j * np.pi * lines[:, None, None]
    flexibility = np.linalg.inv(s**2 * MASS + s * DAMPING + STIFFNESS)
    response: Any = (s**2 * flexibility)[:, :, 1]
    piece = pulse_response(lines, response, 1)
    assert len(piece) == FRAME_S * piece.rate_hz
    assert not piece.channels["f1"].any()
    force = piece.channels["f2"]
    fine = 16
    dense = scipy.signal.resample(force, fine * len(force))
    inverse = np.linalg.inv(MASS)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ STIFFNESS, -inverse @ DAMPING]])
    b = np.concatenate([np.zeros(2), inverse[:, 1]])[:, None]
    times = np.arange(len(dense)) / (piece.rate_hz * fine)
    _, told, _ = scipy.signal.lsim((a, b, a[2:], b[2:]), dense, times)
    measured = np.column_stack([piece.channels["a1"], piece.channels["a2"]])
    np.testing.assert_allclose(measured, told[::fine], atol=0.01 * np.abs(told).max())


def test_the_force_on_the_disc_is_absent_from_free_decays(tmp_path):
    folder = tmp_path / "torsion_disc"
    folder.mkdir()
    for number in (8, 9, 10):
        angle = np.concatenate([[0, 1, 4.0 + number], 3.9 * 0.99 ** np.arange(60)])
        rows = np.column_stack([0.05 * np.arange(len(angle)), angle])
        np.savetxt(
            folder / f"free_no_magnet_{number}.csv",
            rows,
            delimiter=",",
            header="t,a",
            comments="",
        )
    pieces = disc_free(tmp_path)
    assert [piece.channels["angle"][0] for piece in pieces.learn] == [12.0, 13.0]
    (held,) = pieces.judge
    assert (held.rate_hz, held.channels["angle"][0], list(held.channels)) == (
        20.0,
        14,
        ["angle"],
    )


@pytest.mark.data
@pytest.mark.parametrize("one", SETS, ids=lambda one: one.name)
def test_pieces_have_the_channels_of_their_model_and_share_nothing(one, data):
    try:
        pieces = one.load(data)
    except OSError as error:
        pytest.skip(f"{error.filename} is not there; set SLOWTIME_DATA to where it is")
    model = read_description(one.model)
    wanted = {each.channel for each in model.inputs} | {each.channel for each in model.sensors}
    assert pieces.learn
    assert pieces.judge
    for piece in (*pieces.learn, *pieces.judge):
        assert set(piece.channels) == wanted
        assert len(piece) >= 64
    loud = model.sensors[0].channel
    for held in pieces.judge:
        for learnt in pieces.learn:
            size = min(len(held), len(learnt))
            assert not np.array_equal(held.channels[loud][:size], learnt.channels[loud][:size])
