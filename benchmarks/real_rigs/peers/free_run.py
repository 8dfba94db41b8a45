"""Free runs of many laws at once, each from the state that fits the first samples best."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.signal

from benchmarks.real_rigs.pieces import Array, Piece

from .integrator import integrate
from .laws import PeerLaw
from .task import Rig, head_of

STEP = 0.2
"""[rad] Phase of the highest frequency in one step of the integrator. Source: fourth-order
Runge–Kutta then errs by less than 1e-5 of the amplitude a period."""
ROUNDS = 5
"""[1] Of Gauss and Newton for an initial state. Source: a choice; changes are small by then."""
STEPS = np.array([1.0, 0.5, 0.2, 0.05])
"""[1] Shares of a step that are tried. Source: a choice."""
ORDERS = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Derivative of the displacement by quantity of a sensor."""


@dataclasses.dataclass(eq=False)
class FreeRuns:
    """One piece of a record, on which laws are run.

    Parameters
    ----------
    rig
        Masses, elements and sensors.
    piece
        Of the record.
    force
        On each node [time, node].
    measured
        By the sensors [time, sensor].
    """

    rig: Rig
    piece: Piece
    force: Array
    measured: Array

    def __post_init__(self) -> None:
        rates = np.abs(np.linalg.eigvals(self.rig.rates())).max()
        self.fine = max(int(np.ceil(rates / (STEP * self.piece.rate_hz))), 1)
        padded = np.concatenate([self.force, self.force[-1:]])
        if self.fine > 1:
            padded = scipy.signal.resample_poly(padded, self.fine, 1, axis=0, padtype="line")
        self.steps = padded
        base = np.zeros(len(self.force))
        if self.rig.shaken is not None:
            base = self.piece.channels[self.rig.inputs[self.rig.shaken]]
        self.base = base
        self.scatter = self.measured.std(axis=0)

    def from_best_states(self, laws: Sequence[PeerLaw], starts: Array) -> list[Array]:
        """Run each law from the state that fits the first samples best.

        Parameters
        ----------
        laws
            To be run.
        starts
            Where the search of each begins [law, state].

        Returns
        -------
        Outputs [time, sensor] of each.
        """
        count, head = len(laws), head_of(len(self.force))
        batch = _Batch.of(laws)
        sizes = np.abs(starts).max(axis=0) + 1e-6
        sizes[: self.rig.size] = sizes[: self.rig.size].max()
        sizes[self.rig.size :] = sizes[self.rig.size :].max()
        for _ in range(ROUNDS):
            starts = self._better(batch, starts, 1e-4 * sizes, head)
        runs = self.run(batch, starts, len(self.force))
        return [runs[i] for i in range(count)]

    def run_laws(self, laws: Sequence[PeerLaw], starts: Array, count: int) -> Array:
        """Run each law from its state [law, time, sensor], for some samples."""
        return self.run(_Batch.of(laws), starts, count)

    def _better(self, batch: "_Batch", starts: Array, nudge: Array, head: int) -> Array:
        """Take one step of Gauss and Newton for all laws, no longer than helps."""
        count, states = starts.shape
        tried = np.concatenate([starts[:, None], starts[:, None] + np.diag(nudge)], axis=1)
        runs = self._flat(batch, tried, head)
        now = (self.measured[:head] - runs[:, 0]) / self.scatter
        change = (runs[:, 1:] - runs[:, :1]) / self.scatter
        steps = np.zeros_like(starts)
        for i in range(count):
            matrix = change[i].reshape(states, -1).T
            if np.isfinite(matrix).all() and np.isfinite(now[i]).all():
                solved = np.linalg.lstsq(matrix, now[i].ravel(), rcond=1e-8)[0]
                steps[i] = solved * nudge
        tried = starts[:, None] + steps[:, None] * np.append(STEPS, 0.0)[:, None]
        left = (self._flat(batch, tried, head) - self.measured[:head]) / self.scatter
        cost = np.nan_to_num(np.mean(left**2, axis=(2, 3)), nan=np.inf)
        return np.asarray(tried[np.arange(count), cost.argmin(axis=1)])

    def _flat(self, batch: "_Batch", tried: Array, count: int) -> Array:
        """Run every start of every law [law, start, time, sensor]."""
        laws, starts, states = tried.shape
        runs = self.run(batch.repeated(starts), tried.reshape(-1, states), count)
        return runs.reshape(laws, starts, *runs.shape[1:])

    def run(self, batch: "_Batch", starts: Array, count: int) -> Array:
        """Integrate laws from states by Runge and Kutta [law, time, sensor]."""
        rig = self.rig.to, self.rig.stiffness, self.rig.damping, self.rig.masses
        h = 1.0 / (self.piece.rate_hz * self.fine)
        return np.array(
            [
                self._heard(integrate(law, rig, self.steps, self.fine, h, start, count))
                for law, start in zip(batch.laws(), starts, strict=True)
            ]
        )

    def _heard(self, motion: Array) -> Array:
        """Return what the sensors measure of a motion [quantity, time, node]."""
        columns = []
        for sensor in self.rig.sensors:
            values = motion[ORDERS[sensor["quantity"]], :, self.rig.node_of(sensor)]
            columns.append(values + self.base[: len(values)] * self.rig.is_shaken(sensor))
        return np.stack(columns, axis=-1)


@dataclasses.dataclass(frozen=True, eq=False)
class _Batch:
    """Several laws: coefficients [law, element, term, node], share of the nominal model."""

    coefficients: Array
    nominal: Array
    slip: Array
    gain: Array

    @classmethod
    def of(cls, laws: Sequence[PeerLaw]) -> "_Batch":
        return cls(
            np.array([law.coefficients for law in laws]),
            np.array([law.nominal for law in laws]),
            laws[0].slip,
            np.array([law.gain for law in laws])[:, None],
        )

    def repeated(self, times: int) -> "_Batch":
        return _Batch(
            np.repeat(self.coefficients, times, axis=0),
            np.repeat(self.nominal, times),
            self.slip,
            np.repeat(self.gain, times, axis=0),
        )

    def laws(self) -> Iterator[tuple[Array, float, float, Array]]:
        for one in zip(self.coefficients, self.nominal, self.gain, strict=True):
            yield one[0], float(one[1]), float(one[2][0]), self.slip
