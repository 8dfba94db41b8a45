"""Figures of Chapters 7 to 9: their data come out of the library again."""

import csv
import importlib
import itertools
import pathlib
import struct
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]
FOLDER = ROOT / "docs/figures"
NAMES = {
    "figure_7_1": "chapter_7",
    "figure_8_1": "chapter_8",
    "figure_9_1": "chapter_9",
    "figure_9_2": "chapter_9",
}
SLOW = ("figure_7_1", "figure_8_1")
figures = pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in NAMES],
)


@pytest.fixture(scope="module")
def figure():
    sys.path.insert(0, str(ROOT))
    found = {}

    def one(name):
        if name not in found:
            made = importlib.import_module(f"docs.figures.{NAMES[name]}").FIGURES[name]
            found[name] = made, made.lines()
        return found[name]

    yield one
    sys.path.remove(str(ROOT))


def stored(name):
    with (FOLDER / f"{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    series = itertools.groupby(rows, key=lambda row: (row["panel"], row["series"]))
    return {key: list(of_series) for key, of_series in series}


def numbers(rows, column):
    return np.array([float(row[column] or "nan") for row in rows])


@pytest.mark.long
@figures
def test_the_data_behind_a_figure_come_out_of_the_library_again(figure, name):
    kept, lines = stored(name), figure(name)[1]
    assert [(line.panel, line.name) for line in lines] == list(kept)
    for line in lines:
        rows = kept[line.panel, line.name]
        # What an optimiser has learnt may differ a little between processors.
        close = 2e-3 * float(np.ptp(line.value)) + 1e-9
        np.testing.assert_allclose(numbers(rows, "abscissa"), line.abscissa, rtol=1e-7)
        np.testing.assert_allclose(numbers(rows, "value"), line.value, rtol=0, atol=close)
        for column, end in (("lo", line.lo), ("hi", line.hi)):
            expected = np.full(len(rows), np.nan) if end is None else end
            np.testing.assert_allclose(numbers(rows, column), expected, rtol=0, atol=10 * close)


@pytest.mark.long
@figures
def test_a_figure_is_a_picture_of_some_size_with_a_caption(figure, name):
    head = (FOLDER / f"{name}.png").read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", head[16:24])
    assert 800 < width < 2400
    assert 400 < height < 1200
    made, lines = figure(name)
    text = made.caption(lines)
    assert text.startswith(f"Figure {name[-3:].replace('_', '.')}.")
    assert "nan" not in text


def test_there_is_nothing_but_these_figures():
    drawn = [path.stem for chapter in "789" for path in FOLDER.glob(f"figure_{chapter}_*.png")]
    assert sorted(drawn) == list(NAMES)


@pytest.mark.slow
def test_forecasts_of_figure_7_1_hold_what_came(figure):
    lines = figure("figure_7_1")[1]
    by_name = {(line.panel, line.name): line for line in lines}
    for panel in "abc":
        ahead, truth = by_name[panel, "forecast, 95 %"], by_name[panel, "actual system"]
        true = np.interp(ahead.abscissa, truth.abscissa, truth.value)
        assert np.mean((ahead.lo <= true) & (true <= ahead.hi)) > 0.8
