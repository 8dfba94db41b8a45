"""The verb `scale`: modal masses from tests without and with known masses."""

import json

import numpy as np
import pytest
import scipy.linalg

from .test_merge import modes_file

CHANNELS = ["a1", "a2", "a3"]
MASS = np.diag([20.0, 20.0, 15.0])
SPRINGS = 4.0e4 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])


def modes_of(mass):
    squares, shapes = scipy.linalg.eigh(SPRINGS, mass)
    return [
        (hz, shape) for hz, shape in zip(np.sqrt(squares) / (2 * np.pi), shapes.T, strict=True)
    ]


@pytest.fixture
def files(tmp_path):
    added = np.diag([0.0, 0.0, 1.5])
    bare = modes_file(tmp_path / "bare.json", CHANNELS, modes_of(MASS))
    heavier = modes_file(tmp_path / "heavier.json", CHANNELS, modes_of(MASS + added))
    return bare, heavier


def test_modal_masses_are_those_of_the_structure(run, files, tmp_path):
    bare, heavier = files
    done = run(
        "modes",
        "scale",
        bare,
        "--added",
        heavier,
        "a3=1.5",
        "--out",
        "scaled.json",
        "--out",
        "-",
    )
    assert done.status == 0, done.err
    body = json.loads(done.out)
    assert body == json.loads((tmp_path / "scaled.json").read_text())
    assert len(body["modes"]) == 3
    for entry, (_, shape) in zip(body["modes"], modes_of(MASS), strict=True):
        unit = shape / np.linalg.norm(shape)
        exact, found = unit @ MASS @ unit, entry["modal_mass_kg"]
        assert abs(found["value"] - exact) < max(3 * found["sd"], 0.03 * exact)
        assert found["sd"] < 0.5 * exact
        sign = np.sign(shape @ entry["shape"])
        np.testing.assert_allclose(sign * np.array(entry["shape"]), shape, rtol=0.2, atol=0.01)


def test_a_mode_that_the_masses_do_not_lower_is_noted_and_left_out(run, files):
    bare, _ = files
    done = run("modes", "scale", bare, "--added", bare, "a3=1.5")
    assert done.status == 0
    assert done.err.count("is not scaled: The frequency fell by") == 3


@pytest.mark.parametrize("words", ["a3", "a9=1", "a3=-2", "a3=much", "a3=nan"])
def test_masses_that_are_none_are_refused_with_what_is_allowed(refused, files, words):
    bare, heavier = files
    said = refused("modes", "scale", bare, "--added", heavier, words)
    assert "CHANNEL=KG with one of the channels a1, a2, a3" in said


def test_files_of_other_channels_are_refused(refused, files, tmp_path):
    bare, _ = files
    other = modes_file(tmp_path / "other.json", ["b1", "b2", "b3"], modes_of(MASS))
    assert "with the same sensors in the same order" in refused(
        "modes", "scale", bare, "--added", other, "a3=1"
    )
