"""How fast a plant runs with its effects, as a ratio to scipy's `solve_ivp` at equal accuracy.

`python -m benchmarks.methods.plant` takes about a minute. Three masses under a random force
that is linear between samples, 5 s at 200 Hz, with one effect along the second spring. Truth is
DOP853 at 1e-10; of three methods and four tolerances of `solve_ivp` the fastest counts whose
error is no more than the plant's own, or 1e-4 where that is smaller. Friction is integrated by
it from event to event. Slopes are set against as many runs more as differences would take.
"""

import dataclasses
import functools
import itertools
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
import scipy.signal as sps
from scipy.integrate import solve_ivp

from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.plant import Plant

Method = Literal["RK45", "DOP853", "LSODA"]
RATE, SAMPLES = 200.0, 1000
LIMIT = 20.0
"""Ratio that is asked of every law."""

MASSES = np.array([1.9, 2.1, 1.7])
TIES = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
K = TIES.T @ np.diag([4100.0, 3900.0, 3500.0]) @ TIES
C = TIES.T @ np.diag([2.3, 2.2, 2.0]) @ TIES
RIG = dataclasses.replace(
    chain([1.9, 2.1, 1.7], [4100.0, 3900.0, 3500.0], dampings_n_s_per_m=[2.3, 2.2, 2.0]),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=tuple(
        Sensor(channel=f"x_{node}", quantity="displacement", node=node, unit="m")
        for node in ("m1", "m2", "m3")
    ),
)
TIMES = np.arange(SAMPLES) / RATE
METHODS: tuple[Method, ...] = ("RK45", "DOP853", "LSODA")
TRIES = tuple(itertools.product(METHODS, (1e-4, 1e-5, 1e-6, 1e-7)))


Array = np.ndarray[Any, np.dtype[np.float64]]
Force = Callable[[float, float, Array], float]


@dataclasses.dataclass(frozen=True, slots=True)
class LawCase:
    """A law: as an entry of a model file, and as a function of e, v, z."""

    entry: Mapping[str, Any]
    force: Force
    memory: Force | None = None
    friction: bool = False


def _gap(e: float, v: float, z: Array) -> float:
    return 4000.0 * (max(e - 2e-3, 0.0) + min(e + 2e-3, 0.0))


def _yield(e: float, v: float, z: Array) -> float:
    return float(v * (1 - (z[0] / 1e-3) ** 2 * (1 + np.sign(v * z[0])) / 2))


CASES = (
    LawCase({"effect": "cubic_hardening", "k3_n_per_m3": 2e8}, lambda e, v, z: 2e8 * e**3),
    LawCase({"effect": "gap_symmetric", "kg_n_per_m": 4000.0, "gap_m": 2e-3}, _gap),
    LawCase(
        {"effect": "quadratic_damping", "c2_n_s2_per_m2": 90.0},
        lambda e, v, z: 90.0 * abs(v) * v,
    ),
    LawCase(
        {"effect": "bouc_wen", "kh_n_per_m": 2000.0, "zy_m": 1e-3, "n": 2.0},
        lambda e, v, z: 2000.0 * (z[0] - e),
        memory=_yield,
    ),
    LawCase({"effect": "coulomb", "friction_n": 8.0}, lambda e, v, z: 8.0, friction=True),
)


def pushed() -> Array:
    """Random force up to 20 Hz [N]."""
    white = np.random.default_rng(1).standard_normal(SAMPLES)
    sections = sps.butter(4, 20.0, fs=RATE, output="sos")
    return np.asarray(40.0 * sps.sosfiltfilt(sections, white))


def integrated(case: LawCase, push: Array, method: Method, rtol: float) -> Array:
    """Displacements by `solve_ivp`."""
    tie, atol = TIES[1], 1e-3 * rtol

    def bare(t: float, state: Array, force: float) -> Array:
        loads = -K @ state[:3] - C @ state[3:6] - tie * force
        loads[0] += np.interp(t, TIMES, push)
        return np.concatenate([state[3:6], loads / MASSES])

    def motion(t: float, state: Array) -> Array:
        seen = (float(tie @ state[:3]), float(tie @ state[3:6]), state[6:])
        rate = bare(t, state, case.force(*seen))
        return rate if case.memory is None else np.append(rate, case.memory(*seen))

    if case.friction:
        return _from_event_to_event(bare, case.force(0.0, 0.0, push[:0]), method, rtol)
    start = np.zeros(6 if case.memory is None else 7)
    run = solve_ivp(
        motion, (0, TIMES[-1]), start, method, TIMES, rtol=rtol, atol=atol, max_step=1 / RATE
    )
    return np.asarray(run.y[:3].T)


