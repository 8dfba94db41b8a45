"""A recurrent state-space model of jax-sysid, trained as its documentation trains one.

``x+ = A x + B u + W3 s(W1 x + W2 u + b1) + b2``, ``y = C x + D u + W5 s(W4 x + b3) + b4`` with
the sigmoid s, scaled signals, Adam and then L-BFGS. To be as fair as we can, its linear part
begins as the nominal model, discretised, and not at random: the black box knows what the model
file says. The number of states is chosen on what is left out, and training then goes on with
all records. An initial state is found from the first samples by `learn_x0`.
"""

import sys
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import scipy.interpolate
import scipy.linalg
import scipy.signal
from jax_sysid.models import Model

from benchmarks.real_rigs.pieces import Array, Piece

from .task import PeerTask, errors, folds, head_of, mean_frequency, read_task, write_answer

HIDDEN = 6
"""[neurons] Of each network. Source: five in the documentation's examples."""
MORE_STATES = (0, 2)
"""[1] States beside those of the nominal model that are tried. Source: a choice."""
TRIAL, FINAL = (300, 600), (0, 500)
"""[1] Iterations of Adam and then of L-BFGS, to choose the number of states, and to train on
all records from there. Source: 1000 and 1000 in the documentation; fewer, as the linear
part begins near its end."""
PENALTY = 1e-4
"""[1] On parameters and initial states. Source: the documentation's example."""
SAMPLES_A_PERIOD = 20.0
"""[samples] Of the highest natural frequency that are kept, so that training ends. Source: a
choice; zero-order hold then errs by less than any tool here."""

jax.config.update("jax_enable_x64", True)
Pair = tuple[Array, Array]


@jax.jit
def state_fcn(x, u, params):  # type: ignore[no-untyped-def]
    """Next state."""
    a, b, _, _, w1, w2, w3, b1, b2, *_ = params
    return a @ x + b @ u + w3 @ jax.nn.sigmoid(w1 @ x + w2 @ u + b1) + b2


@jax.jit
def output_fcn(x, u, params):  # type: ignore[no-untyped-def]
    """Output of a state."""
    _, _, c, d, _, _, _, _, _, w4, w5, b3, b4 = params
    return c @ x + d @ u + w5 @ jax.nn.sigmoid(w4 @ x + b3) + b4


