"""Draw figures 5.2 to 5.6 of the book with the library, beside what ought to be drawn.

``python docs/figures/chapter_5.py`` writes ``figure_5_2.png`` to ``figure_5_6.png`` and, beside
each, a CSV with the very numbers that it shows.
"""

import argparse
import csv
import dataclasses
import pathlib
import textwrap
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np

from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime.estimation import filtering
from slowtime.estimation.hyperparameters import fit
from slowtime.evolution import Change, mass_from_frequency, stiffness_from_frequency
from slowtime.evolution.stiffness_mass import book_formulas
from slowtime.evolution.stiffness_mass.forward_model import damped_frequency_ratio

HERE = pathlib.Path(__file__).parent
DAMPING = 0.05
ERROR_SD = 0.025
"""Of a frequency, relative to the nominal one: the book gives sigma_theta without a unit."""

SEED = 9
DENSE = np.arange(0.0, 1001.0, 2.0)
DENSER = np.arange(0.0, 1000.5, 0.5)
"""For the mass, whose jumps a coarser line would cut short."""

COARSE = np.arange(0.0, 1001.0, 20.0)
FINE = np.arange(0.0, 1001.0, 5.0)

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclasses.dataclass(frozen=True, slots=True)
class Line:
    """One curve or row of points of a figure, with its 95 % interval where it has one."""

    name: str
    slow_time: Array
    value: Array
    lo: Array | None = None
    hi: Array | None = None


def ratio(slow_time: Array, which: str) -> Array:
    """Damped frequency over the nominal undamped one, when stiffness or mass alone changes."""
    none = np.zeros_like(slow_time)
    if which == "stiffness":
        return damped_frequency_ratio(stiffness_change(slow_time), damping_ratio_0=DAMPING)
    return damped_frequency_ratio(none, mass_change(slow_time), damping_ratio_0=DAMPING)


def noisy_ratio(slow_time: Array, which: str) -> Array:
    """Read the same with the book's error, the same at every call."""
    error = np.random.default_rng(SEED).standard_normal(len(slow_time))
    return ratio(slow_time, which) + ERROR_SD * error


def smoothed(
    slow_time: Array, readings: Array, *, smoothness: float, straight: bool
) -> filtering.SmoothedProcess:
    """Smooth readings over slow time: a Matérn process about a mean, learnt from them."""
    sd = np.full_like(readings, ERROR_SD)
    learnt = fit(slow_time, readings, sd, smoothness=smoothness, straight=straight)
    return filtering.smooth(learnt.process, slow_time, readings, sd)


def line(name: str, slow_time: Array, change: Change, sign: float = 1.0) -> Line:
    """Make a line of an estimate with its interval; -1 shows loss as positive."""
    lo, hi = (change.lo, change.hi) if sign > 0 else (-change.hi, -change.lo)
    return Line(name, slow_time, sign * change.value, lo, hi)


def figure_5_2() -> list[Line]:
    """Stiffness and mass as the book lets them evolve (eq. 5.12, 5.13)."""
    every = np.arange(0.0, 1001.0, 1.0)
    return [
        Line("stiffness k/k0", every, 1.0 + stiffness_change(every)),
        Line("mass m/m0", every, 1.0 + mass_change(every)),
    ]


def figure_5_3() -> list[Line]:
    """Exact frequencies and the stiffness they give (eq. 5.20)."""
    found = book_formulas.stiffness(
        book_formulas.distance(ratio(COARSE, "stiffness"), DAMPING), DAMPING
    )
    return [
        Line("distance", DENSE, book_formulas.distance(ratio(DENSE, "stiffness"), DAMPING)),
        Line("samples", COARSE, book_formulas.distance(ratio(COARSE, "stiffness"), DAMPING)),
        Line("truth", DENSE, -stiffness_change(DENSE)),
        Line("eq. 5.20", COARSE, -found),
    ]


def figure_5_4() -> list[Line]:
    """Noisy frequencies: unbiased estimate, eq. 5.30, and smoothing over slow time."""
    noisy = noisy_ratio(COARSE, "stiffness")
    each = stiffness_from_frequency(noisy, ERROR_SD, damping_ratio_0=DAMPING)
    by_book = book_formulas.stiffness_error_size_known(
        book_formulas.distance(noisy, DAMPING), ERROR_SD, DAMPING
    )
    over_time = smoothed(COARSE, noisy, smoothness=2.5, straight=True)
    smooth = stiffness_from_frequency(over_time.mean, over_time.sd, damping_ratio_0=DAMPING)
    return [
        Line("truth", DENSE, -stiffness_change(DENSE)),
        line("unbiased, each reading", COARSE, each, -1.0),
        Line("eq. 5.30", COARSE, -by_book),
        line("smoothed over slow time", COARSE, smooth, -1.0),
    ]


