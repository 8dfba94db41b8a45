"""Whatever a logger writes, the same samples come out; errors say how to mend the file."""

import sys

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime_services.files import RecordError, read_record
from slowtime_services.files.binary import reader_process

SAMPLES = np.round(np.random.default_rng(5).standard_normal((200, 2)), 6)


def write(tmp_path, text, name="record.txt", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def table(columns, delimiter=",", decimal=".", end="\n"):
    rows = (delimiter.join(f"{v:.6f}".replace(".", decimal) for v in row) for row in columns)
    return end.join(rows) + end


@settings(max_examples=60, deadline=None)
@given(
    delimiter=st.sampled_from([",", ";", "\t", " ", "   ", " ; ", "|", ", "]),
    decimal=st.sampled_from([".", ","]),
    header=st.sampled_from(["", "time{d}a{d}b", "# t{d}a{d}b", '"Time"{d}"a"{d}"b"']),
    preamble=st.sampled_from(["", "Logger 7\n\nstarted Tue, Jul 19, 2022\n", "x\t1\n\n"]),
    end=st.sampled_from(["\n", "\r\n"]),
    trailing=st.booleans(),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
)
def test_one_record_reads_the_same_however_it_is_written(
    tmp_path_factory, delimiter, decimal, header, preamble, end, trailing, encoding
):
    if decimal == "," and delimiter.strip() == ",":
        delimiter = ";"
    tail = delimiter.strip() if trailing else ""
    columns = np.column_stack([np.arange(len(SAMPLES)) / 200.0, SAMPLES])
    body = table(columns, delimiter, decimal, tail + end)
    text = preamble + (header.format(d=delimiter) + end if header else "") + body
    record = read_record(write(tmp_path_factory.mktemp("t"), text, encoding=encoding))
    np.testing.assert_allclose(record.samples, SAMPLES, atol=1e-9)
    assert record.rate_hz == 200.0
    assert record.channels == (("a", "b") if header else ("channel_1", "channel_2"))
    assert record.gaps == ()
    assert record.units == ("", "")


def test_names_and_units_are_read_from_two_lines_or_from_brackets(tmp_path):
    two = "Made by hand\nTime\tLow G\tPin\nSec\tVoltage (unscaled)\tmm\n0.0 0 0\t\t0\t\n\n"
    rows = table(np.column_stack([np.arange(50) / 10, SAMPLES[:50]]), "\t")
    record = read_record(write(tmp_path, two + rows))
    assert (record.channels, record.units) == (("Low G", "Pin"), ("Voltage (unscaled)", "m"))
    brackets = "t [ms], acc_z [m/s^2], load (kN)\n"
    rows = table(np.column_stack([np.arange(50) * 100, SAMPLES[:50]]), ",")
    record = read_record(write(tmp_path, brackets + rows))
    assert record.rate_hz == 10.0
    assert (record.channels, record.units) == (("acc_z", "load"), ("m/s^2", "kN"))


def test_a_table_without_clock_needs_a_rate_and_says_which_flag_gives_it(tmp_path):
    path = write(tmp_path, "a,b\n" + table(SAMPLES))
    with pytest.raises(RecordError, match=r"no time column .* among a, b\. Give --rate-hz"):
        read_record(path)
    record = read_record(path, rate_hz=50.0)
    assert (record.rate_hz, record.channels, record.start_ns) == (50.0, ("a", "b"), None)


def test_a_rate_stated_above_the_numbers_is_used_where_there_is_no_clock(tmp_path):
    record = read_record(write(tmp_path, "Sampling Frequency - 5000\na,b\n" + table(SAMPLES)))
    assert record.rate_hz == 5000.0


def test_a_mere_row_number_is_not_taken_for_seconds(tmp_path):
    path = write(tmp_path, table(np.column_stack([np.arange(200), SAMPLES])))
    with pytest.raises(RecordError, match="Give --rate-hz"):
        read_record(path)


@pytest.mark.parametrize(
    ("first", "scale", "kind"), [(1.7e9, 1.0, "s"), (1.7e12, 1e3, "ms"), (1.7e18, 1e9, "ns")]
)
def test_absolute_times_give_the_start_in_nanoseconds(tmp_path, first, scale, kind):
    ticks = (int(first) + np.arange(100) * scale / 4).astype(
        np.int64 if kind == "ns" else float
    )
    path = tmp_path / "record.npz"
    np.savez(path, t=ticks, a=SAMPLES[:100, 0])
    record = read_record(path)
    assert record.rate_hz == 4.0
    assert record.start_ns == 1_700_000_000_000_000_000


def test_missing_rows_are_found_counted_and_kept_out_of_every_block(tmp_path):
    clock = np.arange(200) / 50.0
    kept = np.r_[0:60, 65:120, 121:200]
    rows = np.column_stack([clock, SAMPLES])[kept]
    record = read_record(write(tmp_path, "t,a,b\n" + table(rows)))
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(60, 5), (115, 1)]
    assert "6 samples are missing in 2 gaps" in record.notes[0]
    assert record.duration_s == pytest.approx(4.0)
    seen: dict[int, float] = {}
    for block in record.blocks(0.5, start_ns=0):
        assert block.start_ns == round(block.first_index * 1e9 / 50)
        seen |= dict(enumerate(block.samples[:, 0], start=block.first_index))
    assert seen == {int(i): SAMPLES[i, 0] for i in kept}


