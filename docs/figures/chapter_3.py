"""Draw figures 3.3 and 3.6 to 3.11 of the book with the library, beside what ought to be drawn.

``python docs/figures/chapter_3.py`` writes ``figure_3_3.png`` … and, beside each, a CSV with
the very numbers that it shows.
"""

import argparse
import csv
import dataclasses
import math
import pathlib
import textwrap
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np

from slowtime.dynamics.builders import chain
from slowtime.dynamics.closed_form_motion import free_motion, pulse_motion
from slowtime.dynamics.description import assemble
from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.response import frequency_response, impulse_response
from slowtime.dynamics.structure import Structure
from slowtime.dynamics.transfer import laplace_response

HERE = pathlib.Path(__file__).parent
DAMPING = (0.01, 0.1, 0.25, 0.5)
PULSE_S = 0.6
"""Of the force in figures 3.6 and 3.7: the book's own number is lost."""

TIME = np.linspace(0.0, 20.0, 801)
OMEGA = np.linspace(0.0, 2.0, 801)
E1, E2, E23 = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 1.0])
REST = np.zeros(3)

Array = np.ndarray[Any, np.dtype[np.float64]]
INK, COLOURS = "#1d2733", ("#0b6e99", "#c4572a", "#1d2733", "#8a97a6")


@dataclasses.dataclass(frozen=True, slots=True)
class Line:
    """One curve, of one pair of axes."""

    panel: str
    name: str
    abscissa: Array
    value: Array


@dataclasses.dataclass(frozen=True, slots=True)
class Axes:
    """How a panel is labelled and scaled."""

    title: str
    abscissa: str
    ordinate: str
    limits: tuple[float, float]
    logarithmic: bool = False


def example_3_3() -> Structure:
    """Three equal masses between four equal springs, each with a dashpot to the ground."""
    return assemble(chain([1.0] * 3, [1.0] * 4, ground_dampings_n_s_per_m=[0.2] * 3))


def figure_3_3() -> list[Line]:
    """Impulse and frequency response of one degree of freedom, without dimensions."""
    periods, ratio = np.linspace(0.0, 10.0, 1001), np.linspace(0.0, 2.0, 801)
    lines = []
    for damping in DAMPING:
        # Of unit mass and frequency, so that m omega_n h and k H are what comes out.
        one = Oscillator(1.0, 2 * damping, 1.0)
        h = impulse_response(one, 2 * math.pi * periods)
        lines.append(Line("a", f"ζ = {damping:g}", periods, h))
    for damping in DAMPING:
        one = Oscillator(1.0, 2 * damping, 1.0)
        gain = np.abs(frequency_response(one, ratio))
        lines.append(Line("b", f"ζ = {damping:g}", ratio, gain))
    return lines


def spectrum(**start: Array) -> list[Line]:
    """Absolute value of the frequency-domain response of the three masses."""
    q = np.abs(laplace_response(example_3_3(), 1j * OMEGA, **start))
    return [Line("a", f"DOF {k + 1}", OMEGA, q[:, k]) for k in range(3)]


def motion(q: Array) -> list[Line]:
    """Time-domain response of the three masses."""
    return [Line("a", f"DOF {k + 1}", TIME, q[:, k]) for k in range(3)]


def figure_3_6() -> list[Line]:
    """Response in frequency to a pulse on the first mass (eq. 3.183)."""
    # Transform of the pulse, (1 - e^{-s t0}) / s, without its quotient 0 / 0.
    half = OMEGA * PULSE_S / 2
    force = PULSE_S * np.exp(-1j * half) * np.sinc(half / np.pi)
    q = np.abs(laplace_response(example_3_3(), 1j * OMEGA, force=np.outer(force, E1)))
    return [Line("a", f"DOF {k + 1}", OMEGA, q[:, k]) for k in range(3)]


def figure_3_7() -> list[Line]:
    """Response in time to the same (eq. 3.137 with 3.186, and what comes before its end)."""
    return motion(pulse_motion(example_3_3(), TIME, E1, PULSE_S)[0])


