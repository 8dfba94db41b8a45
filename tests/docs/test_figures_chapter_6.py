import csv
import importlib.util
import itertools
import pathlib
import struct
import sys

import numpy as np
import pytest

FOLDER = pathlib.Path(__file__).parents[2] / "docs/figures"
NAMES = ["figure_6_1", "figure_6_2", "figure_6_3"]


@pytest.fixture(scope="module")
def chapter():
    spec = importlib.util.spec_from_file_location("chapter_6", FOLDER / "chapter_6.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["chapter_6"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["chapter_6"]


@pytest.fixture(scope="module")
def drawn(chapter):
    return {name: lines_of() for name, lines_of in chapter.FIGURES.items()}


def stored(name):
    with (FOLDER / f"{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    series = itertools.groupby(rows, key=lambda row: (row["panel"], row["series"]))
    return {key: list(of_series) for key, of_series in series}


def numbers(rows, column):
    return np.array([float(row[column] or "nan") for row in rows])


def test_there_is_nothing_but_these_figures(chapter):
    assert (
        list(chapter.FIGURES) == NAMES == sorted(p.stem for p in FOLDER.glob("figure_6_*.png"))
    )
    assert set(chapter.CAPTIONS) == set(chapter.PANELS) == set(NAMES)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_the_data_behind_a_figure_come_out_of_the_library_again(drawn, name):
    kept = stored(name)
    assert [(line.panel, line.name) for line in drawn[name]] == list(kept)
    for line in drawn[name]:
        rows = kept[line.panel, line.name]
        # What was learnt by an optimiser may differ a little between processors.
        relative = 0.1 if name == "figure_6_3" else 0.02
        np.testing.assert_allclose(numbers(rows, "abscissa"), line.abscissa)
        np.testing.assert_allclose(numbers(rows, "value"), line.value, rtol=relative, atol=2e-3)
        for column, end in (("lo", line.lo), ("hi", line.hi)):
            expected = np.full(len(rows), np.nan) if end is None else end
            np.testing.assert_allclose(
                numbers(rows, column), expected, rtol=relative, atol=2e-3
            )


@pytest.mark.long
def test_what_the_captions_say_is_so(chapter, drawn):
    model, learnt = drawn["figure_6_1"][:2]
    assert np.abs(learnt.value - model.value).max() < 1e-3
    assert np.mean((learnt.lo <= model.value) & (model.value <= learnt.hi)) > 0.9
    for name, k, truth in (
        ("figure_6_1", 4, chapter.stiffness_change),
        ("figure_6_2", 1, chapter.stiffness_change),
        ("figure_6_2", 3, chapter.mass_change),
    ):
        assert chapter.held(drawn[name][k], truth(chapter.SLOW)) > 88.0
    *errors, shares = drawn["figure_6_3"]
    for line in errors:
        assert line.value[-1] < 0.5 * line.value[0]
    assert shares.value[[0, 9]].min() > shares.value[[4, 5]].max()
    assert shares.value.sum() == pytest.approx(1.0, abs=0.05)
    for name, lines in drawn.items():
        assert "{" not in chapter.caption(name, lines)


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_is_a_picture_of_some_size(name):
    width, height = struct.unpack(">II", (FOLDER / f"{name}.png").read_bytes()[16:24])
    assert width > 1000
    assert height > 400