def figure_5_5() -> list[Line]:
    """Exact frequencies, two sampling rates, and the mass they give (eq. 5.39, 5.40)."""
    lines = [
        Line("distance", DENSER, book_formulas.distance(ratio(DENSER, "mass"), DAMPING)),
        Line("truth", DENSER, mass_change(DENSER)),
    ]
    for name, times in (("coarse", COARSE), ("fine", FINE)):
        distance = book_formulas.distance(ratio(times, "mass"), DAMPING)
        truth = mass_change(times)
        lines += [
            Line(f"{name} samples", times, distance),
            Line(f"eq. 5.39, {name}", times, book_formulas.mass(distance, DAMPING)),
            Line(
                f"error of eq. 5.40, {name}",
                times,
                book_formulas.mass_light_damping(distance) - truth,
            ),
        ]
    return lines


def figure_5_6() -> list[Line]:
    """Noisy frequencies, two sampling rates: each reading, eq. 5.47, and smoothing."""
    lines = [Line("truth", DENSER, mass_change(DENSER))]
    for name, times in (("coarse", COARSE), ("fine", FINE)):
        noisy = noisy_ratio(times, "mass")
        each = mass_from_frequency(noisy, ERROR_SD, damping_ratio_0=DAMPING)
        by_book = book_formulas.mass_error_size_known(
            book_formulas.distance(noisy, DAMPING), ERROR_SD
        )
        # Rough: the mass jumps, and a smooth process would swing before and after each jump.
        over_time = smoothed(times, noisy, smoothness=0.5, straight=False)
        smooth = mass_from_frequency(over_time.mean, over_time.sd, damping_ratio_0=DAMPING)
        lines += [
            line(f"bias removed, each reading, {name}", times, each),
            Line(f"eq. 5.47, {name}", times, by_book),
            line(f"smoothed over slow time, {name}", times, smooth),
        ]
    return lines


FIGURES: dict[str, Callable[[], list[Line]]] = {
    "figure_5_2": figure_5_2,
    "figure_5_3": figure_5_3,
    "figure_5_4": figure_5_4,
    "figure_5_5": figure_5_5,
    "figure_5_6": figure_5_6,
}

CAPTIONS: dict[str, str] = tomllib.loads((HERE / "captions.toml").read_text())

TRUTH, OURS, BOOK, SOFT = "#1d2733", "#0b6e99", "#c4572a", "#8a97a6"


def write_csv(path: pathlib.Path, lines: list[Line]) -> None:
    """Write the numbers of a figure, one row a point, to 12 digits."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["series", "slow_time_over_t0", "value", "lo", "hi"])
        for one in lines:
            empty = [""] * len(one.value)
            lo = empty if one.lo is None else [f"{v:.12g}" for v in one.lo]
            hi = empty if one.hi is None else [f"{v:.12g}" for v in one.hi]
            for t, v, low, high in zip(one.slow_time, one.value, lo, hi, strict=True):
                writer.writerow([one.name, f"{t:.12g}", f"{v:.12g}", low, high])


def rmse(one: Line, which: str) -> float:
    """Root mean square error of a line of figure 5.4 or 5.6."""
    truth = -stiffness_change(one.slow_time) if which == "5_4" else mass_change(one.slow_time)
    return float(np.sqrt(np.mean((one.value - truth) ** 2)))


def caption(name: str, lines: list[Line]) -> str:
    """Caption of a figure, with the errors of this very draw."""
    by_name = {one.name: one for one in lines}
    if name == "figure_5_4":
        shown = ["unbiased, each reading", "eq. 5.30", "smoothed over slow time"]
    elif name == "figure_5_6":
        shown = [
            "bias removed, each reading, fine",
            "eq. 5.47, fine",
            "smoothed over slow time, fine",
        ]
    else:
        return CAPTIONS[name]
    return CAPTIONS[name].format(*(rmse(by_name[one], name[-3:]) for one in shown))


def draw(name: str, lines: list[Line], path: pathlib.Path) -> None:
    """Draw one figure."""
    from matplotlib import style
    from matplotlib.figure import Figure

    by_name = {one.name: one for one in lines}
    panels = PANELS[name]
    width, height = max(7.2, 4.3 * len(panels)), 3.3
    text = textwrap.fill(caption(name, lines), round(16.6 * width))
    foot = 0.165 * (text.count("\n") + 1) + 0.2
    with style.context(HERE / "chapter_5.mplstyle"):
        figure = Figure(figsize=(width, height + foot))
        all_axes = figure.subplots(1, len(panels), squeeze=False)
        for axes, panel in zip(all_axes[0], panels, strict=True):
            _panel(axes, panel, by_name)
        figure.tight_layout(rect=(0, foot / (height + foot), 1, 1), w_pad=2.0)
        figure.text(0.012, 0.1 / (height + foot), text, fontsize=8.2, color=TRUTH, va="bottom")
        figure.savefig(path, metadata={"Software": None})


@dataclasses.dataclass(frozen=True, slots=True)
class Mark:
    """How one line is drawn: its name, its label, its colour, and whether as points."""

    name: str
    label: str
    colour: str
    points: bool = False
    size: float = 3.2


@dataclasses.dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes: title, label of the ordinate, marks, limits of the ordinate."""

    title: str
    ordinate: str
    marks: tuple[Mark, ...]
    limits: tuple[float, float] | None = None
    until: float = 1000.0


