"""Every kind of file and of flag by which `identify` and `import` are told of a record."""

import os
import pickle
import re
import zipfile
from typing import get_args

import h5py
import numpy as np
import pytest
import scipy.io
from mcap.reader import make_reader

from slowtime_services.files import UNITS
from slowtime_services.files.reading_options import TimeUnit

RATE = ("--rate-hz", "100")


@pytest.fixture
def read(run):
    """Run `identify` in a quick way and give what it says of the record, and on stderr."""

    def command(*arguments):
        done = run("identify", *arguments, "--method", "peak", "--out", "-")
        assert done.status == 0, done.err
        return done.json, done.err

    return command


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "|"])
@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize("timed", [True, False])
def test_text_of_any_delimiter_with_or_without_header_or_clock(
    read, text, lines, delimiter, header, timed
):
    rows = [line.split(",")[0 if timed else 1 :] for line in lines[0 if header else 1 :]]
    path = text([delimiter.join(row) for row in rows], "record.txt")
    found, _ = read(path, *(() if timed else RATE))
    first = 1 if timed else 0
    named = ["acc_x", "acc_y"] if header else [f"channel_{first}", f"channel_{first + 1}"]
    assert (found["rate_hz"], found["channels"]) == (100.0, named)
    assert found["duration_s"] == 60.0
    assert found["modes"][0]["frequency_hz"]["value"] == pytest.approx(3.0, abs=0.1)


def test_text_with_a_decimal_comma(read, text, lines):
    found, _ = read(text([line.replace(",", ";").replace(".", ",") for line in lines]))
    assert (found["rate_hz"], found["channels"]) == (100.0, ["acc_x", "acc_y"])


def test_numpy_and_matlab_files_say_the_same_as_text(read, record, samples, clock, tmp_path):
    expected = read(record)[0]["modes"]
    columns = {"t": clock, "acc_x": samples[:, 0], "acc_y": samples[:, 1]}
    np.save(tmp_path / "a.npy", samples)
    np.save(tmp_path / "turned.npy", samples.T)
    np.savez(tmp_path / "a.npz", **columns)
    np.savez(tmp_path / "rate.npz", acc=samples, fs=100.0)
    scipy.io.savemat(tmp_path / "v5.mat", columns)
    with h5py.File(tmp_path / "v73.mat", "w", userblock_size=512) as file:
        for name, values in columns.items():
            dataset = file.create_dataset(name, data=values[None, :])
            dataset.attrs["MATLAB_class"] = np.bytes_("double")
    for name in ("a.npy", "turned.npy", "a.npz", "rate.npz", "v5.mat", "v73.mat"):
        found, _ = read(name, *(RATE if name.endswith(".npy") else ()))
        assert (found["rate_hz"], found["duration_s"]) == (100.0, 60.0), name
        for mode, other in zip(found["modes"], expected, strict=True):
            value = mode["frequency_hz"]["value"]
            assert value == pytest.approx(other["frequency_hz"]["value"], rel=1e-6), name


def test_flags_say_what_the_file_does_not(read, text, lines):
    rows = ["logged by hand", "on a Sunday", *lines[1:]]
    found, _ = read(text(rows), "--reading", "skip_lines=2",
                    "--reading", "columns=when,north,east", "--reading", "time_column=when",
                    "--channels", "east")  # fmt: skip
    assert (found["rate_hz"], found["channels"]) == (100.0, ["east"])
    found, _ = read("record.csv", "--channels", "2,1")
    assert found["channels"] == ["channel_2", "channel_1"]
    found, _ = read("record.csv", "--reading", "time_column=none", *RATE)
    assert found["channels"] == ["channel_0", "channel_1", "channel_2"]


def test_a_given_rate_is_used_and_the_contradiction_told(read, record, run):
    assert run("import", record, "--out", "record.mcap").status == 0
    for name in ("record.csv", "record.mcap"):
        found, said = read(name, "--rate-hz", 50)
        assert found["rate_hz"] == 50.0
        assert "100 Hz; 50 Hz was given and is used." in said
        assert "was given" not in read(name, "--rate-hz", 100)[1]


def test_flags_for_text_that_say_nothing_of_a_recording_are_told_so(read, record, run, refused):
    assert run("import", record, "--out", "record.mcap").status == 0
    found, said = read("record.mcap", "--reading", "skip_lines=3", "--reading", "time_column=t")
    assert found["channels"] == ["acc_x", "acc_y"]
    assert "--reading skip_lines was not used" in said
    assert "--reading time_column was not used" in said
    found, _ = read("record.mcap", "--reading", "columns=north,east", "--channels", "east")
    assert found["channels"] == ["east"]
    assert "has 2 channels, acc_x, acc_y" in refused(
        "identify", "record.mcap", "--reading", "columns=a"
    )
    assert "names one twice" in refused("identify", "record.mcap", "--channels", "acc_x,acc_x")


