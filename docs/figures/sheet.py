"""What the figures of Chapters 7 to 9 have in common: lines, panels, files."""

import argparse
import csv
import dataclasses
import pathlib
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

HERE = pathlib.Path(__file__).parent
TRUTH, OURS, OTHER, SOFT = "#1d2733", "#0b6e99", "#c4572a", "#8a97a6"

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclasses.dataclass(frozen=True, slots=True)
class Line:
    """One curve, band or row of points of a panel."""

    panel: str
    name: str
    abscissa: Array
    value: Array
    lo: Array | None = None
    hi: Array | None = None
    colour: str = OURS
    points: bool = False


@dataclasses.dataclass(frozen=True, slots=True)
class Figure:
    """Lines, the titles and ordinates of their panels, and what is said below."""

    lines: Callable[[], list[Line]]
    panels: Mapping[str, tuple[str, str, str]]
    caption: Callable[[Sequence[Line]], str]


def write_csv(path: pathlib.Path, lines: Sequence[Line]) -> None:
    """Write the numbers of a figure, one row a point, to 9 digits."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["panel", "series", "abscissa", "value", "lo", "hi"])
        for one in lines:
            empty = [""] * len(one.value)
            lo = empty if one.lo is None else [f"{v:.9g}" for v in one.lo]
            hi = empty if one.hi is None else [f"{v:.9g}" for v in one.hi]
            for x, v, low, high in zip(one.abscissa, one.value, lo, hi, strict=True):
                writer.writerow([one.panel, one.name, f"{x:.9g}", f"{v:.9g}", low, high])


def draw(figure: Figure, lines: Sequence[Line], path: pathlib.Path) -> None:
    """Draw one figure."""
    from matplotlib import style
    from matplotlib.figure import Figure as Sheet

    width, height = max(7.2, 4.3 * len(figure.panels)), 3.3
    text = textwrap.fill(figure.caption(lines), round(16.6 * width))
    foot = 0.165 * (text.count("\n") + 1) + 0.2
    with style.context(HERE / "chapter_5.mplstyle"):
        sheet = Sheet(figsize=(width, height + foot))
        row = sheet.subplots(1, len(figure.panels), squeeze=False)[0]
        for axes, (panel, (title, abscissa, ordinate)) in zip(
            row, figure.panels.items(), strict=True
        ):
            for one in lines:
                if one.panel == panel:
                    _line(axes, one)
            axes.set_title(title)
            axes.set_xlabel(abscissa)
            axes.set_ylabel(ordinate)
            axes.legend(loc="best")
        sheet.tight_layout(rect=(0, foot / (height + foot), 1, 1), w_pad=2.0)
        sheet.text(0.012, 0.1 / (height + foot), text, fontsize=8.2, color=TRUTH, va="bottom")
        sheet.savefig(path, metadata={"Software": None})


def _line(axes: Any, one: Line) -> None:
    if one.points:
        if one.lo is not None:
            axes.vlines(one.abscissa, one.lo, one.hi, color=one.colour, alpha=0.3, lw=1.1)
        axes.plot(
            one.abscissa, one.value, "o", ms=2.6, mec="none", color=one.colour, label=one.name
        )
        return
    if one.lo is not None:
        axes.fill_between(one.abscissa, one.lo, one.hi, color=one.colour, alpha=0.2, lw=0)
    axes.plot(one.abscissa, one.value, color=one.colour, lw=1.3, label=one.name)


def rmse(lines: Sequence[Line], panel: str, name: str, truth: str) -> float:
    """Root mean square distance of one line from another at the abscissae of the first."""
    by_name = {(one.panel, one.name): one for one in lines}
    own, true = by_name[panel, name], by_name[panel, truth]
    error = own.value - np.interp(own.abscissa, true.abscissa, true.value)
    return float(np.sqrt(np.mean(error**2)))


def main(figures: Mapping[str, Figure]) -> None:
    """Write data and pictures of a chapter."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=pathlib.Path, default=HERE, help="folder to write into")
    out: pathlib.Path = parser.parse_args().out
    for name, figure in figures.items():
        lines = figure.lines()
        write_csv(out / f"{name}.csv", lines)
        draw(figure, lines, out / f"{name}.png")
        print(f"{out / name}.png")
