"""The known law, fitted to the free run: what a person who knows the answer reaches.

Coefficients of the terms, the initial states and, where they are among the terms, a gain on the
input and an offset of the sensor are fitted by Levenberg and Marquardt to longer and longer
parts of the records. It is no contestant that finds anything; it shows what can be reached.
"""

import dataclasses
import sys
from collections.abc import Sequence

import numpy as np
import scipy.signal

from benchmarks.real_rigs.pieces import Array, Piece

from .free_run import FreeRuns
from .laws import NAMES, PeerLaw, States, term_values
from .task import PeerTask, mean_frequency, read_task, write_answer

PARTS = (0.1, 0.2, 0.4, 0.7, 1.0)
"""[share of a record] That are fitted one after the other. Source: a choice; a phase that is
lost over a short part is found again over a longer one."""
ROUNDS = 25
"""[1] Of Levenberg and Marquardt for each part. Source: a choice."""
DAMPED = np.array([0.0, 1e-4, 1e-2, 1.0, 100.0])
"""[1] Shares of the diagonal that are tried at once. Source: a choice."""
NUDGE = 1e-4
"""[1] Relative step of derivatives. Source: between rounding and curvature."""
GAIN, OFFSET = "gain", "offset"


@dataclasses.dataclass(frozen=True)
class ParameterShape:
    """Where each number stands among the parameters.

    Parameters
    ----------
    terms
        Indices among `NAMES`.
    gain, offset
        Whether these are free.
    """

    terms: tuple[int, ...]
    gain: bool
    offset: bool

    @property
    def count(self) -> int:
        """Numbers before the initial states."""
        return len(self.terms) + self.gain + self.offset

    def law(self, values: Array, slip: Array) -> PeerLaw:
        """Return the law of these numbers."""
        coefficients = np.zeros((1, len(NAMES), 1))
        coefficients[0, list(self.terms), 0] = values[: len(self.terms)]
        gain = float(values[len(self.terms)]) if self.gain else 1.0
        return PeerLaw(coefficients, 0.0, slip, gain)

    def shift(self, values: Array) -> float:
        """Return what the sensor adds."""
        return float(values[self.count - 1]) if self.offset else 0.0


def shape_of(words: Sequence[str]) -> ParameterShape:
    """Read the terms of a law: names of `NAMES`, ``gain`` and ``offset``.

    Raises
    ------
    ValueError
        Where a word is none of these.
    """
    wrong = sorted(set(words) - {*NAMES, GAIN, OFFSET})
    if wrong:
        raise ValueError(
            f"There is no term {', '.join(wrong)}. Give some of {', '.join(NAMES)}."
        )
    terms = tuple(NAMES.index(word) for word in words if word in NAMES)
    return ParameterShape(terms, GAIN in words, OFFSET in words)


class OutputError:
    """Free runs of one law on several pieces, as residuals of all numbers."""

    def __init__(self, task: PeerTask, shape: ParameterShape, slip: Array) -> None:
        self.task, self.shape, self.slip = task, shape, slip
        self.runs = [
            FreeRuns(task.rig, piece, _force(task, piece), task.outputs(piece))
            for piece in task.learn
        ]

    def residuals(self, tried: Array, share: float) -> Array:
        """Return residuals [try, sample] of parameters [try, number]."""
        laws = [self.shape.law(values, self.slip) for values in tried]
        shifts = np.array([self.shape.shift(values) for values in tried])
        found = []
        for i, run in enumerate(self.runs):
            first = self.shape.count + 2 * i
            count = max(int(share * len(run.measured)), 2)
            told = run.run_laws(laws, tried[:, first : first + 2], count)[:, :, 0]
            found.append((told + shifts[:, None] - run.measured[:count, 0]) / run.scatter[0])
        all_of = np.concatenate(found, axis=1)
        return np.asarray(np.nan_to_num(all_of, nan=1e3, posinf=1e3, neginf=-1e3))

    def fit(self, values: Array) -> Array:
        """Fit all numbers from first guesses."""
        for share in PARTS:
            for _ in range(ROUNDS):
                values, gained = self._step(values, share)
                if gained < 1e-6:
                    break
        return values

    def _step(self, values: Array, share: float) -> tuple[Array, float]:
        nudge = NUDGE * np.maximum(np.abs(values), 1e-3 * np.abs(values).max() + 1e-9)
        all_runs = self.residuals(np.vstack([values, values + np.diag(nudge)]), share)
        now, change = all_runs[0], ((all_runs[1:] - all_runs[0]) / nudge[:, None]).T
        size = np.sqrt((change**2).sum(axis=0)) + 1e-300
        scaled = change / size
        tried = [values]
        for damping in DAMPED:
            matrix = np.vstack([scaled, np.sqrt(damping + 1e-12) * np.eye(len(values))])
            right = np.concatenate([-now, np.zeros(len(values))])
            tried.append(values + np.linalg.lstsq(matrix, right, rcond=None)[0] / size)
        costs = np.mean(np.clip(self.residuals(np.array(tried), share), -1e3, 1e3) ** 2, axis=1)
        best = int(np.argmin(costs))
        return tried[best], float(1 - costs[best] / costs[0])


