"""`distortion`, as a script meets it."""

import json

import numpy as np
import pytest

N, RATE = 512, 256.0
LINES = np.array([line for i, line in enumerate(range(1, 200, 2)) if i % 4 != 3])


@pytest.fixture
def records(tmp_path):
    """Three realisations of four periods through a cube, in noise."""
    rng = np.random.default_rng(0)
    names = []
    for number in range(3):
        spectrum = np.zeros(N // 2 + 1, dtype=complex)
        spectrum[LINES] = np.exp(2j * np.pi * rng.random(len(LINES)))
        wave = np.fft.irfft(spectrum)
        wave /= wave.std()
        told = np.tile(wave + 0.05 * wave**3, 4) + 0.01 * rng.standard_normal(4 * N)
        names.append(f"r{number}.npz")
        np.savez(tmp_path / names[-1], u=np.tile(wave, 4), y=told, rate_hz=RATE)
    return names


def test_an_odd_nonlinearity_is_told_in_words_and_in_json(run, tmp_path, records):
    done = run(
        "modes",
        "distortion",
        *records,
        "--input",
        "u",
        "--output",
        "y",
        "--out",
        "-",
        "--report",
        "p.html",
    )
    assert done.status == 0, done.err
    assert "repeats after 512 samples" in done.err
    document = json.loads(done.out)
    (level,) = document["levels"]
    assert (level["symmetry"], level["realisations"], level["periods"]) == ("odd", 3, 4)
    assert len(level["lines_hz"]) == len(level["nonlinear_sd"]) == len(LINES)
    assert "odd" in document["sentence"]
    assert (tmp_path / "p.html").stat().st_size > 1000


def test_a_decay_is_told_by_its_law(run, tmp_path):
    t = np.arange(3000) / 100.0
    np.savez(tmp_path / "d.npz", t=t, x=np.exp(-0.1 * t) * np.cos(8.0 * t))
    done = run("modes", "distortion", "d.npz", "--decay", "--output", "x", "--out", "d.json")
    assert done.status == 0, done.err
    (decay,) = json.loads((tmp_path / "d.json").read_text())["decays"]
    assert decay["terms"] == "viscous"
    assert decay["viscous"] == pytest.approx(np.pi * 0.1 / 8.0, rel=1e-2)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ((), "Give it, or --decay"),
        (("--input", "u", "--decay"), "--decay and --input exclude each other"),
        (("--input", "u", "--setting", "period=x"), "Give a whole number of samples, or auto"),
        (("--input", "u", "--setting", "period=4000"), "not one period of 4000"),
        (("--input", "w"), "'w'"),
    ],
)
def test_what_cannot_be_done_is_said(run, records, more, words):
    done = run("modes", "distortion", *records, "--output", "y", *more)
    assert done.status == 2
    assert words in " ".join(done.err.split())
