"""Intervals of modes under every band, duration, neighbour and loss: how many hold.

Run `python -m benchmarks.methods.modal_settings --out FILE`. A record is that of four masses
whose modes are damped by 1 %, under white forces, with noise 20 dB below each channel's motion,
at 16 Hz. It is read as a file is read: stamps, gaps, then `identify`. There is one usual
setting, a cell for each other value of one factor (main effects), and cells in which all
factors are drawn. Each is simulated by `ambient_structure` and by SciPy (`scipy.signal.lsim` of
a structure of other shapes, white forces of eight times the rate).

Errors are compared with the Cramér-Rao bound of each mode alone (`ambient_law`), over the root
of the share of the samples that are there. A mode within the band is refused with reason where
the bound of its damping exceeds half of it. `--out FILE` writes each run as a line of JSON, and
makes no run that is there anew; `--method NAME` makes runs of one method (it may be repeated);
`--table` only prints what is there, as a page in Markdown.
"""

import argparse
import dataclasses
import itertools
import json
import sys
import time
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import scipy.linalg
import scipy.signal as sps
import scipy.stats
from scipy.interpolate import CubicSpline

from slowtime.dynamics.builders import chain
from slowtime.dynamics.damping import modal_damping
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.simulation import ambient_structure
from slowtime.identification.options import IdentifyOptions, Method
from slowtime.identification.single_mode.bounds import ambient_law
from slowtime_services.files import Record
from slowtime_services.files.times.even_samples import chosen_axis, sampled_evenly
from slowtime_services.files.times.time_axis import read_time
from slowtime_services.modal.identification import identify_record

RATE_HZ = 16.0
DAMPING = 0.01
NOISE = 0.1
LINE_HZ, LINE = 2.45, 0.5
"""Line of a rotor [Hz], and its standard deviation in that of a channel's motion [1]."""

FINE = 8
"""Steps of SciPy's simulation, and of a record whose samples jitter, in one sample [1]."""

JITTER_STEPS = 0.25
"""Samples are early or late by up to so much [steps], uniformly."""

LONGEST_GAP = 40
"""Of 1 to so many samples is a gap, uniformly."""

BANDS: dict[str, tuple[float, float] | None] = {
    "none": None, "0.5–6": (0.5, 6.0), "1.6–2.9": (1.6, 2.9), "1.9–2.3": (1.9, 2.3),
    "2.04–2.16": (2.04, 2.16), "1.5–2.13": (1.5, 2.13), "2.07–5": (2.07, 5.0),
    "0.8–3.6": (0.8, 3.6),
}  # fmt: skip
"""Bands [Hz], each with the mode at 2.1 Hz, whose half-power band is 2.08 to 2.12 Hz."""

CYCLES = {"300": 300, "600": 600, "1200": 1200, "2400": 2400}
NEIGHBOURS = {
    "separate": (1.0, 2.1, 3.3, 4.4), "close": (1.0, 2.1, 2.163, 4.4),
    "rotor": (1.0, 2.1, 3.3, 4.4), "outside": (1.0, 2.1, 2.35, 4.4),
}  # fmt: skip
"""Modes [Hz]: two 3 % apart; with the line of a rotor; with a neighbour beyond narrow bands."""

