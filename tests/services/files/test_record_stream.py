"""A long file read piece by piece means what it means when it is read whole."""

import struct
import wave

import numpy as np
import pytest
from scipy.io import wavfile

from slowtime_services.files import RecordError, open_record, read_record
from tests.fuzz.reader_server import children

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


@pytest.fixture
def forked():
    """Readers in children of one process: each piece would import its library anew."""
    with children():
        yield


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(
    "kind",
    [
        "24 bits",
        *(pytest.param(k, marks=pytest.mark.long) for k in ("int16", "float32", "big-endian")),
    ],
)
def test_a_wav_file_is_read_by_its_frames(tmp_path, kind):
    path, whole_path = tmp_path / "long.wav", tmp_path / "whole.wav"
    steps = (1000 * np.tile(SAMPLES[:, :2], (3, 1))).astype(np.int32)
    if kind == "24 bits":
        body = steps.astype("<i4").view(np.uint8).reshape(*steps.shape, 4)[..., :3].tobytes()
        with wave.open(str(path), "wb") as file:
            file.setparams((2, 3, 8000, len(steps), "NONE", ""))
            file.writeframes(body)
    else:
        wavfile.write(path, 8000, steps.astype("int16" if kind == "big-endian" else kind))
    if kind == "big-endian":
        found = bytearray(path.read_bytes())
        pcm = np.frombuffer(bytes(found[44:]), "<i2").astype(">i2").tobytes()
        head = struct.pack(">4sI4s4sIHHIIHH4sI", b"RIFX", 36 + len(pcm), b"WAVE", b"fmt ", 16,
                           1, 2, 8000, 32000, 4, 16, b"data", len(pcm))  # fmt: skip
        path.write_bytes(head + pcm)
    whole_path.write_bytes(path.read_bytes())
    head, whole, shares = gathered(path)
    read = read_record(whole_path)
    assert (head.channels, head.rate_hz, head.units) == (read.channels, 8000.0, read.units)
    np.testing.assert_array_equal(whole, read.samples)
    assert len(head.samples) < len(steps)
    assert shares[-1] == 1.0


def test_a_wav_file_that_was_cut_short_or_compressed_is_refused(tmp_path):
    path = tmp_path / "long.wav"
    wavfile.write(path, 8000, SAMPLES.astype("float32"))
    good = path.read_bytes()
    for bad, says in [(good[:-10], "was cut short"), (good[:20] + b"\x11" + good[21:], "PCM")]:
        path.write_bytes(bad)
        with pytest.raises(RecordError, match=says), open_record(path):
            pass


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(
    "layout",
    ["turned", *(pytest.param(k, marks=pytest.mark.long) for k in ("channels", "table"))],
)
def test_an_hdf5_file_is_read_by_slices_with_its_attributes(tmp_path, layout):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "long.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("run/acceleration")
        group.attrs["fs"] = RATE
        file["temperature"] = 11.5
        file["calibration"] = np.arange(7.0)
        if layout == "channels":
            for i in range(3):
                made = group.create_dataset(f"a{i}", data=SAMPLES[:, i], chunks=(512,))
                made.attrs["units"] = "mg"
        else:
            made = group.create_dataset("a", data=SAMPLES.T if layout == "turned" else SAMPLES)
            made.attrs["units"] = "mg"
            made.attrs["channels"] = ["x", "y", "z"]
    head, whole, shares = gathered(path)
    read = read_record(path)
    assert (head.channels, head.rate_hz) == (read.channels, RATE)
    assert head.units == read.units == ("m/s^2",) * 3
    np.testing.assert_array_equal(whole, read.samples)
    assert len(head.samples) < len(SAMPLES)
    assert shares[-1] == 1.0


def test_an_hdf5_file_of_series_of_several_lengths_is_only_read_whole(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "long.h5"
    with h5py.File(path, "w") as file:
        file["fast"], file["half"] = SAMPLES[:, 0], SAMPLES[::2, 1]
    with (
        pytest.raises(RecordError, match=r"of other lengths: half \(2,500\)"),
        open_record(path),
    ):
        pass


def stated(path, heading, samples=SAMPLES, names="ax,ay,az\n"):
    rows = "".join(",".join(f"{value:.6f}" for value in row) + "\n" for row in samples)
    path.write_text(heading + names + rows)


def test_a_number_of_points_that_a_heading_states_is_held_against_all_rows(tmp_path):
    path = tmp_path / "long.csv"
    stated(path, "Sampling rate: 100 Hz\nNumber of points: 5000\nDuration: 50 s\n")
    head, whole, shares = gathered(path)
    np.testing.assert_allclose(whole, SAMPLES)
    assert (head.rate_hz, head.notes) == (RATE, read_record(path).notes)
    assert len(set(shares)) > 3
    for heading in ("Number of points: 6000\n", "Duration: 55 s\n"):
        stated(path, "Sampling rate: 100 Hz\n" + heading)
        with open_record(path, piece_bytes=PIECE) as opened:
            first, _ = next(opened.blocks)
            assert len(first.samples)
            with pytest.raises(RecordError, match=r"states .*; the file has 5000 rows"):
                list(opened.blocks)
        gathered(path, rate_hz=RATE)


def test_a_clock_is_believed_before_a_number_of_points_and_that_is_noted(tmp_path):
    path = tmp_path / "long.csv"
    heading = "Number of points: 6000\n"
    stated(path, heading, with_time(SAMPLES, np.arange(5000) / RATE), "time,ax,ay,az\n")
    with open_record(path, piece_bytes=PIECE) as opened:
        assert opened.head.notes == ()
        assert len(list(opened.blocks)) > 3
    (note,) = opened.end_notes
    assert "'Number of points: 6000'" in note
    assert "5000 rows" in note


def test_columns_that_hold_as_many_points_as_are_stated_are_a_question(tmp_path):
    path = tmp_path / "long.txt"
    stated(path, "Sampling rate: 100 Hz\nNumber of points: 15000\n", names="")
    with (
        open_record(path, piece_bytes=PIECE) as opened,
        pytest.raises(RecordError, match=r"--reading wrapped=yes"),
    ):
        list(opened.blocks)


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
        pytest.raises(RecordError, match=r"only read whole.*\.npy, \.parquet, \.wav, \.h5"),
        open_record(path),
    ):
        pass
