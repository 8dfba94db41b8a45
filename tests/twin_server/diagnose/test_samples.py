"""Records for a diagnosis from raw blocks: cut at gaps and epochs, within a span, bounded."""

import numpy as np
import pytest

from slowtime.signals.block import Block, RateCorrection
from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.record import RecordingWriter
from twin_server.diagnose import NoSamplesError, Task, pieces_of, within
from twin_server.diagnose.samples import bounded, held_back
from twin_server.diagnose.samples_diagnosis import _pieces
from twin_server.orders import DiagnosisOrder

RATE = 100.0
SECOND = 10**9


def block(first, count=100, *, epoch=None, start_s=None, channels=("a", "u"), clock=None):
    rate = RATE if clock is None else RATE * (1 + clock[0])
    begins = first / rate if start_s is None else start_s
    return Block(
        samples=np.full((count, len(channels)), float(first)),
        rate_hz=RATE,
        first_index=first,
        start_ns=round(begins * SECOND),
        channels=channels,
        units=("m/s^2", "N")[: len(channels)],
        epoch=epoch,
        clock=None if clock is None else RateCorrection(relative=clock[0], sd=clock[1]),
    )


def lengths(pieces):
    return [len(piece.record.samples) for piece in pieces]


def test_blocks_that_follow_each_other_are_one_record():
    blocks = [
        block(0),
        block(100),
        block(250),
        block(350, epoch=1),
        block(450, channels=("a",)),
    ]
    assert lengths(pieces_of(blocks)) == [200, 100, 100, 100]
    assert [piece.epoch for piece in pieces_of(blocks)] == [None, None, 1, None]
    assert pieces_of([]) == []


def test_a_span_cuts_records_to_the_sample():
    pieces = pieces_of([block(0, 300), block(400, 300)])
    cut = within(pieces, SECOND, 5 * SECOND)
    assert lengths(cut) == [200, 100]
    assert [piece.record.start_ns for piece in cut] == [SECOND, 4 * SECOND]
    assert lengths(within(pieces, None, None)) == [300, 300]
    assert within(pieces, 100 * SECOND, None) == []


def test_pieces_have_the_measured_rate_of_their_device():
    vague, known = (0.0, 0.01), (0.03, 1e-5)
    pieces = pieces_of([block(0, 300, clock=vague), block(400, 412, clock=known)])
    assert [piece.record.rate_hz for piece in pieces] == [103.0, 103.0]
    assert all("nominal rate is 100 Hz" in piece.record.notes[0] for piece in pieces)
    cut = within(pieces, round(400 / 103 * SECOND) + SECOND, None)
    assert lengths(cut) == [309]
    assert cut[0].seconds == pytest.approx(3.0)
    assert cut[0].record.notes == pieces[1].record.notes


def test_pieces_whose_clocks_contradict_each_other_have_rates_of_their_own():
    pieces = pieces_of([block(0, clock=(0.01, 1e-5)), block(200, clock=(0.03, 1e-5))])
    assert [piece.record.rate_hz for piece in pieces] == [101.0, 103.0]


def test_samples_are_counted_in_true_seconds():
    blocks = [block(103 * i, 103, clock=(0.03, 1e-5)) for i in range(10)]
    assert len(list(bounded(blocks, 10**6, 10.0))) == 10


@pytest.mark.parametrize(
    ("seconds", "learnt", "judged"),
    [(3.0, [300], [300]), (1.0, [300, 200], [100]), (4.5, [150], [150, 300])],
)
def test_the_last_seconds_are_held_back(seconds, learnt, judged):
    kept, held = held_back(pieces_of([block(0, 300), block(400, 300)]), seconds)
    assert (lengths(kept), lengths(held)) == (learnt, judged)


def test_holding_all_back_is_refused():
    with pytest.raises(NoSamplesError, match=r"leaves nothing for fitting: there are 3.0 s"):
        held_back(pieces_of([block(0, 300)]), 3.0)


@pytest.fixture
def recording(tmp_path):
    """Three epochs of a rig, and one of somebody else."""
    path = tmp_path / "monday.mcap"
    with RecordingWriter(path) as writer:
        for asset, epoch in (("rig", 0), ("wing", 0), ("rig", 1), ("rig", 2)):
            header = RawHeader(
                site="lab", asset=asset, boot="b1", sequence=epoch, t_ns=10 * epoch * SECOND,
                time_base="simulated", rate_hz=RATE, first_index=600 * epoch, dtype="<f8",
                samples=600, channels=("a", "u"), units=("m/s^2", "N"), epoch=epoch,
            )  # fmt: skip
            payload = encode_raw(header, np.zeros((600, 2)).tobytes())
            writer.write(RAW, "lab", asset, payload, header.t_ns)
    return path


def parts(recording, **more):
    limits = {key: more.pop(key) for key in ("max_seconds", "max_samples") if key in more}
    order = DiagnosisOrder(**{"recordings": {}, **more})
    return _pieces(
        Task(site="lab", asset="rig", order=order, recordings=(recording,), **limits)
    )


def test_a_recording_is_read_by_asset_and_span(recording):
    learnt, judged = parts(recording)
    assert [(p.epoch, len(p.record.samples)) for p in learnt] == [(0, 600), (1, 600), (2, 600)]
    assert judged == []
    span = {"recordings": {"start": 10 * SECOND, "end": 23 * SECOND}}
    learnt, judged = parts(recording, **span, holdout_s=1.0)
    assert lengths(learnt) == [600, 200]
    assert lengths(judged) == [100]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"recordings": {"start": 99 * SECOND}}, r"no raw samples of lab.rig.*monday.mcap"),
        ({"recordings": {"end": SECOND // 10}}, r"No 64 consecutive samples.*at most 10"),
        ({"max_seconds": 10.0}, r"More than 20,000,000 numbers, or 10 s"),
        ({"max_samples": 2_000}, r"More than 2,000 numbers"),
    ],
)
def test_what_cannot_be_read_says_why(recording, more, says):
    with pytest.raises(ValueError, match=says):
        parts(recording, **more)