def test_one_pause_longer_than_what_was_measured_is_one_gap(tmp_path):
    clock = np.r_[0:100, 400:500] / 50.0
    record = read_record(write(tmp_path, "t,a\n" + table(np.c_[clock, SAMPLES[:, 0]])))
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(100, 300)]
    assert record.rate_hz == pytest.approx(50.0)


def test_a_jittering_clock_is_reported_and_an_uneven_one_refused(tmp_path):
    rng = np.random.default_rng(1)
    clock = np.arange(200) / 50.0 + rng.uniform(-0.15, 0.15, 200) / 50
    record = read_record(write(tmp_path, "t,a\n" + table(np.c_[clock, SAMPLES[:, 0]])))
    assert record.rate_hz == pytest.approx(50.0, rel=1e-2)
    assert "jitters by 9 %" in record.notes[0] or "jitters by 8 %" in record.notes[0]
    clock = np.cumsum(rng.exponential(0.02, 200))
    with pytest.raises(RecordError, match=r"too uneven .* Resample the record"):
        read_record(write(tmp_path, "t,a\n" + table(np.c_[clock, SAMPLES[:, 0]])))


def test_a_clock_printed_with_few_digits_does_not_jitter_into_gaps(tmp_path):
    clock = np.arange(20_000) / 610.35
    text = "t,a\n" + "".join(f"{t:.3f},{i % 7}\n" for i, t in enumerate(clock))
    record = read_record(write(tmp_path, text))
    assert record.gaps == ()
    assert record.rate_hz == pytest.approx(610.35, rel=1e-5)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("0.03,1.0", "Line 5 has 2 fields, the lines before it 3"),
        ("0.03,1.0,2.0,3.0", "Line 5 has 4 fields, the lines before it 3"),
        ("0.03,1.0,oops", "Line 5 has 'oops' where a number should be"),
        ("0.03,1.0,nan", "Line 5, field 3 is 'nan': not a finite number"),
        ("0.03,inf,2.0", "Line 5, field 2 is 'inf': not a finite number"),
        ("0.03,,2.0", "Line 5, field 2 is '': not a finite number"),
        ("0.01,1.0,2.0", "Time does not run forwards at line 5"),
    ],
)
def test_a_bad_line_is_named_by_its_number(tmp_path, line, says):
    lines = ["t,a,b", "0.00,1,2", "0.01,1,2", "0.02,1,2", line]
    lines += [f"{t / 100:.2f},1,2" for t in range(4, 40)]
    with pytest.raises(RecordError, match=says):
        read_record(write(tmp_path, "\n".join(lines)))


def test_missing_values_are_kept_where_asked(tmp_path):
    text = "t,a,b\n0,1,2\n1,,4\n2,nan,6\n3,inf,8\n4,9,10\n"
    record = read_record(write(tmp_path, text), keep_missing=True)
    np.testing.assert_array_equal(record.samples[:, 0], [1, np.nan, np.nan, np.nan, 9])
    assert record.notes == ("3 values are missing.",)


