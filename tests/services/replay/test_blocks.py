"""Recorded samples come back as the blocks they were."""

import itertools

import numpy as np
import pytest

from slowtime_schemas.raw import ClockCorrection, RawHeader, encode_raw
from slowtime_schemas.streams import FEATURES, RAW
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import RecordingError, block_of, raw_blocks, record_of

SAMPLES = np.random.default_rng(1).normal(size=(1000, 3)).astype("<f4")


def payload(
    first,
    last,
    *,
    asset="beam",
    rate_hz=100.0,
    epoch=None,
    channels=("x", "y", "z"),
    clock=None,
):
    samples = SAMPLES[first:last]
    header = RawHeader(
        site="lab",
        asset=asset,
        boot="b",
        sequence=first,
        t_ns=10**9 + round(first * 1e9 / rate_hz),
        rate_hz=rate_hz,
        first_index=first,
        dtype="<f4",
        samples=len(samples),
        channels=channels,
        units=("g", "g", "mm"),
        epoch=epoch,
        slow_time=None if epoch is None else float(epoch),
        covariates={"temperature_c": 4.5},
        truth={"stiffness_change": -0.1},
        clock=None if clock is None else ClockCorrection(relative=clock[0], sd=clock[1]),
    )
    return encode_raw(header, samples.tobytes())


def record(path, payloads):
    with RecordingWriter(path) as writer:
        for i, one in enumerate(payloads):
            header, _ = block_of(one)
            writer.write(RAW, header.site, header.asset, one, i)
    return path


def test_a_block_comes_back_with_everything_it_had():
    header, block = block_of(payload(100, 200, epoch=7))
    np.testing.assert_array_equal(block.samples, SAMPLES[100:200])
    assert block.samples.dtype == np.dtype("<f4")
    assert (block.rate_hz, block.first_index, block.epoch, block.slow_time) == (
        100,
        100,
        7,
        7.0,
    )
    assert block.start_ns == header.t_ns == 2 * 10**9
    assert (block.channels, block.units) == (("x", "y", "z"), ("g", "g", "mm"))
    assert block.covariates == {"temperature_c": 4.5}
    assert block.truth == {"stiffness_change": -0.1}
    assert not block.samples.flags.writeable


def test_blocks_of_one_asset_come_in_order(tmp_path):
    cuts = [(0, 300), (300, 301), (301, 1000)]
    path = record(
        tmp_path / "a.mcap",
        [payload(*cut, asset=asset) for cut in cuts for asset in ("beam", "fan")],
    )
    blocks = [block for _, block in raw_blocks(path, site="lab", asset="fan")]
    np.testing.assert_array_equal(np.concatenate([b.samples for b in blocks]), SAMPLES)
    assert all(later.follows(earlier) for earlier, later in itertools.pairwise(blocks))
    assert len(list(raw_blocks(path))) == 6


def test_a_record_joins_the_blocks_and_states_the_gaps(tmp_path):
    path = record(tmp_path / "a.mcap", [payload(0, 100), payload(100, 150), payload(400, 1000)])
    joined = record_of(path)
    np.testing.assert_array_equal(joined.samples, np.delete(SAMPLES, slice(150, 400), axis=0))
    assert [(gap.row, gap.missing) for gap in joined.gaps] == [(150, 250)]
    assert (joined.rate_hz, joined.start_ns, joined.duration_s) == (100.0, 10**9, 10.0)
    chosen = record_of(path, channels=("z", "0"))
    assert (chosen.channels, chosen.units) == (("z", "x"), ("mm", "g"))
    np.testing.assert_array_equal(chosen.samples, joined.samples[:, [2, 0]])


def test_a_record_has_the_rate_that_its_clock_was_measured_at(tmp_path):
    clocks = [(0.0, 0.01), (0.02, 0.005), (0.03, 1e-5), (0.03, 1e-5)]
    path = record(
        tmp_path / "a.mcap",
        [payload(250 * i, 250 * (i + 1), clock=clock) for i, clock in enumerate(clocks)],
    )
    for joined in (record_of(path), record_of(path, channels=("x",))):
        assert joined.rate_hz == pytest.approx(103.0, rel=1e-12)
        assert joined.notes == (
            "Sampled at 103 Hz, as measured with a standard deviation of 0.001 Hz; the nominal "
            "rate is 100 Hz.",
        )


def test_a_record_whose_clock_has_changed_has_the_mean_rate_and_a_note(tmp_path):
    clocks = [(0.0, 0.01), (0.01, 1e-5), (0.03, 1e-5), (0.03, 1e-5)]
    path = record(
        tmp_path / "a.mcap",
        [payload(250 * i, 250 * (i + 1), clock=clock) for i, clock in enumerate(clocks)],
    )
    joined = record_of(path)
    assert joined.rate_hz == pytest.approx(100 * (1 + 0.07 / 3), rel=1e-6)
    assert "between 101 and 103 Hz" in joined.notes[0]
    assert "the mean is used" in joined.notes[0]


@pytest.mark.parametrize("clock", [None, (0.0, 0.0)])
def test_a_record_of_the_nominal_rate_says_nothing_of_it(tmp_path, clock):
    joined = record_of(record(tmp_path / "a.mcap", [payload(0, 1000, clock=clock)]))
    assert (joined.rate_hz, joined.notes) == (100.0, ())


@pytest.mark.parametrize(
    ("payloads", "text"),
    [
        ([payload(0, 9), payload(0, 9, asset="fan")], "samples of 2 assets.*recording of one"),
        ([payload(0, 9), payload(9, 20, rate_hz=50.0)], "rate or channels change within it"),
        ([payload(0, 9), payload(5, 20)], "begins at sample 5, before.*ends \\(9\\)"),
        ([payload(0, 9), payload(9, 20, channels=("a", "b", "c"))], "rate or channels change"),
    ],
)
def test_blocks_that_are_no_one_record_are_refused(tmp_path, payloads, text):
    with pytest.raises(RecordingError, match=text):
        record_of(record(tmp_path / "a.mcap", payloads))


def test_a_recording_without_samples_names_those_it_has(tmp_path):
    path = record(tmp_path / "a.mcap", [payload(0, 9)])
    with pytest.raises(
        RecordingError, match=r"no samples of lab, fan. It has .*lab/raw/174/beam"
    ):
        raw_blocks(path, site="lab", asset="fan")
    with RecordingWriter(tmp_path / "b.mcap") as writer:
        writer.write(FEATURES, "lab", "beam", b"{}", 1)
    with pytest.raises(RecordingError, match="samples of: nobody"):
        record_of(tmp_path / "b.mcap")


def test_a_block_that_cannot_be_read_is_named_with_its_file(tmp_path):
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.write(RAW, "lab", "beam", payload(0, 9)[:-1], 1)
    with pytest.raises(RecordingError, match=r"a\.mcap.*promises 108 bytes"):
        list(raw_blocks(tmp_path / "a.mcap"))