def test_quiet_leaves_the_notes_out(run, record):
    done = run("-q", "identify", record, "--rate-hz", 50, "--method", "peak")
    assert (done.status, done.err) == (0, "")


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--channels", "nope"), r"No column is called 'nope'\. There are: .*'acc_y'"),
        (("--channels", "7"), r"No column is called '7'"),
        (("--channels", ","), r"'--channels': ',' has an empty name between two commas"),
        (("--channels", "acc_x,acc_x"), r"A channel was named twice"),
        (("--channels", "time"), r"'time' is the clock of the record, not a channel"),
        (("--reading", "columns=a,b"), r"2 column names were given, a, b, for 3 columns"),
        (("--reading", "time_column=nope"), r"No column is called 'nope'"),
        (
            ("--reading", "time_column=acc_x"),
            r"Time does not run forwards at line 4: column 'acc_x'",
        ),
        (
            ("--reading", "time_column=none"),
            r"does not say how often it was sampled.*--rate-hz",
        ),
        (
            ("--reading", "skip_lines=100000"),
            r"6001 lines, fewer than skip_lines=100000\. Lower",
        ),
        (("--reading", "skip_lines=-1"), r"-1 is not in the range"),
        (("--rate-hz", "0"), r"0\.0 is not in the range"),
        (("--rate-hz", "nan"), r"nan is not a finite number"),
        (("--rate-hz", "1e308"), r"1e\+308 is not a sampling rate\. Give .* from 1e-06 to"),
        (("--rate-hz", "fast"), r"'fast' is not a valid"),
    ],
)
def test_a_flag_that_does_not_fit_the_record_is_refused(refused, record, flags, says):
    said = refused("identify", record, *flags)
    assert re.search(says, said), said


def replaced(lines, row, line):
    return [*lines[:row], line, *lines[row + 1 :]]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("0.49,0.1,-inf", "Line 51, field 3 is '-inf': not a finite number. Cut the record"),
        ("0.49,abc,0.1", "Line 51 has 'abc' where a number should be. Correct or remove"),
        (
            "0.49,0.1",
            "Line 51 has 2 fields, the lines before it 3. Correct or remove that line",
        ),
        ("0.48,0.1,0.1", "Time does not run forwards at line 51: column 'time' goes from 0.48"),
        ("0.47,0.1,0.1", "Time does not run forwards at line 51: column 'time' goes from 0.48"),
        (
            "0.49," + "1" * 400_000 + ",0.1",
            "Line 51 has '1111111111111111111111111111111111111111' where",
        ),
    ],
)
@pytest.mark.parametrize("verb", ["identify", "import"])
def test_one_bad_line_is_named_and_nothing_is_written(
    refused, text, lines, tmp_path, verb, line, says
):
    path = text(replaced(lines, 50, line))
    said = refused(verb, path, "--out", tmp_path / "out.mcap")
    assert says in said
    assert len(said) < 500
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("word", ["", "nan", "NA", "#N/A", "--", "null"])
def test_a_row_in_which_a_value_is_missing_is_a_gap(read, text, lines, word):
    found, said = read(text(replaced(lines, 4000, f"39.99,{word},0.1")))
    assert "1 rows in which a value is missing were left out" in said
    assert "1 sample is missing in 1 gap, before row 3999" in said
    assert (found["rate_hz"], found["duration_s"]) == (100.0, 60.0)


def test_short_regular_losses_are_bridged_and_marked(read, text, lines):
    kept = [line for row, line in enumerate(lines[1:]) if row % 60 not in (30, 31)]
    whole, _ = read(text(lines))
    path = text([lines[0], *kept])
    _, said = read(path)
    assert "200 samples are missing in 100 gaps (3.3 %). All others are used" in said
    found, said = read(path, "--gaps", "fill")
    assert "200 samples in 100 short losses (3.3 %) were estimated from their neigh" in said
    assert (found["duration_s"], found["rate_hz"]) == (60.0, 100.0)
    for mode, right in zip(found["modes"], whole["modes"], strict=True):
        assert "bridged" in mode["flags"]
        right_hz = right["frequency_hz"]
        assert abs(mode["frequency_hz"]["value"] - right_hz["value"]) < 3 * right_hz["sd"]