def first_guess(task: PeerTask, shape: ParameterShape) -> tuple[Array, Array]:
    """Regress the terms on smoothed motion; the slip speed comes with them."""
    states = [_smoothed(task, piece) for piece in task.learn]
    slip = 0.02 * np.concatenate([one.v for one in states]).std(axis=0)
    features = np.concatenate([term_values(one, task.rig.to, slip)[:, 0] for one in states])
    columns = features[:, list(shape.terms)]
    force = np.concatenate([_force(task, piece) for piece in task.learn])[:, 0]
    target = force - np.concatenate([one.a for one in states])[:, 0] * task.rig.masses[0]
    if shape.gain:
        # m a + law = gain * force, with the inertia known.
        columns = np.column_stack([columns, -force])
        target = target - force
    size = np.sqrt((columns**2).mean(axis=0)) + 1e-300
    solved = np.linalg.lstsq(columns / size, target, rcond=1e-8)[0] / size
    starts = [np.array([one.x[0, 0], one.v[0, 0]]) for one in states]
    offset = np.zeros(int(shape.offset))
    return np.concatenate([solved, offset, *starts]), slip


def _smoothed(task: PeerTask, piece: Piece) -> States:
    """Smooth and differentiate the one sensor, or integrate it once."""
    (sensor,) = task.rig.sensors[:1]
    values = piece.channels[sensor["channel"]]
    length = int(0.25 * piece.rate_hz / mean_frequency(values, piece.rate_hz)) | 1
    length = min(max(length, 5), (len(values) // 4) | 1)

    def derived(order: int) -> Array:
        step = 1.0 / piece.rate_hz
        series = scipy.signal.savgol_filter(values, length, 3, deriv=order, delta=step)
        return np.asarray(series)[:, None]

    if sensor["quantity"] == "displacement":
        return States(derived(0), derived(1), derived(2))
    speed = derived(0)
    place = np.cumsum(speed - speed.mean(), axis=0) / piece.rate_hz
    return States(place - place.mean(), speed, derived(1))


def _force(task: PeerTask, piece: Piece) -> Array:
    series = [piece.channels[name] for name in task.rig.inputs]
    return np.asarray(np.array(series).reshape(len(series), len(piece)).T @ task.rig.push.T)


def words_of(shape: ParameterShape, values: Array) -> str:
    """Write the fitted law for a person."""
    numbers = [
        f"{value:+.4g} {NAMES[i].format('')}"
        for i, value in zip(shape.terms, values, strict=False)
    ]
    if shape.gain:
        numbers.append(f"gain {values[len(shape.terms)]:.4g}")
    if shape.offset:
        numbers.append(f"sensor {shape.shift(values):+.4g}")
    return "force - m*a = " + " ".join(numbers)


def main(arguments: Sequence[str] | None = None) -> int:
    """Answer on one set."""
    task = read_task(arguments)
    with np.errstate(all="ignore"):
        answer_on(task, shape_of(task.law))
    return 0


def answer_on(task: PeerTask, shape: ParameterShape) -> None:
    """Fit a law of this shape, run it on what was held out, and write the answer."""
    guess, slip = first_guess(task, shape)
    values = OutputError(task, shape, slip).fit(guess)
    law, shift = shape.law(values, slip), shape.shift(values)
    runs = []
    for piece in task.judge:
        state = _smoothed(task, piece)
        own = FreeRuns(task.rig, piece, _force(task, piece), task.outputs(piece) - shift)
        start = np.array([[state.x[0, 0], state.v[0, 0]]])
        runs.append(own.from_best_states([law], start)[0] + shift)
    answer = {"readable": words_of(shape, values), "numbers": shape.count}
    write_answer(task, runs, answer)


if __name__ == "__main__":
    sys.exit(main())
