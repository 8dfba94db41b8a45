import csv
import importlib.util
import itertools
import pathlib
import struct
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

FOLDER = pathlib.Path(__file__).parents[2] / "docs/figures"
NAMES = [f"figure_3_{k}" for k in (3, 6, 7, 8, 9, 10, 11)]
figures = pytest.mark.parametrize("name", NAMES)


@pytest.fixture(scope="module")
def chapter():
    spec = importlib.util.spec_from_file_location("chapter_3", FOLDER / "chapter_3.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["chapter_3"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["chapter_3"]


def test_there_is_nothing_but_these_figures(chapter):
    drawn = sorted(path.stem for path in FOLDER.glob("figure_3_*.png"))
    assert list(chapter.FIGURES) == NAMES
    assert set(NAMES) == set(drawn) == set(chapter.CAPTIONS) == set(chapter.PANELS)


@figures
def test_the_data_behind_a_figure_come_out_of_the_library_again(chapter, name):
    with (FOLDER / f"{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    series = itertools.groupby(rows, key=lambda row: (row["panel"], row["series"]))
    kept = {key: list(of_series) for key, of_series in series}
    lines = chapter.FIGURES[name]()
    assert [(line.panel, line.name) for line in lines] == list(kept)
    for line in lines:
        rows = kept[line.panel, line.name]
        abscissa = [float(row["abscissa"]) for row in rows]
        value = [float(row["value"]) for row in rows]
        np.testing.assert_allclose(abscissa, line.abscissa, atol=1e-11)
        np.testing.assert_allclose(value, line.value, rtol=1e-10, atol=1e-10)


@figures
def test_a_figure_is_a_picture_of_some_size(name):
    head = (FOLDER / f"{name}.png").read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", head[16:24])
    assert 800 < width < 2400
    assert 400 < height < 1200


@figures
def test_a_caption_begins_with_its_number(chapter, name):
    number = name.removeprefix("figure_").replace("_", ".")
    assert chapter.CAPTIONS[name].startswith(f"Figure {number}. ")


@pytest.mark.long
def test_the_pictures_are_drawn_from_these_data(chapter, tmp_path):
    pytest.importorskip("matplotlib")
    chapter.draw("figure_3_3", chapter.figure_3_3(), tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_what_the_text_says_of_its_figures_is_seen_in_them(chapter):
    by_figure = {
        name: {(line.panel, line.name): line.value for line in chapter.FIGURES[name]()}
        for name in NAMES
    }
    first, second, third = (("a", f"DOF {k}") for k in (1, 2, 3))
    pulse = by_figure["figure_3_7"]
    # "it moves earlier and comparatively more than the other two masses"
    assert 0.3 < np.abs(pulse[first]).max() < 0.4
    assert np.abs(pulse[first]).max() > max(
        np.abs(pulse[second]).max(), np.abs(pulse[third]).max()
    )
    moved = [np.argmax(np.abs(pulse[key]) > 0.02) for key in (first, second, third)]
    assert moved[0] < moved[1] < moved[2]
    for name in ("figure_3_8", "figure_3_9"):
        # "the responses of the first and the third masses are exactly the same"
        np.testing.assert_allclose(by_figure[name][first], by_figure[name][third], atol=1e-12)
    assert by_figure["figure_3_9"][second][0] == pytest.approx(1.0)
    for name, expected in (("figure_3_6", 3), ("figure_3_8", 2), ("figure_3_10", 3)):
        # "the second peak is missing", and not elsewhere
        value = by_figure[name][first]
        peaks = np.flatnonzero((value[1:-1] > value[:-2]) & (value[1:-1] > value[2:])) + 1
        assert len(peaks) == expected, name
    speed = by_figure["figure_3_11"]
    early = np.abs(speed[second] - speed[third])
    assert early[:20].max() < 0.02 < 0.3 < early.max()
    # "when zeta = 0.5, the vibration ceases after about three periods"
    damped = by_figure["figure_3_3"]["a", "ζ = 0.5"]
    assert np.abs(damped[300:]).max() < 1e-3
    assert np.abs(by_figure["figure_3_3"]["b", "ζ = 0.01"]).max() == pytest.approx(50, rel=0.01)


def test_the_pulse_is_the_integral_of_the_equation_of_motion(chapter):
    structure = chapter.example_3_3()

    def motion(t, state):
        force = np.array([float(t <= chapter.PULSE_S), 0.0, 0.0])
        pull = structure.damping @ state[3:] + structure.stiffness @ state[:3]
        return np.concatenate([state[3:], force - pull])

    truth = solve_ivp(
        motion, (0, 20), np.zeros(6), t_eval=chapter.TIME, rtol=1e-9, atol=1e-11, max_step=0.01
    ).y
    for k, line in enumerate(chapter.figure_3_7()):
        np.testing.assert_allclose(line.value, truth[k], atol=1e-4)
