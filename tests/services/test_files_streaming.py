"""A long file read piece by piece means what it means when it is read whole."""

import numpy as np
import pytest

from slowtime_services.files import RecordError, open_record, read_record

RATE = 100.0
SAMPLES = np.random.default_rng(1).standard_normal((5000, 3)).round(6)
PIECE = 20_000


def gathered(path, **given):
    """Blocks of a stream, with NaN where samples are missing."""
    with open_record(path, piece_bytes=PIECE, **given) as opened:
        blocks = [block for block, _ in opened.blocks]
        shares = []
        whole = np.full((blocks[-1].next_index, len(opened.head.channels)), np.nan)
        for block in blocks:
            whole[block.first_index : block.next_index] = block.samples
        with open_record(path, piece_bytes=PIECE, **given) as again:
            shares = [share for _, share in again.blocks]
    return opened.head, whole, shares


def text(path, rows, delimiter=","):
    lines = [delimiter.join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([delimiter.join(("time", "ax", "ay", "az")), *lines]) + "\n")


def with_time(samples, seconds):
    return np.column_stack([seconds, samples])


@pytest.mark.parametrize("turned", [False, True])
def test_an_array_is_mapped_and_read_whichever_way_it_lies(tmp_path, turned):
    path = tmp_path / "long.npy"
    np.save(path, SAMPLES.T if turned else SAMPLES)
    head, whole, shares = gathered(path, rate_hz=RATE)
    np.testing.assert_array_equal(whole, SAMPLES)
    assert len(head.samples) < len(SAMPLES)
    assert head.channels == read_record(path, rate_hz=RATE).channels
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(set(shares)) > 3


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_text_keeps_its_heading_its_clock_and_its_channels(tmp_path, delimiter):
    path = tmp_path / "long.csv"
    text(path, with_time(SAMPLES, np.arange(5000) / RATE), delimiter)
    head, whole, shares = gathered(path)
    np.testing.assert_allclose(whole, SAMPLES)
    assert head.channels == ("ax", "ay", "az")
    assert head.rate_hz == pytest.approx(RATE)
    assert len(set(shares)) > 3


def test_a_channel_that_is_quiet_at_times_stays_a_channel(tmp_path):
    quiet = SAMPLES.copy()
    quiet[2000:4000, 1] = 0.0
    path = tmp_path / "long.csv"
    text(path, with_time(quiet, np.arange(5000) / RATE))
    head, whole, _ = gathered(path)
    assert head.channels == ("ax", "ay", "az")
    np.testing.assert_allclose(whole, quiet)


def test_samples_missing_within_a_piece_are_missing(tmp_path):
    kept = np.r_[0:1000, 1200:5000]
    path = tmp_path / "long.csv"
    text(path, with_time(SAMPLES[kept], kept / RATE))
    _, whole, _ = gathered(path)
    assert np.isnan(whole[1000:1200]).all()
    np.testing.assert_allclose(whole[kept], SAMPLES[kept])


def test_a_table_is_read_by_its_batches(tmp_path):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "long.parquet"
    names = ("ax", "ay", "az")
    table = pa.table(dict(zip(names, SAMPLES.T, strict=True)))
    pq.write_table(table, path, row_group_size=2000)
    head, whole, _ = gathered(path, rate_hz=RATE)
    assert head.channels == names
    np.testing.assert_array_equal(whole, SAMPLES)


def test_a_rate_that_changes_on_the_way_is_refused_with_the_row(tmp_path):
    path = tmp_path / "long.csv"
    seconds = np.r_[np.arange(2500) / RATE, 25.0 + np.arange(2500) / 50.0]
    text(path, with_time(SAMPLES, seconds))
    with (
        pytest.raises(RecordError, match=r"sampled at 100 Hz at first.*Cut it there|uneven|Hz"),
        open_record(path, piece_bytes=PIECE) as opened,
    ):
        list(opened.blocks)


def test_a_kind_that_is_only_read_whole_is_refused_with_those_that_are_not(tmp_path):
    path = tmp_path / "long.mat"
    path.write_bytes(b"")
    with (
        pytest.raises(RecordError, match=r"only read whole.*\.npy, \.parquet"),
        open_record(path),
    ):
        pass