def test_a_line_cut_short_at_the_very_end_is_left_out(tmp_path):
    record = read_record(write(tmp_path, "t,a,b\n0,1,2\n1,3,4\n2,5,6\n3,7"))
    assert len(record.samples) == 3
    assert "last line (5) is cut short" in record.notes[0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("  \n \n", "is empty"),
        ("only words\nand more\n", "No row of numbers .* --reading skip_lines"),
        ("t,a\n1,2\n", "a single row"),
        ("t\n0.0\n0.1\n0.2\n0.3\n", "no channel beside its clock"),
        ("a,b\0\n1,2\n", "not text: it holds zero bytes"),
    ],
)
def test_a_file_that_is_no_record_says_why(tmp_path, text, says):
    with pytest.raises(RecordError, match=says):
        read_record(write(tmp_path, text))


def test_columns_and_channels_are_chosen_by_name_or_number(tmp_path):
    path = write(tmp_path, table(np.column_stack([SAMPLES, np.arange(200) / 8])))
    record = read_record(path, columns=["x", "y", "clock"], time_column="clock", channels=["y"])
    assert (record.channels, record.rate_hz) == (("y",), 8.0)
    np.testing.assert_array_equal(record.samples[:, 0], SAMPLES[:, 1])
    np.testing.assert_array_equal(record.aux["x"], SAMPLES[:, 0])
    assert read_record(path, channels=["0"]).channels == ("channel_0",)
    with pytest.raises(RecordError, match=r"No column is called 'z'.*'channel_0'"):
        read_record(path, channels=["z"])
    with pytest.raises(RecordError, match=r"2 column names were given, a, b, for 3 columns"):
        read_record(path, columns=["a", "b"])


def test_a_given_rate_overrules_the_clock_and_says_so(tmp_path):
    rows = np.column_stack([np.arange(200) / 8, SAMPLES])
    record = read_record(write(tmp_path, "t,a,b\n" + table(rows)), rate_hz=16.0)
    assert record.rate_hz == 16.0
    assert "says 8 Hz; 16 Hz was given" in record.notes[0]


@pytest.mark.parametrize("dtype", ["f8", "f4", "i4", "i2"])
@pytest.mark.parametrize("turned", [False, True])
def test_numpy_arrays_keep_the_sensors_own_type_and_may_lie_either_way(tmp_path, dtype, turned):
    values = (SAMPLES * 100).astype(dtype)
    np.save(tmp_path / "a.npy", values.T if turned else values)
    record = read_record(tmp_path / "a.npy", rate_hz=10.0)
    assert record.samples.dtype == np.dtype(dtype)
    np.testing.assert_array_equal(record.samples, values)


def test_an_archive_gives_a_channel_for_each_array_and_takes_its_rate(tmp_path):
    np.savez(tmp_path / "a.npz", u=SAMPLES[:, 0], x1=SAMPLES[:, 1], rate_hz=128.0, note=3.0)
    record = read_record(tmp_path / "a.npz")
    assert (record.channels, record.rate_hz) == (("u", "x1"), 128.0)
    assert float(record.aux["note"]) == 3.0
    np.savez(tmp_path / "b.npz", t=np.arange(200) / 64, x=SAMPLES)
    record = read_record(tmp_path / "b.npz")
    assert (record.channels, record.rate_hz) == (("x_0", "x_1"), 64.0)


def test_pickled_objects_are_never_opened(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "b.npz", allow_pickle=True, x=np.array([print], dtype=object))
    for name in ("a.npy", "b.npz"):
        with pytest.raises(RecordError, match=r"holds Python objects .* never read"):
            read_record(tmp_path / name, rate_hz=1.0)


@pytest.mark.long
def test_matlab_of_both_versions_says_the_same(tmp_path):
    clock = np.arange(200)[:, None] / 256
    scipy.io.savemat(tmp_path / "v5.mat", {"t": clock, "a": SAMPLES[:, :1], "gain": 2.0})
    with h5py.File(tmp_path / "v73.mat", "w", userblock_size=512) as file:
        for name, value in {"t": clock, "a": SAMPLES[:, :1], "gain": np.array([[2.0]])}.items():
            file.create_dataset(name, data=value.T).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("label", data=np.array([[65]], "u2")).attrs["MATLAB_class"] = (
            np.bytes_("char")
        )
        file.create_group("#refs#").create_dataset("x", data=np.zeros(9999))
    for name in ("v5.mat", "v73.mat"):
        record = read_record(tmp_path / name)
        assert (record.channels, record.rate_hz) == (("a",), 256.0)
        np.testing.assert_array_equal(record.samples[:, 0], SAMPLES[:, 0])
        assert float(record.aux["gain"]) == 2.0
        assert "label" not in record.aux