LOSSES = ("complete", "5 %", "20 %", "jitter")
FACTORS: dict[str, tuple[str, ...]] = {
    "band": tuple(BANDS), "cycles": tuple(CYCLES), "neighbours": tuple(NEIGHBOURS),
    "losses": LOSSES,
}  # fmt: skip
SIMULATORS = ("slowtime", "SciPy")
METHODS = ("modes", "bayes", "efdd", "fdd", "ambient")
USUAL = ("none", "1200", "separate", "complete")
ABOUT = 3.0
"""A mode is found where an estimate is nearer than so many half-bandwidths [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Cell:
    """One value of each factor."""

    band: str
    cycles: str
    neighbours: str
    losses: str

    @property
    def name(self) -> str:
        """Values, for tables and files."""
        return ", ".join(dataclasses.astuple(self))

    @property
    def frequencies_hz(self) -> np.ndarray:
        """True modes [Hz]."""
        return np.array(NEIGHBOURS[self.neighbours])

    @property
    def inside(self) -> np.ndarray:
        """Modes whose half-power band lies within the band."""
        low, high = BANDS[self.band] or (0.0, RATE_HZ)
        f = self.frequencies_hz
        return np.flatnonzero((f * (1 - DAMPING) >= low) & (f * (1 + DAMPING) <= high))


def main_cells() -> list[Cell]:
    """Return the usual cell, and those that differ from it in one factor."""
    usual = Cell(*USUAL)
    cells = [usual]
    for factor, values in FACTORS.items():
        others = [dataclasses.replace(usual, **{factor: value}) for value in values]
        cells += [one for one in others if one != usual]
    return cells


def random_cells(number: int) -> list[Cell]:
    """Cells of which all factors are drawn, none twice."""
    every = [Cell(*one) for one in itertools.product(*FACTORS.values())]
    mains = set(main_cells())
    drawn = [every[k] for k in np.random.default_rng(54).permutation(len(every))]
    return [one for one in drawn if one not in mains][:number]


def fine_motion(cell: Cell, simulator: str, rng: np.random.Generator) -> tuple[np.ndarray, int]:
    """Motion of all channels, and its steps in one sample."""
    count = round(int(cell.cycles) * RATE_HZ) + 2
    omega = 2 * np.pi * cell.frequencies_hz
    if simulator == "slowtime":
        fine = FINE if cell.losses == "jitter" else 1
        row = assemble(chain([1.0] * 4, [1.0] * 4))
        shapes = undamped_modes(row).shapes
        stiffness = shapes * omega**2 @ shapes.T
        damping = modal_damping(row.mass, stiffness, DAMPING)
        built = dataclasses.replace(row, stiffness=stiffness, damping=damping)
        return ambient_structure(built, fine * count, fine * RATE_HZ, rng), fine
    # Modes at 45 degrees to the masses and to each other, as no chain has them.
    shapes = scipy.linalg.hadamard(4) / 2.0
    top = np.hstack([np.zeros((4, 4)), np.eye(4)])
    low = np.hstack([-np.diag(omega**2), -np.diag(2 * DAMPING * omega)])
    system: Any = sps.StateSpace(
        np.vstack([top, low]),
        np.vstack([np.zeros((4, 4)), shapes.T]),
        np.hstack([np.zeros((4, 4)), shapes]),
        np.zeros((4, 4)),
    )
    before = round(6 / (DAMPING * omega[0]) * RATE_HZ) * FINE
    steps = np.arange(before + FINE * count) / (FINE * RATE_HZ)
    force = rng.standard_normal((len(steps), 4))
    return sps.lsim(system, force, steps)[1][before:], FINE


def record(cell: Cell, simulator: str, seed: int) -> tuple[Record, float]:
    """Record as a reader of files gives it, and the share of its samples that are there."""
    # Of each cell a record of its own: cells are then independent.
    own = zlib.crc32(cell.name.encode())
    rng = np.random.default_rng([own, seed, SIMULATORS.index(simulator)])
    motion, fine = fine_motion(cell, simulator, rng)
    count = round(int(cell.cycles) * RATE_HZ)
    instants = 1.0 + np.arange(count)
    if cell.losses == "jitter":
        instants += rng.uniform(-JITTER_STEPS, JITTER_STEPS, count)
        samples = CubicSpline(np.arange(len(motion)) / fine, motion)(instants)
    else:
        samples = motion[fine::fine][:count]
    sd = samples.std(axis=0)
    if cell.neighbours == "rotor":
        turn = 2 * np.pi * LINE_HZ * instants / RATE_HZ
        phases = rng.uniform(0, 2 * np.pi, samples.shape[1])
        samples = samples + LINE * np.sqrt(2) * sd * np.cos(turn[:, None] + phases)
    samples = samples + NOISE * sd * rng.standard_normal(samples.shape)
    units = ("m/s^2",) * samples.shape[1]
    names = tuple(f"a{k}" for k in range(samples.shape[1]))
    there = np.ones(count, dtype=bool)
    if cell.losses.endswith("%"):
        there = ~_lost(count, float(cell.losses.rstrip(" %")) / 100, rng)
    seconds = (instants[there] - instants[0]) / RATE_HZ
    axis = chosen_axis(samples[there], read_time(seconds))
    samples = samples[there] if axis.seconds is None else sampled_evenly(samples, axis)
    given = Record(
        samples=samples, rate_hz=axis.rate_hz, channels=names, units=units, gaps=axis.gaps,
        start_ns=None,
    )  # fmt: skip
    return given, float(there.mean())


def _lost(count: int, share: float, rng: np.random.Generator) -> np.ndarray:
    """Rows that are missing, in gaps at any place; the first and the last row are there."""
    lost = np.zeros(count, dtype=bool)
    while lost.mean() < share:
        length = int(rng.integers(1, LONGEST_GAP + 1))
        at = int(rng.integers(1, count - 1 - length))
        lost[at : at + length] = True
    return lost


def found(given: Record, cell: Cell, method: str) -> list[list[float]]:
    """Frequency, damping, and their standard deviations, of each mode, by `identify`."""
    options = IdentifyOptions(band_hz=BANDS[cell.band], method=cast(Method, method))
    told = identify_record(given, options)
    modes = told.single.modes if told.whole is None else told.whole.structural
    return [
        [m.frequency_hz.value, m.frequency_hz.sd, m.damping_ratio.value, m.damping_ratio.sd]
        for m in modes
    ]


def run(cell: Cell, simulator: str, seed: int, methods: Sequence[str]) -> dict[str, Any]:
    """Read one record by some methods."""
    given, share = record(cell, simulator, seed)
    row: dict[str, Any] = {"share": share, "modes": {}, "seconds": {}}
    for method in methods:
        begun = time.process_time()
        row["modes"][method] = found(given, cell, method)
        row["seconds"][method] = round(time.process_time() - begun, 2)
    return row


@dataclasses.dataclass(slots=True)
class SettingTally:
    """What one method said of some records."""

    held: tuple[list[bool], list[bool]] = dataclasses.field(default_factory=lambda: ([], []))
    ratios: list[float] = dataclasses.field(default_factory=list)
    wanted: int = 0
    refused: int = 0
    strangers: int = 0

    def add(self, cell: Cell, share: float, modes: Sequence[Sequence[float]]) -> None:
        """Count one record."""
        truths = cell.frequencies_hz
        # Of two close modes an estimate is one of the nearer: it is not the other one missed.
        nearest = [int(np.argmin(np.abs(truths - m[0]))) for m in modes]
        for place in cell.inside:
            truth = truths[place]
            law = ambient_law(DAMPING, share * int(cell.cycles) * truth)
            near = [
                (abs(m[0] - truth), k)
                for k, m in enumerate(modes)
                if nearest[k] == place and abs(m[0] - truth) < ABOUT * DAMPING * truth
            ]
            self.wanted += law[1] <= 0.5
            if not near:
                self.refused += law[1] <= 0.5
                continue
            f, f_sd, z, z_sd = modes[min(near)[1]]
            self.held[0].append(bool(abs(f - truth) <= 1.96 * f_sd))
            if np.isfinite(z_sd):
                self.held[1].append(bool(abs(z - DAMPING) <= 1.96 * z_sd))
            self.ratios.append(f_sd / (law[0] * truth))
        away = [
            min(abs(m[0] / t - 1) for t in cell.frequencies_hz) > ABOUT * DAMPING for m in modes
        ]
        self.strangers += sum(away)

    def said(self) -> list[str]:
        """Return counts and percentages of a row of a table; stars where 95 % is excluded."""
        row = [str(len(self.held[0]))]
        for held in self.held:
            low, high = _binomial(sum(held), len(held))
            star = "" if low <= 0.95 <= high else " *"
            row.append(f"{100 * np.mean(held):.1f}{star}" if held else "–")
        ratio = f"{np.median(self.ratios):.2f}" if self.ratios else "–"
        return [*row, f"{self.refused} of {self.wanted}", ratio, str(self.strangers)]


def _binomial(held: int, n: int) -> tuple[float, float]:
    """Exact interval of 99 % of a share."""
    if n == 0:
        return 0.0, 1.0
    interval = scipy.stats.binomtest(held, n).proportion_ci(0.99)
    return float(interval.low), float(interval.high)


HEADING = ("modes", "frequency", "damping", "not told", "sd / bound", "strangers")


def tables(rows: dict[tuple[str, str, int], dict[str, Any]]) -> Iterator[str]:
    """Tables in Markdown: of each method, of each value of a factor, and the worst cells."""
    cells = {one.name: one for one in (*main_cells(), *random_cells(10_000))}

    def tally(method: str, where: Any) -> SettingTally:
        total = SettingTally()
        for (name, simulator, _), row in rows.items():
            if where(cells[name], simulator) and method in row["modes"]:
                total.add(cells[name], row["share"], row["modes"][method])
        return total

    for method in METHODS:
        made = [key for key, row in rows.items() if method in row["modes"]]
        yield f"`{method}`: {len(made)} records of {len({key[0] for key in made})} cells."
    yield ""

    yield f"| method | {' | '.join(HEADING)} |"
    yield "|---" * (1 + len(HEADING)) + "|"
    for method in METHODS:
        yield f"| `{method}` | {' | '.join(tally(method, lambda *_: True).said())} |"
    yield ""
    yield f"| `modes` where | {' | '.join(HEADING)} |"
    yield "|---" * (1 + len(HEADING)) + "|"
    for simulator in SIMULATORS:
        of = tally("modes", lambda _, s, simulator=simulator: s == simulator)
        yield f"| simulator {simulator} | {' | '.join(of.said())} |"
    for factor, values in FACTORS.items():
        for value in values:
            of = tally("modes", lambda c, _, f=factor, v=value: getattr(c, f) == v)
            yield f"| {factor} {value} | {' | '.join(of.said())} |"
    yield ""
    starred = []
    for method in METHODS:
        for name in sorted({key[0] for key in rows}):
            said = tally(method, lambda c, _, n=name: c.name == n).said()
            if any("*" in one for one in said):
                starred.append(f"| `{method}` | {name} | {' | '.join(said)} |")
    yield f"Cells of a method whose 99 % interval excludes 95 %: {len(starred)}."
    yield from starred


def _join(rows: dict[tuple[str, str, int], dict[str, Any]], row: dict[str, Any]) -> None:
    """Add a run, whose methods may be others than those of a run of the same record."""
    before = rows.setdefault((row["cell"], row["simulator"], row["seed"]), row)
    for part in ("modes", "seconds"):
        before[part] = before[part] | row[part]


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the runs that are missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--out", type=Path, required=True, help="file of the runs made so far")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each main effect")
    parser.add_argument("--random", type=int, default=60, help="cells that are drawn")
    parser.add_argument("--random-seeds", type=int, default=1, help="seeds of each of those")
    parser.add_argument("--table", action="store_true", help="make no runs")
    parser.add_argument("--method", action="append", choices=METHODS, help="of all, only these")
    given = parser.parse_args(arguments)
    rows: dict[tuple[str, str, int], dict[str, Any]] = {}
    if given.out.exists():
        for line in given.out.read_text(encoding="utf-8").splitlines():
            _join(rows, json.loads(line))
    wanted = [(c, s) for s in range(given.seeds) for c in main_cells()]
    wanted += [(c, s) for s in range(given.random_seeds) for c in random_cells(given.random)]
    for cell, seed in [] if given.table else wanted:
        for simulator in SIMULATORS:
            there = rows.get((cell.name, simulator, seed), {"modes": {}})["modes"]
            missing = [one for one in given.method or METHODS if one not in there]
            if not missing:
                continue
            row = {"cell": cell.name, "simulator": simulator, "seed": seed}
            row |= run(cell, simulator, seed, missing)
            _join(rows, row)
            with given.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    print("\n".join(tables(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
