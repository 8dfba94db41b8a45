"""Modes through universal files: what one program writes, another reads as the same modes."""

import csv
import json
import math
import warnings

import numpy as np
import pytest

from slowtime_schemas.files.modes import ModesFile
from slowtime_services.files import RecordError
from slowtime_services.modal import (
    NodeAxis,
    places_of,
    read_geometry,
    read_modes,
    write_modes,
    write_table,
)

pyuff = pytest.importorskip("pyuff")
DIGITS = 2e-5
"""Relative error that the six digits of dataset 55 leave of the largest component."""


@pytest.fixture(autouse=True)
def _libraries_may_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def drawn(seed, channels=None):
    """A file of modes: complex shapes of unit norm, random channels, a machine's line."""
    rng = np.random.default_rng([3, seed])
    width = int(rng.integers(1, 40))
    channels = channels or [f"a{i}_{'xyz'[i % 3]}" for i in range(width)]
    modes = []
    for hz in np.sort(10 ** rng.uniform(-1, 3, int(rng.integers(1, 8)))):
        shape = rng.standard_normal(len(channels)) + 1j * rng.standard_normal(len(channels))
        shape /= np.linalg.norm(shape)
        modes.append(
            {
                "frequency_hz": {"value": hz, "sd": 1e-3 * hz},
                "damping_ratio": {"value": float(rng.uniform(1e-4, 0.2)), "sd": 1e-4},
                "correlation": 0.0, "kind": "structural", "quality": 0.9, "snr_db": None,
                "shape": {"re": shape.real.tolist(), "im": shape.imag.tolist(),
                          "sd": [0.01] * len(channels)},
                "method": "modes", "span_s": [0.0, 60.0], "flags": [],
            }
        )  # fmt: skip
    line = {**modes[0], "kind": "harmonic"}
    body = {"slowtime_modes": 1, "record": "r.csv", "rate_hz": 5000.0, "channels": channels,
            "duration_s": 60.0, "modes": [*modes, line]}  # fmt: skip
    return ModesFile.model_validate_json(json.dumps(body))


def structural(found):
    return [mode for mode in found.modes if mode.kind == "structural"]


def complex_shape(mode):
    return np.array(mode.shape.re) + 1j * np.array(mode.shape.im)


@pytest.mark.parametrize("seed", range(8))
def test_pyuff_reads_the_modes_that_are_written(tmp_path, seed):
    found = drawn(seed)
    assert write_modes(tmp_path / "m.uff", found, unit="m/s^2") == len(structural(found))
    sets = pyuff.UFF(str(tmp_path / "m.uff")).read_sets()
    sets = sets if isinstance(sets, list) else [sets]
    assert [one["type"] for one in sets] == [55] * len(structural(found))
    places = places_of(found.channels)
    for one, mode in zip(sets, structural(found), strict=True):
        pole, z = one["eig"], mode.damping_ratio.value
        assert abs(pole) / (2 * math.pi) == pytest.approx(mode.frequency_hz.value, rel=DIGITS)
        assert -pole.real / abs(pole) == pytest.approx(z, rel=1e-4)
        assert one["spec_data_type"] == 12
        nodes = [int(node) for node in one["node_nums"]]
        at = [one[f"r{abs(p.axis)}"][nodes.index(p.node)] for p in places]
        np.testing.assert_allclose(at, complex_shape(mode), atol=DIGITS)


@pytest.mark.parametrize("seed", range(8))
def test_modes_come_back_with_names_and_deviations(tmp_path, seed):
    found = drawn(seed, [f"s{i}" for i in range(7)])
    write_modes(tmp_path / "m.unv", found)
    back = read_modes(tmp_path / "m.unv")
    shapes = back.at(found.channels)
    assert shapes is not None
    for one, mode, shape in zip(back.modes, structural(found), shapes, strict=True):
        assert one.frequency_hz == pytest.approx(mode.frequency_hz.value, rel=DIGITS)
        assert one.damping_ratio == pytest.approx(mode.damping_ratio.value, rel=1e-4)
        assert one.frequency_sd == pytest.approx(mode.frequency_hz.sd, rel=1e-5)
        assert one.damping_sd == pytest.approx(1e-4, rel=1e-5)
        np.testing.assert_allclose(shape, complex_shape(mode), atol=DIGITS)


