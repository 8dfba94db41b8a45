"""`identify --stream`: a long file in bounded memory, told as a record read whole."""

import json
import re

import numpy as np
import pytest
import scipy.signal as sps

from slowtime_cli.records import identify_stream

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
    run("identify", path, "--rate-hz", "20", "--out", str(out), *more)
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


def test_a_stream_says_on_its_way_how_far_it_is_and_what_it_knows(run, tmp_path, monkeypatch):
    monkeypatch.setattr(identify_stream, "MIN_REPORT_S", 200.0)
    path = record(tmp_path / "long.npy", 900)
    done = run("identify", path, "--rate-hz", "20", "--stream", "--band-hz", "2.2", "3.0")
    said = [line for line in done.err.splitlines() if "h read" in line]
    assert len(said) >= 2
    assert re.search(r"1 mode: 2\.(59|60|61)\d\d ± 0\.0\d+ Hz", said[-1])


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
