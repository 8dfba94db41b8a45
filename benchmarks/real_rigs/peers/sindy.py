"""PySINDy on a rig, set up as well as we can: what is left of the equations of motion.

Motion is smoothed and differentiated by PySINDy's `SmoothedFiniteDifference`, or by FFT; the
equation of each node is regressed by its `STLSQ` on terms of the elements that end there.
Smoothing, library, threshold, and whether the nominal model is taken off first, are chosen by
free runs on records that are left out, or on the last part of the only one. A free run begins
from the state that fits the first samples best.
"""

import dataclasses
import itertools
import sys
import warnings
from collections.abc import Sequence

import numpy as np
import pysindy as ps

from benchmarks.real_rigs.pieces import Array, Piece

from .free_run import FreeRuns
from .laws import LIBRARIES, NAMES, PeerLaw, States, term_values
from .task import PeerTask, Rig, errors, folds, mean_frequency, read_task, write_answer

WINDOWS = (0.1, 0.25, 0.5)
"""[periods of the motion] Smoothing that is tried. Source: a choice about 0.2, above which a
polynomial of third degree bends a sine."""
CUTOFFS = (2.5, 5.0)
"""[mean frequencies of the motion] Low-pass of derivatives by FFT that are tried, where samples
are too few a period for polynomials; negative as a `Setting.window`. Source: above the third
harmonic, and twice that."""
THRESHOLDS = (0.3, 0.1, 0.03, 0.01, 0.003)
"""[share of the force's scatter] That a term must carry. Source: those of the blind cases."""
MOST_TESTED = 4000
"""[samples] Of each record by which settings are chosen, so that it ends. Source: a choice."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """One way to set the regression up."""

    window: float
    threshold: float
    library: str
    discrepancy: bool


def settings_of(rig: Rig) -> list[Setting]:
    """Return every setting that is tried."""
    libraries = [name for name in LIBRARIES if rig.angular or name != "sine"]
    smoothing = (*WINDOWS, *(-cutoff for cutoff in CUTOFFS))
    tried = itertools.product(smoothing, THRESHOLDS, libraries, (False, True))
    return [Setting(*one) for one in tried]


def smoothed(task: PeerTask, piece: Piece, window: float) -> States:
    """Smooth and differentiate what was measured of each node, relative to the base."""
    rig = task.rig
    found: dict[int, tuple[int, Array]] = {}
    orders = {"displacement": 0, "velocity": 1, "acceleration": 2}
    for sensor in rig.sensors:
        values, order = piece.channels[sensor["channel"]], orders[sensor["quantity"]]
        if rig.is_shaken(sensor):
            values = values - piece.channels[rig.inputs[rig.shaken or 0]]
        node = rig.node_of(sensor)
        if node not in found or order < found[node][0]:
            found[node] = order, values
    columns = [_derivatives(*found[i], piece.rate_hz, window) for i in range(rig.size)]
    x, v, a = (np.column_stack([column[i] for column in columns]) for i in range(3))
    return States(x, v, a)


def _derivatives(
    order: int, values: Array, rate_hz: float, window: float
) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration from one of them."""
    if window < 0:
        return _by_spectrum(order, values, rate_hz, -window)
    length = max(int(window * rate_hz / mean_frequency(values, rate_hz)) | 1, 5)
    length = min(length, (len(values) // 4) | 1)
    smooth = ps.SmoothedFiniteDifference(
        smoother_kws={"window_length": length, "polyorder": 3, "axis": 0}
    )
    times = np.arange(len(values)) / rate_hz
    series = {order: values}
    for higher in range(order + 1, 3):
        series[higher] = np.asarray(smooth(series[higher - 1][:, None], times)).ravel()
    for lower in range(order - 1, -1, -1):
        series[lower] = _integral(series[lower + 1], rate_hz)
    return series[0], series[1], series[2]


def _by_spectrum(
    order: int, values: Array, rate_hz: float, cutoff: float
) -> tuple[Array, Array, Array]:
    """Differentiate by FFT below a cutoff, and integrate; padded by the mirror image."""
    padded = np.concatenate(
        [2 * values[0] - values[:0:-1], values, 2 * values[-1] - values[-2::-1]]
    )
    trend = np.linspace(padded[0], padded[-1], len(padded))
    lines = np.fft.rfftfreq(len(padded), 1.0 / rate_hz)
    gain = 1.0 / (1.0 + (lines / (cutoff * mean_frequency(values, rate_hz))) ** 16)
    spectrum = np.fft.rfft(padded - trend) * gain
    slope = (trend[-1] - trend[0]) / (len(trend) - 1) * rate_hz
    inside = slice(len(values) - 1, 2 * len(values) - 1)
    series: dict[int, Array] = {}
    for higher in range(order, 3):
        turned = np.fft.irfft(spectrum * (2j * np.pi * lines) ** (higher - order), len(padded))
        rest = {0: trend, 1: np.full(len(padded), slope)}.get(higher - order, 0.0)
        series[higher] = np.asarray(turned + rest)[inside]
    for lower in range(order - 1, -1, -1):
        series[lower] = _integral(series[lower + 1], rate_hz)
    return series[0], series[1], series[2]


def _integral(values: Array, rate_hz: float) -> Array:
    """Integrate a series without a drift, padded by its mirror image."""
    padded = np.concatenate([values[::-1], values, values[::-1]])
    lines = np.fft.rfftfreq(len(padded), 1.0 / rate_hz)
    low = mean_frequency(values, rate_hz) / 5
    gain = (lines / low) ** 8 / (1.0 + (lines / low) ** 8)
    spectrum = np.fft.rfft(padded) * gain / (2j * np.pi * np.maximum(lines, 1e-9))
    return np.asarray(np.fft.irfft(spectrum, len(padded))[len(values) : 2 * len(values)])


def regress(
    task: PeerTask, rows: Sequence[tuple[States, Array]], setting: Setting, slip: Array
) -> PeerLaw:
    """Regress the equations of motion of all nodes on the terms of a library."""
    rig = task.rig
    features = np.concatenate([term_values(s, rig.to, slip) for s, _ in rows])
    force = np.concatenate([f for _, f in rows])
    motion = [np.concatenate([getattr(s, name) for s, _ in rows]) for name in "xva"]
    # Where motion is imposed, the force is that of the element, and inertia is nothing.
    target = force - motion[2] * rig.masses * (not task.imposed)
    if setting.discrepancy:
        target = target - (motion[0] @ rig.to.T * rig.stiffness) @ rig.to
        target = target - (motion[1] @ rig.to.T * rig.damping) @ rig.to
    used = np.array([name in LIBRARIES[setting.library] for name in NAMES])
    coefficients = np.zeros((len(rig.to), len(NAMES), rig.size))
    for node in range(rig.size):
        near = [i for i, ends in enumerate(rig.element_nodes) if node in ends]
        columns = features[:, near][:, :, used].reshape(len(features), -1)
        scale, size = columns.std(axis=0), target[:, node].std() + 1e-300
        # The constant does not scatter.
        scale = np.where(scale > 0, scale, np.abs(columns).max(axis=0) + 1e-300)
        optimizer = ps.STLSQ(threshold=setting.threshold, alpha=1e-8, max_iter=30)
        optimizer.fit(columns / scale, target[:, [node]] / size)
        solved = optimizer.coef_.ravel() / scale * size
        block = np.zeros((len(near), len(NAMES)))
        block[:, used] = solved.reshape(len(near), -1)
        coefficients[near, :, node] = block
    nominal = float(setting.discrepancy)
    return PeerLaw(coefficients, nominal, slip)


def choose(task: PeerTask) -> tuple[Setting, float]:
    """Choose the setting whose law foretells what it was not regressed on best."""
    settings = settings_of(task.rig)
    measured: list[Array] = []
    runs: list[list[Array]] = []
    for learn, judge in folds(task, MOST_TESTED):
        laws = laws_of(task, learn, settings)
        measured += [task.outputs(piece) for piece in judge]
        runs += [runs_of(task, piece, laws, settings) for piece in judge]
    scores = [errors(measured, [run[i] for run in runs]) for i in range(len(settings))]
    best = int(np.argmin(scores))
    return settings[best], scores[best]


def laws_of(
    task: PeerTask, pieces: Sequence[Piece], settings: Sequence[Setting]
) -> list[PeerLaw]:
    """Regress every setting on the same pieces."""
    rows: dict[float, list[tuple[States, Array]]] = {}
    for window in sorted({one.window for one in settings}):
        rows[window] = [(smoothed(task, p, window), forces_of(task, p)) for p in pieces]
    speeds = np.concatenate([s.v @ task.rig.to.T for s, _ in next(iter(rows.values()))])
    slip = 0.02 * speeds.std(axis=0)
    return [regress(task, rows[one.window], one, slip) for one in settings]


def forces_of(task: PeerTask, piece: Piece) -> Array:
    """Return the measured force on each node [time, node]."""
    series = [piece.channels[name] for name in task.rig.inputs]
    inputs = np.array(series).reshape(len(series), len(piece)).T
    return np.asarray(inputs @ task.rig.push.T)


def runs_of(
    task: PeerTask, piece: Piece, laws: Sequence[PeerLaw], settings: Sequence[Setting]
) -> list[Array]:
    """Run laws free on a piece, or foretell its force where motion is imposed."""
    states = {one.window: smoothed(task, piece, one.window) for one in settings}
    if task.imposed:
        return [
            law.force(states[one.window], task.rig) * task.rig.push.sum()
            for law, one in zip(laws, settings, strict=True)
        ]
    runs = FreeRuns(task.rig, piece, forces_of(task, piece), task.outputs(piece))
    starts = [
        np.concatenate([states[one.window].x[0], states[one.window].v[0]]) for one in settings
    ]
    return runs.from_best_states(laws, np.array(starts))


def equation(task: PeerTask, law: PeerLaw) -> str:
    """Write a law as a person would."""
    rows = []
    for node in range(task.rig.size):
        terms = [
            f"{law.coefficients[e, t, node]:+.4g} {NAMES[t].format(e + 1)}"
            for e in range(len(task.rig.to))
            for t in range(len(NAMES))
            if law.coefficients[e, t, node]
        ]
        left = "force" if task.imposed else f"force - m*a{node + 1}"
        nominal = " - nominal" if law.nominal else ""
        rows.append(f"{left}{nominal} = {' '.join(terms) or '0'}")
    return "; ".join(rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Answer on one set."""
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    task = read_task(arguments)
    setting, score = choose(task)
    (law,) = laws_of(task, task.learn, [setting])
    runs = [runs_of(task, piece, [law], [setting])[0] for piece in task.judge]
    answer = {
        "readable": equation(task, law),
        "numbers": int(np.count_nonzero(law.coefficients)),
        "setting": dataclasses.asdict(setting),
        "score": score,
    }
    write_answer(task, runs, answer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