@pytest.mark.parametrize("analysis", [2, 3])
def test_modes_that_pyuff_wrote_are_read(tmp_path, analysis):
    rng = np.random.default_rng(analysis)
    nodes = np.array([3, 7, 11, 40])
    hz, zeta = 12.5, 0.013
    shape = rng.standard_normal((3, 4)) + (analysis == 3) * 1j * rng.standard_normal((3, 4))
    pole = 2 * math.pi * hz * complex(-zeta, math.sqrt(1 - zeta**2))
    one = {
        "type": 55, "model_type": 1, "analysis_type": analysis, "data_ch": 2,
        "spec_data_type": 8, "load_case": 1, "mode_n": 1, "node_nums": nodes,
        "r1": shape[0], "r2": shape[1], "r3": shape[2], "freq": hz, "modal_damp_vis": zeta,
        "eig": pole,
    }  # fmt: skip
    pyuff.UFF(str(tmp_path / "m.uff")).write_sets([one], "overwrite")
    (mode,) = read_modes(tmp_path / "m.uff").modes
    assert (mode.frequency_hz, mode.damping_ratio) == pytest.approx((hz, zeta), rel=1e-4)
    names = tuple(f"node {n} {axis}" for n in nodes for axis in ("+X", "-Y", "+Z"))
    told = read_modes(tmp_path / "m.uff").at(names)
    assert told is not None
    wanted = (shape * np.array([[1], [-1], [1]])).T.ravel()
    np.testing.assert_allclose(told[0], wanted, rtol=1e-4, atol=1e-5)
    assert read_modes(tmp_path / "m.uff").at(("roof",)) is None


@pytest.mark.parametrize("kind", [15, 2411])
def test_geometry_that_pyuff_wrote_is_read(tmp_path, kind):
    rng = np.random.default_rng(kind)
    labels, points = np.arange(1, 9), rng.uniform(-5, 5, (3, 8))
    ones = np.ones(8, dtype=int)
    nodes = {"type": kind, "node_nums": labels, "def_cs": ones, "disp_cs": ones,
             "color": ones, "x": points[0], "y": points[1], "z": points[2]}  # fmt: skip
    lines = {"type": 82, "trace_num": 1, "n_nodes": 6, "color": 1, "id": "frame",
             "nodes": np.array([1, 2, 3, 0, 5, 6])}  # fmt: skip
    file = pyuff.UFF(str(tmp_path / "g.unv"))
    file.write_sets([nodes], "overwrite")
    file.write_sets([lines], "add")
    found = read_geometry(tmp_path / "g.unv")
    told = np.array([found.nodes[label] for label in range(1, 9)]).T
    np.testing.assert_allclose(told, points, rtol=1e-5, atol=1e-5)
    assert found.lines == ((1, 2, 3, 0, 5, 6),)


def test_a_geometry_goes_with_the_modes(tmp_path):
    (tmp_path / "g.csv").write_text(
        "channel,x,y,z,direction\nroof,0,0,10,X\nroof2,0,0,10,-Y\nfloor,0,0,5,+X\n"
    )
    geometry = read_geometry(tmp_path / "g.csv")
    assert geometry.places == {
        "roof": NodeAxis(1, 1),
        "roof2": NodeAxis(1, -2),
        "floor": NodeAxis(2, 1),
    }
    found = drawn(1, ["floor", "roof", "roof2"])
    write_modes(tmp_path / "m.uff", found, geometry)
    sets = pyuff.UFF(str(tmp_path / "m.uff")).read_sets()
    assert [one["type"] for one in sets][:2] == [2411, 55]
    np.testing.assert_array_equal(sets[0]["z"], [10.0, 5.0])
    shape = complex_shape(structural(found)[0])
    np.testing.assert_allclose(sets[1]["r1"], [shape[1], shape[0]], atol=DIGITS)
    np.testing.assert_allclose(sets[1]["r2"], [-shape[2], 0], atol=DIGITS)
    with pytest.raises(RecordError, match="The geometry has no channel pier"):
        write_modes(tmp_path / "n.uff", drawn(1, ["floor", "pier"]), geometry)


def test_two_channels_at_one_place_are_refused():
    with pytest.raises(RecordError, match=r"a_x, a-x would be at one node.*--geometry"):
        places_of(("a_x", "a-x"))


def test_a_file_that_is_cut_or_holds_no_modes_is_refused(tmp_path):
    write_modes(tmp_path / "m.uff", drawn(2))
    text = (tmp_path / "m.uff").read_text()
    lines = text.splitlines(keepends=True)
    for kept in range(1, len(lines)):
        (tmp_path / "cut.uff").write_text("".join(lines[:kept]))
        if lines[kept - 1].strip() == "-1" and lines[:kept].count("    -1\n") % 2 == 0:
            continue
        with pytest.raises(RecordError, match=r"cut\.uff"):
            read_modes(tmp_path / "cut.uff")
    (tmp_path / "other.uff").write_text("    -1\n   151\nx\n    -1\n")
    with pytest.raises(RecordError, match=r"holds no mode .* its datasets: 151"):
        read_modes(tmp_path / "other.uff")


def test_a_table_has_a_row_a_mode(tmp_path):
    found = drawn(4, ["a", "b"])
    write_table(tmp_path / "m.csv", found)
    with (tmp_path / "m.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, mode in zip(rows, found.modes, strict=True):
        assert float(row["frequency_hz"]) == mode.frequency_hz.value
        assert float(row["im_b"]) == mode.shape.im[1]
        assert row["kind"] == mode.kind