def test_losses_of_white_noise_are_not_bridged(read, text, lines):
    noise = np.random.default_rng(1).standard_normal((6000, 2))
    rows = [f"{i / 100:.2f},{a:.4f},{b:.4f}" for i, (a, b) in enumerate(noise)]
    kept = [line for row, line in enumerate(rows) if row % 60 < 56 or row < 900]
    _, said = read(text([lines[0], *kept]), "--gaps", "fill")
    assert "were not bridged: they are too far from what their neighbours tell" in said
    assert "only the longest part without a gap is used" in said


def test_what_was_assumed_stands_in_the_recording(run, text, lines):
    path = text([f"{line},{'count' if row == 0 else row}" for row, line in enumerate(lines)])
    done = run("import", path, "--out", "a.mcap")
    assert "set aside ('count': a counter), --reading keep=NAME keeps them" in done.err
    with open("a.mcap", "rb") as file:
        said = {r.name: r.metadata for r in make_reader(file).iter_metadata()}["slowtime"]
    assert "'count': a counter" in said["assumptions"]
    assert said["imported_from"] == "record.csv"


def test_a_gap_in_the_clock_is_told_and_only_whole_parts_are_used(read, text, lines, run):
    path = text(lines[:1000] + lines[1500:])
    found, said = read(path, "--gaps", "split")
    assert "500 samples are missing in 1 gap, before row 999." in said
    assert "only the longest part without a gap is used, 45.010 s" in said
    assert found["duration_s"] == 60.0
    flags = ("--gaps", "split", "--window-s", 9, "--hop-s", 9, "--out", "-")
    epochs = run("identify", path, *flags).json["epochs"]
    assert [epoch["start_s"] for epoch in epochs] == pytest.approx([0, 14.99, 23.99, 32.99,
                                                                    41.99, 50.99])  # fmt: skip


def test_a_clock_with_holes_everywhere_is_refused(refused, text, lines):
    kept = np.random.default_rng(0).random(len(lines)) > 0.5
    path = text(lines[:1] + [line for line, keep in zip(lines[1:], kept, strict=False) if keep])
    said = refused("identify", path)
    assert "too uneven for one sampling rate" in said
    assert "Resample the record, or give --rate-hz" in said


@pytest.mark.parametrize("suffix", ["csv", "npy", "npz", "mat", "mcap"])
@pytest.mark.parametrize("content", ["empty", "garbage"])
def test_an_empty_file_and_binary_garbage_are_refused(refused, tmp_path, suffix, content):
    path = tmp_path / f"record.{suffix}"
    noise = np.random.default_rng(0).bytes(20_000)
    path.write_bytes(noise if content == "garbage" else b"")
    said = refused("identify", path, *RATE)
    assert path.name in said
    assert re.search("Give|Allowed|It may be cut short", said), said


def test_what_is_no_text_at_all_is_refused(refused, tmp_path):
    path = tmp_path / "record.csv"
    path.write_bytes(b"\xff\xfe\x00")
    assert "begins as UTF-16 text and is none" in refused("identify", path)
    letters = np.random.default_rng(0).integers(0x80, 0x100, 20_000, dtype=np.uint8)
    path.write_bytes(letters.tobytes())
    assert "No row of numbers in the first 400 lines" in refused("identify", path)