LOSS, GAIN = "loss of stiffness, −Δk", "change of mass, Δm"
TRUE_LOSS = Mark("truth", "actual system", TRUTH)
PANELS: dict[str, tuple[Panel, ...]] = {
    "figure_5_2": (
        Panel(
            "",
            "over the nominal value",
            (
                Mark("mass m/m0", "mass  m(ts)/m0", BOOK),
                Mark("stiffness k/k0", "stiffness  k(ts)/k0", OURS),
            ),
            (0.6, 1.38),
        ),
    ),
    "figure_5_3": (
        Panel(
            "(a) fall of the damped frequency",
            "(ωd0 − ωds)/ω0",
            (
                Mark("distance", "actual change", TRUTH),
                Mark("samples", "samples for the twin", OURS, points=True),
            ),
            (-0.015, 0.25),
        ),
        Panel(
            "(b) twin from exact data",
            LOSS,
            (TRUE_LOSS, Mark("eq. 5.20", "eq. 5.20", OURS, points=True)),
            (-0.03, 0.44),
        ),
    ),
    "figure_5_4": tuple(
        Panel(title, LOSS, (TRUE_LOSS, mark), (-0.16, 0.62))
        for title, mark in (
            (
                "(a) each reading, unbiased",
                Mark("unbiased, each reading", "estimate and 95 % interval", OURS, points=True),
            ),
            (
                "(b) the book's eq. 5.30",
                Mark("eq. 5.30", "eq. 5.30, no interval", BOOK, points=True),
            ),
            (
                "(c) smoothed over slow time",
                Mark("smoothed over slow time", "estimate and 95 % band", OURS),
            ),
        )
    ),
    "figure_5_5": (
        Panel(
            "(a) change of the damped frequency",
            "(ωd0 − ωds)/ω0",
            (
                Mark("distance", "actual", SOFT),
                Mark("fine samples", "every 5 T0", OURS, points=True, size=2.2),
                Mark("coarse samples", "every 20 T0", BOOK, points=True, size=3.6),
            ),
            (-0.19, 0.2),
            until=500.0,
        ),
        Panel(
            "(b) twin from exact data, eq. 5.39",
            GAIN,
            (
                Mark("truth", "actual system", SOFT),
                Mark("eq. 5.39, fine", "every 5 T0", OURS, points=True, size=2.2),
                Mark("eq. 5.39, coarse", "every 20 T0", BOOK, points=True, size=3.6),
            ),
            (-0.3, 0.4),
            until=500.0,
        ),
        Panel(
            "(c) what eq. 5.40 is off by",
            "error of Δm",
            (Mark("error of eq. 5.40, fine", "eq. 5.40, every 5 T0", BOOK, points=True),),
            (-0.0013, 0.0016),
            until=500.0,
        ),
    ),
    "figure_5_6": tuple(
        Panel(
            title,
            GAIN,
            (Mark("truth", "actual system", SOFT), mark),
            (-0.5, 0.75),
            until=500.0,
        )
        for title, mark in (
            (
                "(a) each reading, bias removed",
                Mark(
                    "bias removed, each reading, fine",
                    "estimate and 95 % interval",
                    OURS,
                    points=True,
                    size=2.4,
                ),
            ),
            (
                "(b) the book's eq. 5.47",
                Mark("eq. 5.47, fine", "eq. 5.47, no interval", BOOK, points=True, size=2.8),
            ),
            (
                "(c) smoothed over slow time",
                Mark("smoothed over slow time, fine", "estimate and 95 % band", OURS),
            ),
        )
    ),
}


def _panel(axes: Any, panel: Panel, by_name: dict[str, Line]) -> None:
    for depth, mark in enumerate(panel.marks):
        one = by_name[mark.name]
        if mark.points:
            if one.lo is not None and one.hi is not None:
                axes.vlines(
                    one.slow_time, one.lo, one.hi, color=mark.colour, alpha=0.28, lw=1.1
                )
            axes.plot(
                one.slow_time,
                one.value,
                "o",
                ms=mark.size,
                mec="none",
                color=mark.colour,
                label=mark.label,
                zorder=3 + depth,
            )
        else:
            if one.lo is not None and one.hi is not None:
                axes.fill_between(
                    one.slow_time, one.lo, one.hi, color=mark.colour, alpha=0.2, lw=0
                )
            axes.plot(
                one.slow_time,
                one.value,
                color=mark.colour,
                lw=1.4,
                label=mark.label,
                zorder=2 + depth,
            )
    axes.set_xlim(0, panel.until)
    axes.set_xlabel("slow time  ts/T0")
    axes.set_ylabel(panel.ordinate)
    axes.set_title(panel.title)
    if panel.limits is not None:
        axes.set_ylim(*panel.limits)
    axes.legend(loc="upper left", ncols=3)


def main() -> None:
    """Write data and pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--out", type=pathlib.Path, default=HERE, help="folder to write into")
    out: pathlib.Path = parser.parse_args().out
    for name, lines_of in FIGURES.items():
        lines = lines_of()
        write_csv(out / f"{name}.csv", lines)
        draw(name, lines, out / f"{name}.png")
        print(f"{out / name}.png")


if __name__ == "__main__":
    main()
