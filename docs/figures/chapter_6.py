"""Draw figures 6.1 to 6.3: surrogates of a frame's frequencies, and the twin that reads them.

``python docs/figures/chapter_6.py`` writes ``figure_6_1.png`` to ``figure_6_3.png`` and, beside
each, a CSV with the very numbers that it shows. The book's own figures of this chapter are of
one oscillator; a structure needs the surrogate.
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
from scipy import stats
from scipy.stats import qmc

from slowtime import surrogate
from slowtime.dynamics.builders import shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime.dynamics.modes import undamped_modes
from slowtime.evolution.stiffness_mass.surrogate_inversion import changes_from_frequencies
from slowtime.surrogate.problems import PROBLEMS

HERE = pathlib.Path(__file__).parent
SEED = 6
SLOW = np.arange(0.0, 1001.0, 20.0)
DENSE = np.arange(0.0, 1001.0, 2.0)
POINTS = {"figure_6_1": 5, "figure_6_2": 30}
NOISE = {"figure_6_1": 5e-3, "figure_6_2": 1e-3}
RUNS = (25, 40, 80)

Array = np.ndarray[Any, np.dtype[np.float64]]
INK, OURS, OTHER, SOFT = "#1d2733", "#0b6e99", "#c4572a", "#8a97a6"


@dataclasses.dataclass(frozen=True, slots=True)
class Line:
    """One curve or row of points of a panel, with its 95 % band where it has one."""

    panel: str
    name: str
    abscissa: Array
    value: Array
    lo: Array | None = None
    hi: Array | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Axes:
    """How a panel is labelled, and which of its lines are points or bars."""

    title: str
    abscissa: str
    ordinate: str
    logarithmic: bool = False
    bars: bool = False


def frequencies(stiffness: Array, mass: Array) -> Array:
    """Run the model: three frequencies [Hz] for changes of lowest storey and top floor."""
    found = []
    for k, m in zip(stiffness.tolist(), mass.tolist(), strict=True):
        storeys, floors = [1e8] * 5, [5e4] * 5
        storeys[0] *= 1.0 + k
        floors[4] *= 1.0 + m
        found.append(undamped_modes(assemble(shear_frame(floors, storeys))).frequency_hz[:3])
    return np.array(found)


def readings(truth: Array, name: str) -> tuple[Array, Array]:
    """Frequencies with errors, the same at every call, and the deviations of these."""
    sd = NOISE[name] * truth
    return truth + sd * np.random.default_rng(SEED).standard_normal(truth.shape), sd


def figure_6_1() -> list[Line]:
    """One change: surrogate, truth and runs; then stiffness over slow time."""
    runs, fine = np.linspace(-0.45, 0.05, POINTS["figure_6_1"]), np.linspace(-0.45, 0.05, 101)
    learnt = surrogate.GaussianProcess("squared exponential").fit(
        runs[:, None], frequencies(runs, np.zeros_like(runs))[:, 0]
    )
    lo, hi = learnt.predict_interval(fine[:, None])
    truth = frequencies(fine, np.zeros_like(fine))[:, 0]
    at_runs = frequencies(runs, np.zeros_like(runs))[:, 0]
    changed = stiffness_change(SLOW)
    read, sd = readings(frequencies(changed, np.zeros_like(changed))[:, :1], "figure_6_1")
    prior = [stats.uniform(-0.45, 0.5)]
    found = changes_from_frequencies([learnt], read, sd, prior=prior).each[0]
    return [
        Line("a", "model", fine, truth),
        Line("a", "surrogate and 95 % band", fine, learnt.predict(fine[:, None]), lo, hi),
        Line("a", "runs", runs, at_runs),
        Line("b", "actual", DENSE, stiffness_change(DENSE)),
        Line("b", "each reading and 95 % interval", SLOW, found.value, found.lo, found.hi),
    ]


def figure_6_2() -> list[Line]:
    """Two changes from three frequencies, over slow time."""
    unit = qmc.LatinHypercube(2, rng=np.random.default_rng(SEED)).random(POINTS["figure_6_2"])
    runs = qmc.scale(unit, [-0.45, -0.35], [0.05, 0.35])
    outputs = frequencies(runs[:, 0], runs[:, 1])
    # The edge of the box lies off the design by less than the surrogate can do without.
    modes = [
        surrogate.PolynomialChaos(
            marginals=[stats.uniform(-0.45, 0.5), stats.uniform(-0.35, 0.7)],
            extrapolation="ignore",
        ).fit(runs, outputs[:, j])
        for j in range(3)
    ]
    truth = frequencies(stiffness_change(SLOW), mass_change(SLOW))
    read, sd = readings(truth, "figure_6_2")
    prior = [stats.uniform(-0.45, 0.5), stats.uniform(-0.35, 0.7)]
    found = changes_from_frequencies(modes, read, sd, prior=prior)
    stiffness, mass = found.each
    each = "each reading and 95 % interval"
    return [
        Line("a", "actual", DENSE, stiffness_change(DENSE)),
        Line("a", each, SLOW, stiffness.value, stiffness.lo, stiffness.hi),
        Line("b", "actual", DENSE, mass_change(DENSE)),
        Line("b", each, SLOW, mass.value, mass.lo, mass.hi),
    ]


def figure_6_3() -> list[Line]:
    """Ten changes: error over the number of runs, and what matters."""
    problem = PROBLEMS["frame"]
    asked, truth = problem.draws(200, np.random.default_rng(SEED))
    kinds = {
        "polynomial chaos": surrogate.PolynomialChaos(
            marginals=problem.marginals, extrapolation="ignore"
        ),
        "Gaussian process": surrogate.GaussianProcess(
            starts=1, folds=1, extrapolation="ignore"
        ),
        "H-PCFE": surrogate.HybridExpansion(
            marginals=problem.marginals, starts=1, folds=1, extrapolation="ignore"
        ),
    }
    designs = [problem.design(count, np.random.default_rng([SEED, count])) for count in RUNS]
    lines = []
    for name, kind in kinds.items():
        errors = [
            np.sqrt(np.mean((kind.fit(*design).predict(asked) - truth) ** 2)) / truth.std()
            for design in designs
        ]
        lines.append(Line("a", name, np.array(RUNS, float), np.array(errors)))
    chaos = kinds["polynomial chaos"].fit(*designs[-1])
    assert isinstance(chaos, surrogate.PolynomialChaos)
    lines.append(Line("b", "first-order index", np.arange(10.0), chaos.sobol_first_))
    return lines


FIGURES: dict[str, Callable[[], list[Line]]] = {
    "figure_6_1": figure_6_1,
    "figure_6_2": figure_6_2,
    "figure_6_3": figure_6_3,
}

CAPTIONS: dict[str, str] = tomllib.loads((HERE / "captions_6.toml").read_text())
SLOWLY = "slow time  ts/T0"
PANELS: dict[str, dict[str, Axes]] = {
    "figure_6_1": {
        "a": Axes("(a) surrogate of the model", "change of stiffness, Δk", "f1 [Hz]"),
        "b": Axes("(b) turned round by the twin", SLOWLY, "change of stiffness, Δk"),
    },
    "figure_6_2": {
        "a": Axes("(a) lowest storey", SLOWLY, "change of stiffness, Δk"),
        "b": Axes("(b) top floor", SLOWLY, "change of mass, Δm"),
    },
    "figure_6_3": {
        "a": Axes("(a) error", "runs of the model", "error / spread", logarithmic=True),
        "b": Axes("(b) what matters", "", "share of the variance", bars=True),
    },
}
CHANGES = [*(f"k{i}" for i in range(1, 6)), *(f"m{i}" for i in range(1, 6))]


def held(line: Line, truth: Array) -> float:
    """Share of the intervals of a line that hold the truth [%]."""
    assert line.lo is not None
    assert line.hi is not None
    return 100.0 * float(np.mean((line.lo <= truth) & (truth <= line.hi)))


def caption(name: str, lines: list[Line]) -> str:
    """Caption of a figure, with the numbers of this very draw."""
    told: dict[str, float] = {"points": POINTS.get(name, 0)}
    if name == "figure_6_1":
        told["worst"] = float(np.abs(lines[1].value - lines[0].value).max())
        told["noise"] = 100.0 * NOISE[name]
        told["held"] = held(lines[4], stiffness_change(SLOW))
    elif name == "figure_6_2":
        told["stiffness"] = held(lines[1], stiffness_change(SLOW))
        told["mass"] = held(lines[3], mass_change(SLOW))
    return CAPTIONS[name].format(**told)


def write_csv(path: pathlib.Path, lines: list[Line]) -> None:
    """Write the numbers of a figure, one row a point, to 10 digits."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["panel", "series", "abscissa", "value", "lo", "hi"])
        for one in lines:
            nothing = np.full(len(one.value), np.nan)
            lo = nothing if one.lo is None else one.lo
            hi = nothing if one.hi is None else one.hi
            for row in zip(one.abscissa, one.value, lo, hi, strict=True):
                numbers = ["" if np.isnan(value) else f"{value:.10g}" for value in row]
                writer.writerow([one.panel, one.name, *numbers])


