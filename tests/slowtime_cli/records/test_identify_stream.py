"""`identify --stream`: a long file in bounded memory, told as a record read whole."""

import json
import re

import numpy as np
import pytest
import scipy.signal as sps

from slowtime_cli.records import identify_stream
from slowtime_schemas.raw import ClockCorrection, RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.record import RecordingWriter

RATE = 20.0


def record(path, seconds):
    rng = np.random.default_rng(1)
    count = round(seconds * RATE)
    samples = 0.1 * rng.standard_normal((count, 2))
    for hz, shape in ((1.7, (1.0, 0.4)), (2.6, (-0.5, 1.0))):
        pole = np.exp((-0.015 + 1j) * 2 * np.pi * hz / RATE)
        sway = sps.lfilter(
            [1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.standard_normal(count)
        )
        samples += np.outer(sway / sway.std(), shape)
    np.save(path, samples.astype("<f4"))
    return str(path)


def identified(run, path, out, *more):
    return identified_in(run, path, out, "--rate-hz", "20", *more)


def identified_in(run, path, out, *more):
    run("identify", path, "--out", str(out), *more)
    return json.loads(out.read_text())


@pytest.mark.long
def test_a_stream_tells_the_modes_of_the_whole_record_within_their_errors(run, tmp_path):
    path = record(tmp_path / "long.npy", 7200)
    band = ("--band-hz", "1.4", "3.2")
    stream = identified(run, path, tmp_path / "a.json", "--stream", *band)
    whole = identified(run, path, tmp_path / "b.json", "--whole", "--method", "modes", *band)
    assert stream["channels"] == whole["channels"]
    assert stream["duration_s"] == whole["duration_s"] == 7200.0
    assert len(stream["modes"]) == len(whole["modes"]) == 2
    for ours, theirs in zip(stream["modes"], whole["modes"], strict=True):
        assert ours["method"] == "recursive"
        for what in ("frequency_hz", "damping_ratio"):
            off = ours[what]["value"] - theirs[what]["value"]
            assert abs(off) < theirs[what]["sd"]
            assert ours[what]["sd"] == pytest.approx(theirs[what]["sd"], rel=0.4)


@pytest.mark.parametrize("how", ["--stream", "--whole"])
def test_a_stream_with_gaps_tells_the_modes_with_errors_larger_by_the_loss(run, tmp_path, how):
    samples = np.load(record(tmp_path / "long.npy", 1800))
    rng = np.random.default_rng(2)
    there = np.ones(len(samples), dtype=bool)
    for at in rng.integers(1, len(there) - 41, size=len(there) // 200):
        there[at : at + rng.integers(1, 41)] = False
    rows = np.column_stack([np.arange(len(samples)) / RATE, samples])
    of = {}
    for name, table in (("whole", rows), ("gaps", rows[there])):
        path = tmp_path / f"{name}.csv"
        np.savetxt(path, table, "%.7g", ",", header="time_s,a (m/s^2),b (m/s^2)", comments="")
        band = ("--method", "modes") if how == "--whole" else ()
        of[name] = identified_in(
            run, str(path), tmp_path / f"{name}.json", how, "--band-hz", "1.4", "3.2", *band
        )
    lost = 1 - there.mean()
    assert 0.05 < lost < 0.15
    said = " ".join(of["gaps"]["assumptions"])
    assert f"({100 * lost:.1f} %)" in said
    assert len(of["gaps"]["modes"]) == len(of["whole"]["modes"]) == 2
    for ours, theirs in zip(of["gaps"]["modes"], of["whole"]["modes"], strict=True):
        for what in ("frequency_hz", "damping_ratio"):
            assert abs(ours[what]["value"] - theirs[what]["value"]) < 1.5 * ours[what]["sd"]
            if how == "--stream":
                assert ours[what]["sd"] > 0.9 * theirs[what]["sd"]


def test_a_stream_says_on_its_way_how_far_it_is_and_what_it_knows(run, tmp_path, monkeypatch):
    monkeypatch.setattr(identify_stream, "MIN_REPORT_S", 200.0)
    path = record(tmp_path / "long.npy", 900)
    done = run("identify", path, "--rate-hz", "20", "--stream", "--band-hz", "2.2", "3.0")
    said = [line for line in done.err.splitlines() if "h read" in line]
    assert len(said) >= 2
    assert re.search(r"1 mode: 2\.(59|60|61)\d\d ± 0\.0\d+ Hz", said[-1])


def recording(path, samples, clocks):
    """A recording of one-minute blocks, each with what was known of its clock."""
    rows = round(60 * RATE)
    with RecordingWriter(path) as writer:
        for i, (relative, sd) in enumerate(clocks):
            part = samples[rows * i : rows * (i + 1)]
            header = RawHeader(
                site="lab", asset="deck", boot="b1", sequence=i, t_ns=10**18 + i * 60 * 10**9,
                rate_hz=RATE, first_index=rows * i, dtype="<f4", samples=rows,
                channels=("a", "b"), units=("m/s^2", "m/s^2"),
                clock=ClockCorrection(relative=relative, sd=sd),
            )  # fmt: skip
            writer.write(RAW, "lab", "deck", encode_raw(header, part.tobytes()), header.t_ns)
    return str(path)


@pytest.mark.parametrize("how", ["--stream", "--whole"])
def test_frequencies_of_a_recording_are_those_of_its_measured_clock(run, tmp_path, how):
    samples = np.load(record(tmp_path / "nominal.npy", 900))
    clocks = [(0.0, 0.01), *[(0.03, 1e-5)] * 14]
    path = recording(tmp_path / "a.mcap", samples, clocks)
    band = ("--band-hz", "1.4", "3.2", *(("--method", "modes") * (how == "--whole")))
    known = identified_in(run, path, tmp_path / "a.json", how, *band)
    nominal = identified_in(run, path, tmp_path / "b.json", "--rate-hz", "20", how, *band)
    assert (known["rate_hz"], nominal["rate_hz"]) == (pytest.approx(20.6), 20.0)
    for told, true in ((known, 2.6 * 1.03), (nominal, 2.6)):
        off = [abs(mode["frequency_hz"]["value"] - true) for mode in told["modes"]]
        assert min(off) < 0.02
    assert any("the nominal rate is 20 Hz" in text for text in known["assumptions"])


@pytest.mark.parametrize(
    "more", [("--window-s", "10"), ("--method", "fdd"), ("--report", "a.html")]
)
def test_what_only_a_whole_record_tells_is_refused_of_a_stream(refused, tmp_path, more):
    path = record(tmp_path / "long.npy", 60)
    said = refused("identify", path, "--rate-hz", "20", "--stream", *more)
    assert "--stream finds all modes" in said


def test_a_long_file_becomes_a_stream_by_itself_and_says_so(run, tmp_path, monkeypatch):
    monkeypatch.setattr(identify_stream, "LONG_BYTES", 4096)
    path = record(tmp_path / "long.npy", 60)
    done = run("identify", path, "--rate-hz", "20", "--band-hz", "1", "3")
    assert "is read as a stream. --whole reads it at once" in done.err