class BlackBox:
    """Scales, stride and start of the model of one task."""

    def __init__(self, task: PeerTask) -> None:
        self.task = task
        whole = task.learn[0]
        fastest = np.abs(np.linalg.eigvals(task.rig.rates())).max() / (2 * np.pi)
        outputs = task.outputs(whole).T
        least = max(mean_frequency(y, whole.rate_hz) for y in outputs)
        wanted = SAMPLES_A_PERIOD * (least if task.imposed else max(fastest, least))
        self.stride = max(int(whole.rate_hz / wanted), 1)
        self.step_s = self.stride / whole.rate_hz
        pairs = [self.raw(piece) for piece in task.learn]
        self.u_scale = _scale(np.concatenate([u for u, _ in pairs]))
        self.y_scale = _scale(np.concatenate([y for _, y in pairs]))

    def raw(self, piece: Piece) -> Pair:
        """Return inputs and outputs [time, channel], as often as training takes them."""
        u, y = self.task.inputs(piece), self.task.outputs(piece)
        if not u.shape[1]:
            u = np.zeros((len(y), 1))
        if self.task.imposed:
            u = np.column_stack([u, np.gradient(u, 1.0 / piece.rate_hz, axis=0)])
        return self._thinned(u), self._thinned(y)

    def _thinned(self, values: Array) -> Array:
        if self.stride == 1:
            return values
        for factor in _factors(self.stride):
            values = scipy.signal.decimate(values, factor, ftype="fir", zero_phase=True, axis=0)
        return np.asarray(values)

    def scaled(self, piece: Piece) -> Pair:
        """Return scaled inputs and outputs."""
        u, y = self.raw(piece)
        return (u - self.u_scale[0]) / self.u_scale[1], (y - self.y_scale[0]) / self.y_scale[1]

    def start(self, more: int, seed: int) -> list[Array]:
        """Return the first parameters: the nominal model, and small random networks."""
        rng = np.random.default_rng(seed)
        a, b, c, d = self._linear(more)
        states, inputs, outputs = len(a), b.shape[1], len(c)
        w1 = 0.5 * rng.standard_normal((HIDDEN, states))
        w2 = 0.5 * rng.standard_normal((HIDDEN, inputs))
        w3 = 0.01 * rng.standard_normal((states, HIDDEN))
        w4 = 0.5 * rng.standard_normal((HIDDEN, states))
        w5 = 0.01 * rng.standard_normal((outputs, HIDDEN))
        b1, b2, b3, b4 = (np.zeros(i) for i in (HIDDEN, states, HIDDEN, outputs))
        return [a, b, c, d, w1, w2, w3, b1, b2, w4, w5, b3, b4]

    def _linear(self, more: int) -> tuple[Array, Array, Array, Array]:
        """Discretise the nominal model in scaled channels, with states more that decay."""
        rig = self.task.rig
        if self.task.imposed:
            states, inputs = 2 + more, 2
            a, b = 0.5 * np.eye(states), 0.1 * np.ones((states, inputs))
            feed = np.array([[rig.stiffness[0], rig.damping[0]]])
            d = feed * self.u_scale[1] / self.y_scale[1][:, None]
            return a, b, np.zeros((1, states)), d
        n, width = rig.size, max(len(rig.inputs), 1)
        push = np.zeros((2 * n, width))
        if rig.inputs:
            push[n:] = rig.push / rig.masses[:, None]
        whole = np.zeros((2 * n + width, 2 * n + width))
        whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :] = rig.rates(), push
        stepped = scipy.linalg.expm(whole * self.step_s)
        rows, through = rig.output_rows()
        feed = through if rig.inputs else np.zeros((len(rows), 1))
        sizes = self._state_sizes(rows)
        a = stepped[: 2 * n, : 2 * n] * sizes / sizes[:, None]
        b = stepped[: 2 * n, 2 * n :] * self.u_scale[1] / sizes[:, None]
        c = rows * sizes / self.y_scale[1][:, None]
        d = feed * self.u_scale[1] / self.y_scale[1][:, None]
        extra = 0.5 * np.eye(more)
        return (
            scipy.linalg.block_diag(a, extra),
            np.vstack([b, np.zeros((more, width))]),
            np.hstack([c, np.zeros((len(c), more))]),
            d,
        )

    def _state_sizes(self, rows: Array) -> Array:
        """Guess the scatter of displacements and velocities from that of the outputs."""
        rig = self.task.rig
        whole = self.task.learn[0]
        first = self.task.outputs(whole)[:, 0]
        rate = 2 * np.pi * mean_frequency(first, whole.rate_hz)
        order = {"displacement": 0, "velocity": 1, "acceleration": 2}
        size = self.y_scale[1][0] / rate ** order[rig.sensors[0]["quantity"]]
        return np.repeat([size, size * rate], rig.size)

    def train(
        self, pairs: Sequence[Pair], params: list[Array], epochs: tuple[int, int]
    ) -> tuple[Model, list[Array]]:
        """Train from given parameters with Adam and L-BFGS."""
        states, outputs, inputs = len(params[0]), len(params[2]), params[1].shape[1]
        model = Model(states, outputs, inputs, state_fcn=state_fcn, output_fcn=output_fcn)
        begun = [self._first_state(params, pair) for pair in pairs]
        model.init(params=params, x0=begun if len(begun) > 1 else begun[0])
        model.loss(rho_x0=PENALTY, rho_th=PENALTY)
        model.optimization(adam_epochs=epochs[0], lbfgs_epochs=epochs[1], iprint=-1)
        ys, us = [y for _, y in pairs], [u for u, _ in pairs]
        model.fit(ys if len(ys) > 1 else ys[0], us if len(us) > 1 else us[0])
        return model, [np.asarray(p) for p in model.params]

    def _first_state(self, params: list[Array], pair: Pair) -> Array:
        """Fit the initial state of the linear part to the first samples."""
        a, b, c, d = params[:4]
        u, y = pair
        count = head_of(len(y))
        driven, x, gains, power = [], np.zeros(len(a)), [], np.eye(len(a))
        for i in range(count):
            driven.append(c @ x + d @ u[i])
            gains.append(c @ power)
            x, power = a @ x + b @ u[i], a @ power
        left = y[:count] - np.array(driven)
        if not np.isfinite(left).all():
            return np.zeros(len(a))
        return np.asarray(np.linalg.lstsq(np.concatenate(gains), left.ravel(), rcond=1e-6)[0])

    def run(self, model: Model, piece: Piece) -> Array:
        """Run a model free on a piece, from the state that its first samples tell."""
        u, y = self.scaled(piece)
        count = head_of(len(y))
        first = self._first_state([np.asarray(p) for p in model.params], (u, y))
        found = [first]
        try:
            learnt = model.learn_x0(
                u[:count], y[:count], RTS_epochs=2, verbosity=False, LBFGS_refinement=True
            )
            found.append(np.asarray(learnt))
        except (ValueError, FloatingPointError, np.linalg.LinAlgError):
            pass
        runs = [
            np.asarray(model.predict(jnp.array(x), u)[0]).reshape(len(y), -1) for x in found
        ]
        left = [np.nan_to_num(np.mean((r - y)[:count] ** 2), nan=np.inf) for r in runs]
        run = runs[int(np.argmin(left))] * self.y_scale[1] + self.y_scale[0]
        return self._filled(np.nan_to_num(run, nan=0.0, posinf=0.0, neginf=0.0), len(piece))

    def _filled(self, run: Array, count: int) -> Array:
        """Interpolate a run that is of every so many-th sample."""
        if self.stride == 1:
            return run[:count]
        at = np.arange(len(run)) * self.stride
        spline = scipy.interpolate.CubicSpline(at, run, axis=0)
        return np.asarray(spline(np.minimum(np.arange(count), at[-1])))