def draw(name: str, lines: list[Line], path: pathlib.Path) -> None:
    """Draw one figure."""
    from matplotlib import style
    from matplotlib.figure import Figure

    text = textwrap.fill(caption(name, lines), 142)
    foot, height = 0.165 * (text.count("\n") + 1) + 0.2, 3.3
    with style.context(HERE / "chapter_5.mplstyle"):
        figure = Figure(figsize=(8.6, height + foot))
        all_axes = figure.subplots(1, 2)
        for axes, (panel, how) in zip(all_axes, PANELS[name].items(), strict=True):
            _panel(axes, how, [one for one in lines if one.panel == panel])
        figure.tight_layout(rect=(0, foot / (height + foot), 1, 1), w_pad=2.0)
        figure.text(0.012, 0.1 / (height + foot), text, fontsize=8.2, color=INK, va="bottom")
        figure.savefig(path, metadata={"Software": None})


def _panel(axes: Any, how: Axes, lines: list[Line]) -> None:
    colours = iter((INK, OURS, OTHER) if len(lines) == 3 else (INK, OURS))
    for depth, one in enumerate(lines):
        colour = next(colours)
        if how.bars:
            axes.bar(CHANGES, one.value, color=OURS, width=0.6)
        elif one.name == "runs":
            axes.plot(
                one.abscissa, one.value, "o", ms=5, mec="none", color=colour, label=one.name
            )
        elif one.lo is not None and len(one.value) == len(SLOW):
            axes.vlines(one.abscissa, one.lo, one.hi, color=colour, alpha=0.35, lw=1.2)
            axes.plot(
                one.abscissa, one.value, "o", ms=3, mec="none", color=colour, label=one.name
            )
        else:
            if one.lo is not None:
                axes.fill_between(one.abscissa, one.lo, one.hi, color=colour, alpha=0.2, lw=0)
            dots = "o-" if how.logarithmic else "-"
            axes.plot(
                one.abscissa,
                one.value,
                dots,
                ms=4,
                color=colour,
                label=one.name,
                zorder=2 + depth,
            )
    axes.set_axisbelow(True)
    lowest, highest = axes.get_ylim()
    if how.logarithmic:
        axes.set_yscale("log")
    elif not how.bars:
        axes.set_ylim(lowest, highest + 0.25 * (highest - lowest))
    axes.set_title(how.title)
    axes.set_xlabel(how.abscissa)
    axes.set_ylabel(how.ordinate)
    if not how.bars:
        axes.legend(loc="upper right" if how.abscissa == SLOWLY else "best")


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
