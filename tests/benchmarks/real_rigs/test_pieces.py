"""Pieces of records: cut, thinned, written and read back."""

import numpy as np
import pytest

from benchmarks.real_rigs.pieces import JUDGE, LEARN, Piece, Pieces, files_of, read_piece

RAMP = Piece(10.0, {"x": np.arange(100.0), "u": -np.arange(100.0)})


def test_a_part_holds_the_samples_between_two_instants():
    part = RAMP.part(2.0, 5.0)
    assert part.channels["x"].tolist() == list(range(20, 50))
    assert part.channels["u"].tolist() == [-i for i in range(20, 50)]
    assert len(RAMP.part(2.0)) == 80


def test_parts_that_follow_each_other_share_no_sample_and_lose_none():
    parts = [RAMP.part(0, 3.3), RAMP.part(3.3, 7.1), RAMP.part(7.1)]
    joined = np.concatenate([part.channels["x"] for part in parts])
    np.testing.assert_array_equal(joined, RAMP.channels["x"])


def test_a_centred_piece_has_no_mean_and_the_same_shape():
    centred = RAMP.centred()
    assert centred.channels["x"].mean() == 0
    np.testing.assert_array_equal(np.diff(centred.channels["x"]), np.diff(RAMP.channels["x"]))


def test_every_so_many_th_sample_keeps_the_time_of_a_sample():
    thin = RAMP.every(4)
    assert thin.rate_hz == 2.5
    np.testing.assert_allclose(
        thin.channels["x"], np.arange(len(thin)) / thin.rate_hz * RAMP.rate_hz
    )


@pytest.mark.parametrize("span", [(-1, 2), (5, 5), (2, 11)])
def test_a_part_that_is_not_there_is_refused(span):
    with pytest.raises(ValueError, match=r"A piece of 10 s has no part from"):
        RAMP.part(*span)


def test_channels_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"have \[3, 4\] samples"):
        Piece(1.0, {"x": np.zeros(3), "u": np.zeros(4)})


def test_a_channel_that_is_not_finite_is_refused_by_name():
    with pytest.raises(ValueError, match=r"Channel 'u' is not finite"):
        Piece(1.0, {"x": np.zeros(3), "u": np.array([0, np.nan, 0])})


def test_pieces_are_read_back_in_their_order(tmp_path):
    learn = tuple(Piece(50.0, {"x": np.full(5, float(i))}) for i in range(12))
    Pieces(learn, (RAMP,)).write(tmp_path)
    read = [read_piece(path) for path in files_of(tmp_path, LEARN)]
    assert [piece.channels["x"][0] for piece in read] == list(range(12))
    (judge,) = map(read_piece, files_of(tmp_path, JUDGE))
    assert judge.rate_hz == 10.0
    np.testing.assert_array_equal(judge.channels["u"], RAMP.channels["u"])