def test_a_matlab_struct_gives_its_fields(tmp_path):
    scipy.io.savemat(tmp_path / "s.mat", {"run": {"fs": 100.0, "acc": SAMPLES}})
    record = read_record(tmp_path / "s.mat")
    assert (record.channels, record.rate_hz) == (("run.acc_0", "run.acc_1"), 100.0)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".mat"])
def test_a_binary_file_cut_short_or_of_another_kind_is_refused_in_one_sentence(
    tmp_path, suffix
):
    whole = tmp_path / f"whole{suffix}"
    if suffix == ".mat":
        scipy.io.savemat(whole, {"a": SAMPLES})
    else:
        (np.save if suffix == ".npy" else np.savez)(whole, SAMPLES)
    data = whole.read_bytes()
    for content in (data[: len(data) // 2], b"time,a\n1,2\n", b""):
        path = tmp_path / f"bad{suffix}"
        path.write_bytes(content)
        with pytest.raises(RecordError, match=r"cannot be read as|holds Python objects"):
            read_record(path, rate_hz=1.0)


@pytest.mark.parametrize(
    ("end", "says"),
    [("kill -SEGV $$", "broke its reader .SIGSEGV."), ("sleep 60", "busy for")],
)
def test_a_reader_of_matlab_files_that_crashes_or_hangs_takes_nobody_with_it(
    tmp_path, monkeypatch, end, says
):
    scipy.io.savemat(tmp_path / "whole.mat", {"a": SAMPLES})
    reader = tmp_path / "python"
    reader.write_text(f"#!/bin/sh\n{end}\n")
    reader.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(reader))
    monkeypatch.setattr(reader_process, "PATIENCE_S", 0.5)
    with pytest.raises(RecordError, match=rf"whole\.mat .*{says}"):
        read_record(tmp_path / "whole.mat", rate_hz=1.0)


def test_what_would_not_fit_in_memory_is_refused_before_it_is_unpacked(tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", x=np.zeros(1_000_000), rate_hz=1.0)
    assert (tmp_path / "bomb.npz").stat().st_size < 20_000
    for path in (tmp_path / "bomb.npz", write(tmp_path, "1\n" * 40_000)):
        with pytest.raises(RecordError, match=r"at most 0 MiB .* raise max_bytes"):
            read_record(path, rate_hz=1.0, max_bytes=50_000)


@pytest.mark.data
def test_the_moving_roller_is_read_without_being_told_anything(data):
    record = read_record(data / "moving_roller/slow10_test0.txt")
    assert (record.samples.shape, record.rate_hz) == ((70_000, 3), 5000.0)
    assert record.channels == ("Low G Accel", "Accel", "PinLoc")
    assert record.units == ("Voltage (unscaled)",) * 3
    assert record.samples[0].tolist() == [0.0, 6.71387e-2, 1.22559]


@pytest.mark.data
def test_other_peoples_measurements_are_read(data):
    silverbox = read_record(data / "silverbox/SNLS80mV.csv", rate_hz=610.35)
    assert (silverbox.samples.shape, silverbox.channels) == ((131_072, 2), ("V1", "V2"))
    emps = read_record(data / "emps/DATA_EMPS.mat")
    assert (emps.rate_hz, emps.samples.shape) == (1000.0, (24_841, 3))
    frame = read_record(data / "steel_frame/measurement_1.npy", rate_hz=256.0)
    assert frame.samples.shape == (61_440, 6)


def test_numbers_that_no_double_holds_are_refused_as_infinite_ones_are(tmp_path):
    """Where a machine's long double reaches further; elsewhere they are infinite already."""
    values = np.random.default_rng(5).standard_normal(500).astype(np.longdouble)
    with np.errstate(over="ignore"):
        values[[70, 300]] = np.exp(np.longdouble(2000))
    for name, save in (("long.npy", np.save), ("long.npz", np.savez)):
        save(tmp_path / name, values)
        with pytest.raises(RecordError, match="2 values are not finite, the first in row 70"):
            read_record(tmp_path / name, rate_hz=100.0)


@pytest.mark.parametrize(("name", "assumed"), [("rate_hz", False), ("fs", True)])
def test_a_rate_is_called_assumed_only_where_its_name_has_no_unit(tmp_path, name, assumed):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.arange(100.0), name: 200.0})
    record = read_record(tmp_path / "a.mat")
    assert record.rate_hz == 200.0
    assert any(f"{name} = 200" in said for said in record.assumptions) == assumed
    assert "line 0" not in " ".join(record.assumptions)


