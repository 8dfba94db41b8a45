"""The verb `merge`: set-ups of moved sensors as modes of one structure."""

import json

import numpy as np
import pytest

from slowtime_schemas.files.modes import ModesFile


def modes_file(path, channels, modes):
    body = {
        "slowtime_modes": 1,
        "record": path.name,
        "rate_hz": 100.0,
        "channels": channels,
        "duration_s": 60.0,
        "modes": [
            {
                "frequency_hz": {"value": hz, "sd": 0.01},
                "damping_ratio": {"value": 0.01, "sd": 0.002},
                "correlation": 0.0,
                "shape": {
                    "re": (np.array(shape) / np.linalg.norm(shape)).tolist(),
                    "im": [0.0] * len(shape),
                    "sd": [0.005] * len(shape),
                },
                "kind": "structural",
                "quality": 1.0,
                "snr_db": None,
                "method": "ssi",
                "span_s": [0.0, 60.0],
                "flags": [],
            }
            for hz, shape in modes
        ],
    }
    path.write_text(json.dumps(body))
    return path


@pytest.fixture
def setups(tmp_path):
    low = [(2.0, [1.0, 0.5, 0.2]), (6.0, [1.0, -0.8, 0.4])]
    high = [(2.01, [-1.0, -0.5, -0.8]), (6.01, [1.0, -0.8, 0.1])]
    return (
        modes_file(tmp_path / "low.json", ["top", "mid", "first"], low),
        modes_file(tmp_path / "high.json", ["top", "mid", "second"], high),
    )


def test_shapes_are_put_together_over_the_references(run, setups, tmp_path):
    out = tmp_path / "whole.json"
    done = run("modes", "merge", *map(str, setups), "--out", str(out))
    assert done.status == 0, done.err
    whole = ModesFile.model_validate_json(out.read_text())
    assert whole.channels == ("top", "mid", "first", "second")
    assert whole.modes is not None
    for mode, truth in zip(whole.modes, ([1, 0.5, 0.2, 0.8], [1, -0.8, 0.4, 0.1]), strict=True):
        assert mode.shape is not None
        shape = np.array(mode.shape.re) / mode.shape.re[0]
        np.testing.assert_allclose(shape, truth, atol=0.02)
    assert whole.modes[0].frequency_hz.value == pytest.approx(2.005, abs=1e-6)
    assert whole.modes[0].frequency_hz.sd == pytest.approx(0.01 / 2**0.5, rel=0.3)


def test_a_universal_file_holds_the_merged_modes(run, setups, tmp_path):
    out = tmp_path / "whole.unv"
    assert run("modes", "merge", *map(str, setups), "--out", str(out)).status == 0
    assert out.read_text().startswith("    -1")


def test_what_cannot_be_merged_says_why(run, setups, tmp_path):
    lonely = modes_file(tmp_path / "lonely.json", ["elsewhere"], [(2.0, [1.0])])
    assert "Give at least two files" in run("modes", "merge", str(setups[0])).err
    assert run("modes", "merge", str(setups[0]), str(lonely)).status != 0
    (tmp_path / "no.json").write_text("{}")
    assert (
        "not a valid modes file"
        in run("modes", "merge", str(setups[0]), str(tmp_path / "no.json")).err
    )


def records(folder, seed=1):
    """Records of two set-ups of four storeys under winds of two strengths."""
    rng = np.random.default_rng(seed)
    rate, count = 40.0, 12000
    angle = (2 * np.arange(1, 5) - 1) * np.pi / 9
    shapes = np.sin(np.outer(np.arange(1, 5), angle))
    hz = 2.0 * np.sin(angle / 2) / np.sin(angle[0] / 2)
    t = np.arange(1200) / rate
    paths = []
    for name, places, level in (("low", (3, 1, 0), 1.0), ("high", (3, 1, 2), 3.0)):
        motion = np.zeros((count, 4))
        for k in range(4):
            decay = np.exp(-0.01 * 2 * np.pi * hz[k] * t) * np.sin(2 * np.pi * hz[k] * t)
            wave = np.convolve(rng.standard_normal(count), decay)[:count]
            motion += wave[:, None] * shapes[:, k]
        seen = level * motion[:, places]
        seen = seen + 0.03 * seen.std() * rng.standard_normal(seen.shape)
        columns = {f"s{place}": seen[:, k] for k, place in enumerate(places)}
        paths.append(folder / f"{name}.npz")
        np.savez(paths[-1], rate_hz=rate, **columns)
    return paths, hz, shapes


@pytest.mark.long
def test_records_are_merged_before_identification_where_the_wind_differs(run, tmp_path):
    paths, hz, shapes = records(tmp_path)
    done = run("modes", "merge", *paths, "--before", "--band-hz", 1, 12, "--out", "whole.json")
    assert done.status == 0, done.err
    whole = ModesFile.model_validate_json((tmp_path / "whole.json").read_text())
    assert whole.channels == ("s3", "s1", "s0", "s2")
    assert whole.modes is not None
    for k in range(3):
        mode = min(whole.modes, key=lambda one: abs(one.frequency_hz.value - hz[k]))
        assert abs(mode.frequency_hz.value - hz[k]) < 0.01 * hz[k]
        assert mode.shape is not None
        shape = np.array(mode.shape.re) / mode.shape.re[0]
        np.testing.assert_allclose(shape, shapes[[3, 1, 0, 2], k] / shapes[3, k], atol=0.1)


def test_flags_of_records_and_modes_files_are_not_mixed(refused, setups, tmp_path):
    assert "--before needs --band-hz" in refused("modes", "merge", *setups, "--before")
    assert "go with --before" in refused("modes", "merge", *setups, "--band-hz", 1, 2)
    paths, _, _ = records(tmp_path)
    said = refused("modes", "merge", *paths, "--before", "--band-hz", 1, 30)
    assert "a band below half of it" in said
