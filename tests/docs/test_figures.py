import csv
import importlib.util
import itertools
import pathlib
import struct
import sys

import numpy as np
import pytest

from slowtime.evolution import mass_from_frequency, stiffness_from_frequency

FOLDER = pathlib.Path(__file__).parents[2] / "docs/figures"


@pytest.fixture(scope="module")
def chapter():
    spec = importlib.util.spec_from_file_location("chapter_5", FOLDER / "chapter_5.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["chapter_5"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["chapter_5"]


NAMES = ["figure_5_2", "figure_5_3", "figure_5_4", "figure_5_5", "figure_5_6"]
figures = pytest.mark.parametrize("name", NAMES)


def stored(name):
    with (FOLDER / f"{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    series = itertools.groupby(rows, key=lambda row: row["series"])
    return {name: list(of_series) for name, of_series in series}


def numbers(rows, column):
    return np.array([float(row[column] or "nan") for row in rows])


def rms(error):
    return np.sqrt(np.mean(error**2))


def test_there_is_nothing_but_these_figures(chapter):
    assert (
        list(chapter.FIGURES) == NAMES == sorted(p.stem for p in FOLDER.glob("figure_5_*.png"))
    )
    assert set(chapter.CAPTIONS) == set(NAMES)


@figures
def test_the_data_behind_a_figure_come_out_of_the_library_again(chapter, name):
    kept, lines = stored(name), chapter.FIGURES[name]()
    assert [line.name for line in lines] == list(kept)
    for line in lines:
        rows = kept[line.name]
        # What was learnt by an optimiser may differ a little between processors.
        close = 1e-6 if "smoothed" in line.name else 1e-11
        np.testing.assert_allclose(numbers(rows, "slow_time_over_t0"), line.slow_time)
        np.testing.assert_allclose(numbers(rows, "value"), line.value, rtol=0, atol=close)
        for column, end in (("lo", line.lo), ("hi", line.hi)):
            expected = np.full(len(rows), np.nan) if end is None else end
            np.testing.assert_allclose(numbers(rows, column), expected, rtol=0, atol=close)


@figures
def test_a_figure_is_a_picture_of_some_size(name):
    head = (FOLDER / f"{name}.png").read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", head[16:24])
    assert 800 < width < 2400
    assert 400 < height < 1200


@figures
def test_a_caption_says_what_differs_from_the_print(chapter, name):
    text = chapter.caption(name, chapter.FIGURES[name]())
    assert "(E" in text
    assert "{" not in text


@pytest.mark.long
def test_the_pictures_are_drawn_from_these_data(chapter, tmp_path):
    pytest.importorskip("matplotlib")
    lines = chapter.FIGURES["figure_5_3"]()
    chapter.draw("figure_5_3", lines, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_exact_data_give_back_the_truth_in_figures_5_3_and_5_5(chapter):
    by_name = {line.name: line for line in chapter.figure_5_3()}
    found = by_name["eq. 5.20"]
    np.testing.assert_allclose(
        found.value, -chapter.stiffness_change(found.slow_time), atol=1e-15
    )
    assert by_name["truth"].value[-1] == pytest.approx(0.3486, abs=5e-5)
    by_name = {line.name: line for line in chapter.figure_5_5()}
    for rate in ("coarse", "fine"):
        found = by_name[f"eq. 5.39, {rate}"]
        np.testing.assert_allclose(
            found.value, chapter.mass_change(found.slow_time), atol=1e-13
        )
        off = np.abs(by_name[f"error of eq. 5.40, {rate}"].value).max()
        assert off == pytest.approx(9.9e-4, rel=0.05)


@pytest.mark.long
def test_over_many_draws_smoothing_halves_the_error_and_5_30_does_not_lessen_it(chapter):
    times, errors, inside = chapter.COARSE, [], []
    truth = chapter.stiffness_change(times)
    exact = chapter.ratio(times, "stiffness")
    assert len(times) == 51
    for seed in range(24):
        noisy = exact + chapter.ERROR_SD * np.random.default_rng(seed).standard_normal(51)
        each = stiffness_from_frequency(noisy, chapter.ERROR_SD, damping_ratio_0=0.05)
        distance = chapter.book_formulas.distance(noisy, 0.05)
        by_book = chapter.book_formulas.stiffness_error_size_known(
            distance, chapter.ERROR_SD, 0.05
        )
        over_time = chapter.smoothed(times, noisy, smoothness=2.5, straight=True)
        smooth = stiffness_from_frequency(over_time.mean, over_time.sd, damping_ratio_0=0.05)
        errors.append([rms(value - truth) for value in (each.value, by_book, smooth.value)])
        inside.append((smooth.lo <= truth) & (truth <= smooth.hi))
    single, shrunk, smoothed = np.mean(errors, axis=0)
    assert single == pytest.approx(0.0445, abs=0.0015)
    assert shrunk == pytest.approx(0.0464, abs=0.0015)
    assert smoothed < 0.0216 + 0.001
    assert np.mean(inside) == pytest.approx(0.95, abs=0.04)


@pytest.mark.long
def test_over_many_draws_a_jumping_mass_is_smoothed_a_little_and_honestly(chapter):
    times, errors, inside = chapter.FINE, [], []
    truth = chapter.mass_change(times)
    exact = chapter.ratio(times, "mass")
    for seed in range(8):
        noisy = exact + chapter.ERROR_SD * np.random.default_rng(seed).standard_normal(201)
        each = mass_from_frequency(noisy, chapter.ERROR_SD, damping_ratio_0=0.05)
        over_time = chapter.smoothed(times, noisy, smoothness=0.5, straight=False)
        smooth = mass_from_frequency(over_time.mean, over_time.sd, damping_ratio_0=0.05)
        errors.append([rms(each.value - truth), rms(smooth.value - truth)])
        inside.append((smooth.lo <= truth) & (truth <= smooth.hi))
    single, smoothed = np.mean(errors, axis=0)
    assert smoothed < 0.95 * single
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