def _npz(path, columns):
    np.savez(path.with_suffix(".npz"), **columns)
    return path.with_suffix(".npz")


def _mat(path, columns):
    scipy.io.savemat(path.with_suffix(".mat"), {k: v[:, None] for k, v in columns.items()})
    return path.with_suffix(".mat")


def _hdf5(path, columns):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path.with_suffix(".h5"), "w") as file:
        for name, values in columns.items():
            file[name] = values
    return path.with_suffix(".h5")


def _parquet(path, columns):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pa.table(columns), str(path.with_suffix(".parquet")))
    return path.with_suffix(".parquet")


WRITERS = pytest.mark.parametrize("write_file", [_npz, _mat, _hdf5, _parquet])


@WRITERS
def test_a_counting_clock_that_is_reset_is_refused_whatever_its_type(tmp_path, write_file):
    us = np.concatenate(
        (np.arange(20_000_000, 25_000_000, 10_000), np.arange(0, 5_000_000, 10_000))
    )
    columns = {"t_us": us.astype(np.uint32), "x": np.random.default_rng(1).normal(size=len(us))}
    with pytest.raises(RecordError, match="Time does not run forwards at row 500"):
        read_record(write_file(tmp_path / "a", columns))


@WRITERS
@pytest.mark.parametrize("begin", [0, 2**63 + 10**6, 2**63 - 10**6])
def test_a_counting_clock_of_any_size_tells_rate_and_gaps(tmp_path, write_file, begin):
    us = np.uint64(begin) + np.delete(np.arange(0, 5_000_000, 10_000), 100).astype(np.uint64)
    columns = {"t_us": us, "x": np.random.default_rng(1).normal(size=len(us))}
    record = read_record(write_file(tmp_path / "a", columns))
    assert record.rate_hz == 100.0
    assert [(gap.row, gap.missing) for gap in record.gaps] == [(100, 1)]


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("SampleFrequency", 200.0),
        ("Ts", 0.005),
        ("sampling_rate_hz", 200.0),
        ("fs", "200"),
        ("fs", np.array([200.0, 200.0, 200.0])),
    ],
)
def test_a_rate_is_read_by_any_of_its_names_as_text_and_for_each_channel(
    tmp_path, suffix, name, value
):
    made = {"acc": SAMPLES, name: value}
    path = tmp_path / f"a{suffix}"
    np.savez(path, **made) if suffix == ".npz" else scipy.io.savemat(path, made)
    assert read_record(path).rate_hz == 200.0


def test_different_rates_of_channels_are_no_rate(tmp_path):
    np.savez(tmp_path / "a.npz", acc=SAMPLES, fs=np.array([200.0, 100.0]))
    with pytest.raises(RecordError, match="does not say how often"):
        read_record(tmp_path / "a.npz")


def test_times_of_numpy_are_a_clock_with_a_start(tmp_path):
    start = np.datetime64("2024-05-01T10:00:00", "ns")
    times = start + np.arange(len(SAMPLES)) * np.timedelta64(5, "ms")
    np.savez(tmp_path / "a.npz", acc=SAMPLES, time=times)
    record = read_record(tmp_path / "a.npz")
    assert (record.rate_hz, record.start_ns) == (200.0, int(start.astype(np.int64)))


def test_matlab_structs_that_are_runs_are_asked_about(tmp_path):
    runs = {f"test{i}": {"acc": SAMPLES, "fs": 200.0} for i in (1, 2)}
    scipy.io.savemat(tmp_path / "a.mat", runs)
    with pytest.raises(RecordError, match=r"test1, test2, .*--channels test1\.acc_0"):
        read_record(tmp_path / "a.mat")
    chosen = read_record(tmp_path / "a.mat", channels=["test2.acc_0"])
    np.testing.assert_array_equal(chosen.samples[:, 0], SAMPLES[:, 0])