def _scale(values: Array) -> tuple[Array, Array]:
    spread = values.std(axis=0)
    return values.mean(axis=0), np.where(spread > 0, spread, 1.0)


def _factors(number: int) -> list[int]:
    """Split a stride into factors that a filter stands."""
    found = []
    for prime in (7, 5, 3, 2):
        while number % prime == 0:
            found.append(prime)
            number //= prime
    return [*found, number] if number > 1 else found


def main(arguments: Sequence[str] | None = None) -> int:
    """Answer on one set."""
    task = read_task(arguments)
    box = BlackBox(task)
    best: tuple[float, list[Array]] | None = None
    learn, judge = folds(task, sys.maxsize)[-1]
    for more in MORE_STATES:
        pairs = [box.scaled(piece) for piece in learn]
        model, params = box.train(pairs, box.start(more, seed=more), TRIAL)
        left = errors(
            [task.outputs(piece) for piece in judge], [box.run(model, piece) for piece in judge]
        )
        if best is None or left < best[0]:
            best = left, params
    assert best is not None
    model, params = box.train([box.scaled(p) for p in task.learn], best[1], FINAL)
    runs = [box.run(model, piece) for piece in task.judge]
    numbers = int(sum(p.size for p in params))
    answer = {
        "readable": f"{numbers} weights of a network with {len(params[0])} states",
        "numbers": numbers,
        "stride": box.stride,
        "score": best[0],
    }
    write_answer(task, runs, answer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