def figure_3_8() -> list[Line]:
    """Response in frequency to a unit initial displacement of the second mass (eq. 3.193)."""
    return spectrum(displacement=E2)


def figure_3_9() -> list[Line]:
    """Response in time to the same (eq. 3.194, with its sine)."""
    return motion(free_motion(example_3_3(), TIME, E2, REST)[0])


def figure_3_10() -> list[Line]:
    """Response in frequency to unit initial velocity of second and third mass (eq. 3.196)."""
    return spectrum(velocity=E23)


def figure_3_11() -> list[Line]:
    """Response in time to the same (eq. 3.197)."""
    return motion(free_motion(example_3_3(), TIME, REST, E23)[0])


FIGURES: dict[str, Callable[[], list[Line]]] = {
    "figure_3_3": figure_3_3,
    "figure_3_6": figure_3_6,
    "figure_3_7": figure_3_7,
    "figure_3_8": figure_3_8,
    "figure_3_9": figure_3_9,
    "figure_3_10": figure_3_10,
    "figure_3_11": figure_3_11,
}

CAPTIONS: dict[str, str] = tomllib.loads((HERE / "captions_3.toml").read_text())
FREQUENCY = Axes("", "frequency ω [rad/s]", "|q(iω)|", (0.1, 10.0), logarithmic=True)
PANELS: dict[str, dict[str, Axes]] = {
    "figure_3_3": {
        "a": Axes("(a) impulse response", "time  t ωn/2π", "m ωn h(t)", (-1.0, 1.05)),
        "b": Axes("(b) frequency response", "frequency  ω/ωn", "k |H(iω)|", (0.1, 100.0), True),
    },
    "figure_3_7": {"a": Axes("", "time [s]", "q(t) [m]", (-0.4, 0.4))},
    "figure_3_9": {"a": Axes("", "time [s]", "q(t) [m]", (-0.8, 1.05))},
    "figure_3_11": {"a": Axes("", "time [s]", "q(t) [m]", (-1.05, 1.15))},
} | {f"figure_3_{k}": {"a": FREQUENCY} for k in (6, 8, 10)}


def write_csv(path: pathlib.Path, lines: list[Line]) -> None:
    """Write the numbers of a figure, one row a point, to 12 digits."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["panel", "series", "abscissa", "value"])
        for one in lines:
            for x, y in zip(one.abscissa, one.value, strict=True):
                writer.writerow([one.panel, one.name, f"{x:.12g}", f"{y:.12g}"])


def draw(name: str, lines: list[Line], path: pathlib.Path) -> None:
    """Draw one figure."""
    from matplotlib import style
    from matplotlib.figure import Figure

    panels = PANELS[name]
    width, height = max(7.2, 4.6 * len(panels)), 3.3
    text = textwrap.fill(CAPTIONS[name], round(16.6 * width))
    foot = 0.165 * (text.count("\n") + 1) + 0.2
    with style.context(HERE / "chapter_5.mplstyle"):
        figure = Figure(figsize=(width, height + foot))
        all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, (key, panel) in zip(all_axes, panels.items(), strict=True):
            _panel(axes, panel, [one for one in lines if one.panel == key])
        figure.tight_layout(rect=(0, foot / (height + foot), 1, 1), w_pad=2.0)
        figure.text(0.012, 0.1 / (height + foot), text, fontsize=8.2, color=INK, va="bottom")
        figure.savefig(path, metadata={"Software": None})


def _panel(axes: Any, panel: Axes, lines: list[Line]) -> None:
    # The third on top of the first, dashed where they are one.
    for colour, dashes, one in zip(COLOURS, ("-", "-", "--", "-"), lines, strict=False):
        axes.plot(one.abscissa, one.value, dashes, color=colour, lw=1.4, label=one.name)
    axes.set_xlim(lines[0].abscissa[0], lines[0].abscissa[-1])
    axes.set_ylim(*panel.limits)
    if panel.logarithmic:
        axes.set_yscale("log")
    axes.set(xlabel=panel.abscissa, ylabel=panel.ordinate, title=panel.title)
    axes.legend(loc="upper right", ncols=2)


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