def _from_event_to_event(
    bare: Callable[[float, Array, float], Array], limit: float, method: Method, rtol: float
) -> Array:
    tie, mobility = TIES[1], TIES[1] @ (TIES[1] / MASSES)
    mode = 0.0

    def needed(t: float, state: Array) -> float:
        return float(tie @ bare(t, state, 0.0)[3:] / mobility)

    def motion(t: float, state: Array) -> Array:
        return bare(t, state, mode * limit if mode else needed(t, state))

    def margin(t: float, state: Array) -> float:
        if mode:
            return float(mode * (tie @ state[3:]) + 1e-10)
        return limit * (1 + 1e-7) - abs(needed(t, state))

    margin.terminal, margin.direction = True, -1  # type: ignore[attr-defined]
    t, state, found = 0.0, np.zeros(6), [np.zeros((1, 3))]
    while t < TIMES[-1]:
        ahead = TIMES[TIMES > t]
        run = solve_ivp(
            motion,
            (t, TIMES[-1]),
            state,
            method,
            ahead,
            events=margin,
            rtol=rtol,
            atol=1e-3 * rtol,
            max_step=1 / RATE,
        )
        if len(run.t):
            found.append(run.y[:3].T)
        if run.status == 0:
            break
        assert run.t_events is not None
        assert run.y_events is not None
        t, state = float(run.t_events[0][-1]), run.y_events[0][-1]
        state[3:] -= tie @ state[3:] / mobility * tie / MASSES
        sticks = mode != 0 and abs(needed(t, state)) <= limit
        mode = 0.0 if sticks else float(np.sign(needed(t, state)))
    return np.concatenate(found)


def timed(work: Callable[[], Array], repeats: int) -> tuple[Array, float]:
    """Give what comes out, and the least time of the processor that it took [s]."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        found = work()
        spent.append(time.process_time() - begun)
    return found, min(spent)


def row(case: LawCase, push: Array) -> tuple[str, bool]:
    """One law's line of the table, and whether it is as fast as asked."""
    plant = Plant.of(
        dataclasses.replace(RIG, effects=(dict(case.entry) | {"element": "k2"},)), hold="first"
    )
    truth = integrated(case, push, "DOP853", 1e-10)
    size = np.std(truth)
    inputs, values, free = push[:, None], plant.values, plant.parameters
    plant.sensitivities(values, inputs, RATE, free[:1])
    found, seconds = timed(lambda: plant.simulate(values, inputs, RATE), 20)
    error = float(np.std(found - truth) / size)
    _, whole = timed(lambda: plant.sensitivities(values, inputs, RATE, free)[0], 10)
    best, how = np.inf, "none"
    for method, rtol in TRIES:
        other, took = timed(functools.partial(integrated, case, push, method, rtol), 1)
        if np.std(other - truth) / size <= max(error, 1e-4) and took < best:
            best, how = took, f"{method} {rtol:.0e}"
    slopes = len(free) + len(plant.state_names)
    text = (
        f"{case.entry['effect']:18s} {error:8.1e} {1e3 * seconds:8.2f} {1e3 * best:8.0f}  "
        f"{how:13s} {best / seconds:6.0f}   {1e3 * whole / slopes:6.2f} "
        f"{2 * slopes * seconds / whole:6.1f}"
    )
    return text, best / seconds >= LIMIT


def main() -> int:
    """Print the table; status 1 if a law is slower than asked."""
    print(
        "effect                error  plant ms  scipy ms  by             ratio   "
        "ms a slope   ratio to differences"
    )
    push, fine = pushed(), True
    for case in CASES:
        text, fast = row(case, push)
        fine = fine and fast
        print(text, flush=True)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