def test_a_file_cut_in_half_is_refused(refused, run, record, samples, clock, tmp_path):
    np.save(tmp_path / "a.npy", samples)
    np.savez(tmp_path / "a.npz", t=clock, acc=samples)
    scipy.io.savemat(tmp_path / "a.mat", {"t": clock, "acc": samples})
    with h5py.File(tmp_path / "b.mat", "w") as file:
        file["acc"] = samples
    assert run("import", record, "--out", "a.mcap").status == 0
    for name in ("a.npy", "a.npz", "a.mat", "b.mat", "a.mcap"):
        whole = (tmp_path / name).read_bytes()
        path = tmp_path / f"cut-{name}"
        path.write_bytes(whole[: len(whole) // 2])
        said = refused("identify", path, *RATE)
        assert "may be cut short" in said or "Run `slowtime mcap recover" in said, said


def test_a_byte_that_has_changed_in_a_recording_is_noticed(refused, run, record, tmp_path):
    assert run("import", record, "--out", "a.mcap").status == 0
    whole = bytearray((tmp_path / "a.mcap").read_bytes())
    whole[whole.index(b"zstd") + 200] ^= 0xFF  # within the first chunk
    (tmp_path / "a.mcap").write_bytes(whole)
    said = refused("identify", "a.mcap")
    assert re.search("is damaged: (crc validation failed|zstd decompress error)", said)
    assert "Run `slowtime mcap recover" in said


def test_what_is_no_file_is_refused(refused, tmp_path):
    assert "File 'missing.csv' does not exist" in refused("identify", "missing.csv")
    assert "is a directory" in refused("identify", tmp_path)
    assert "Missing argument 'RECORD'" in refused("identify")


class Evil:
    def __reduce__(self):
        return os.mkdir, ("owned",)


@pytest.mark.parametrize("name", ["evil.npy", "evil.npz", "raw.npy"])
def test_a_pickle_is_refused_and_never_run(refused, tmp_path, name):
    if name == "raw.npy":
        (tmp_path / name).write_bytes(pickle.dumps(Evil()))
    else:
        save = np.save if name.endswith("npy") else np.savez
        save(tmp_path / name, np.array([Evil()], dtype=object), allow_pickle=True)
    said = refused("identify", name, *RATE)
    assert "holds Python objects (a pickle), which can run code when opened" in said
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize(
    ("array", "says"),
    [
        (np.zeros((5, 6, 7)), "holds no series of real numbers, but: data (5, 6, 7) float64"),
        (np.zeros(100, complex), "holds no series of real numbers, but: data (100,) complex"),
        (np.array(["a", "b"]), "holds no series of real numbers, but: data (2,) <U1"),
        (np.array(3.0), "holds no series of real numbers, but: data () float64"),
        (np.zeros((0, 3)), "holds no series of real numbers, but: data (0, 3) float64"),
        (np.append(np.arange(99.0), np.inf), "1 values are not finite, the first in row 99"),
        (np.ones(100), "is constant over 100 samples. Check the sensor, its cable"),
        (np.arange(11.0) ** 2, "11 samples were given, at least 32 are needed. Give a longer"),
    ],
)
def test_an_array_of_the_wrong_kind_says_what_it_is(refused, tmp_path, array, says):
    np.save(tmp_path / "a.npy", array)
    assert says in refused("identify", "a.npy", *RATE)


def test_archives_without_a_series_are_refused(refused, tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("readme.txt", "no array")
        archive.writestr("bad.npy", bytes(1000))
    scipy.io.savemat(tmp_path / "a.mat", {"name": "text only"})
    for name in ("a.npz", "a.mat"):
        assert "holds no series of real numbers" in refused("identify", name, *RATE)


def test_arrays_of_another_length_are_told_as_left_out(read, samples, tmp_path):
    np.savez(tmp_path / "a.npz", acc=samples, slow=np.arange(60.0), fs=100.0)
    found, said = read("a.npz")
    assert found["channels"] == ["acc_0", "acc_1"]
    assert "Left out, not being of length 6000: slow." in said


def test_a_dead_channel_is_told_and_a_dead_record_refused(read, refused, text, lines):
    path = text([f"{line.rpartition(',')[0]},1.5" for line in lines[1:]])
    found, said = read(path)
    assert "set aside ('channel_2': never changes, check the sensor)" in said
    assert found["modes"]
    assert found["channels"] == ["channel_1"]
    assert found["assumptions"][-1].startswith("set aside ('channel_2'")
    text([f"{line.partition(',')[0]},1.5" for line in lines[1:]])
    assert "is constant over 6000 samples" in refused("identify", path)


def test_a_record_too_short_or_without_rows_is_refused(refused, text, lines):
    for rows, says in [
        (lines[:12], "11 samples were given, at least 32 are needed. Give a longer record"),
        (lines[:2], "has a single row. Give a record of at least two."),
        (lines[:1], "No row of numbers in the first 400 lines"),
        (["", "", ""], "is empty. Give a file with at least two rows"),
    ]:
        assert says in refused("identify", text(rows))


def test_header_lines_of_any_size_are_read_over(read, refused, text, lines):
    for header in ("x" * 2_000_000, "# " + "a," * 500_000):
        found, _ = read(text([header, *lines]))
        assert found["channels"] == ["acc_x", "acc_y"]
    path = text(["# a note"] * 1000 + lines)
    assert "lines before the numbers with --reading skip_lines" in refused("identify", path)
    assert read(path, "--reading", "skip_lines=1000")[0]["channels"] == ["acc_x", "acc_y"]


@pytest.mark.data
def test_other_peoples_mcap_says_what_is_in_it(refused, data):
    for path in sorted((data / "foreign_mcap").glob("*.mcap")):
        said = refused("identify", path)
        assert "has no vibration in it: topics found:" in said or "is damaged" in said


def test_the_units_of_the_time_flag_are_those_that_files_know():
    assert set(get_args(TimeUnit)) == set(UNITS)
