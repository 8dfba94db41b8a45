"""PySINDy on a case, set up as well as we can, its answer told in the words of a report.

Four ways: sequential thresholding, weak form, bagged ensemble, each of the whole equation of
motion; and the discrepancy form, of what the nominal model leaves of it. The library holds, for
every element, what a mechanical engineer would put there; thresholds are chosen on the records
by leaving one out. What is named is the term that carries most of what the linear terms do not.
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pysindy as ps
from numpy.typing import NDArray
from scipy.integrate import odeint

from .laws import family_of
from .peer_data import Claimed, States, read_model, read_states, write_report
from .rig import BASE, Rig

Array = NDArray[np.float64]
TERMS: dict[str, Callable[[Array, Array], Array]] = {
    "stiffness_loss": lambda e, v: e,
    "viscous_damping": lambda e, v: v,
    "quadratic_stiffness": lambda e, v: e**2,
    "cubic": lambda e, v: e**3,
    "quadratic_damping": lambda e, v: np.abs(v) * v,
    "coulomb": lambda e, v: np.tanh(v / (0.02 * v.std() + 1e-12)),
    "van_der_pol": lambda e, v: e**2 * v,
}
PARAMETERS = {
    "stiffness_loss": ("dk_n_per_m", -1.0),
    "viscous_damping": ("dc_n_s_per_m", 1.0),
    "quadratic_stiffness": ("k2_n_per_m2", 1.0),
    "cubic_hardening": ("k3_n_per_m3", 1.0),
    "cubic_softening": ("k3_n_per_m3", 1.0),
    "quadratic_damping": ("c2_n_s2_per_m2", 1.0),
    "coulomb": ("friction_n", 1.0),
    "van_der_pol": ("cn_n_s_per_m", 1.0),
}
THRESHOLDS = (0.3, 0.1, 0.03, 0.01, 0.003)


class Regression:
    """One way of regression: rows from a record, coefficients from rows."""

    def __init__(self, method: str, claimed: Claimed) -> None:
        self.method, self.claimed = method, claimed
        self.to = claimed.rig.elongations()
        frequencies = claimed.rig.frequencies_hz()
        self.window_s = 1.0 / float(frequencies[-1])

    def rows(self, states: States) -> tuple[Array, Array]:
        """Give features [row, element term] and inertia less known forces [row, node]."""
        features = terms_of(states.displacement @ self.to.T, states.velocity @ self.to.T)
        masses = np.array(self.claimed.rig.masses)
        if self.method == "weak":
            return self._weak(states, features, masses)
        target = states.acceleration * masses - states.force
        if self.method == "discrepancy":
            target = target - nominal_forces(self.claimed.rig, states)
        return features, target

    def _weak(self, states: States, features: Array, masses: Array) -> tuple[Array, Array]:
        times = np.arange(len(features)) / states.rate_hz
        axes = {"ax_time": 0, "ax_coord": 1}
        library = ps.WeakPDELibrary(
            function_library=ps.IdentityLibrary(), spatiotemporal_grid=times,
            K=2000, H_xt=self.window_s,
        )  # fmt: skip
        both = ps.AxesArray(np.column_stack([features, states.force]), axes)
        library.fit([both])
        weak = np.asarray(library.transform([both])[0])
        rate = library.convert_u_dot_integral(ps.AxesArray(states.velocity, axes))
        count = features.shape[1]
        return weak[:, :count], np.asarray(rate) * masses - weak[:, count:]

    def solve(self, features: Array, target: Array, threshold: float) -> Array:
        """Coefficients [element term, node], those below the threshold zero."""
        scale, size = features.std(axis=0) + 1e-300, target.std(axis=0) + 1e-300
        plain = ps.STLSQ(threshold=threshold, alpha=1e-8, max_iter=30)
        optimizer = plain
        if self.method == "ensemble":
            optimizer = ps.EnsembleOptimizer(plain, bagging=True, n_models=20)
        coefficients = np.zeros((features.shape[1], target.shape[1]))
        for node in range(target.shape[1]):
            near = self.attached(node)
            optimizer.fit(features[:, near] / scale[near], target[:, [node]] / size[node])
            found = optimizer.coef_
            if self.method == "ensemble":
                found = np.median(optimizer.coef_list, axis=0)
            coefficients[near, node] = found.ravel() / scale[near] * size[node]
        return coefficients

    def attached(self, node: int) -> Array:
        """Columns of the elements that end at a node."""
        count = len(TERMS)
        ends = [
            i for i, e in enumerate(self.claimed.rig.elements) if node in (e.first, e.second)
        ]
        return np.concatenate([np.arange(i * count, (i + 1) * count) for i in ends]).astype(int)

    def best(self, rows: list[tuple[Array, Array]]) -> Array:
        """Choose the largest threshold that foretells a record left out nearly best."""
        errors = []
        for threshold in THRESHOLDS:
            error = 0.0
            for left, (features, target) in enumerate(rows):
                kept = [row for i, row in enumerate(rows) if i != left]
                solved = self.solve(*_stacked(kept), threshold)
                error += float(np.mean((features @ solved - target) ** 2) / target.var())
            errors.append(error)
        good = [t for t, e in zip(THRESHOLDS, errors, strict=True) if e <= 1.02 * min(errors)]
        return self.solve(*_stacked(rows), good[0])


def _stacked(rows: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.concatenate([f for f, _ in rows]), np.concatenate([t for _, t in rows])


def terms_of(e: Array, v: Array) -> Array:
    """Every term of every element [time, element term]."""
    columns = [f(e[:, i], v[:, i]) for i in range(e.shape[1]) for f in TERMS.values()]
    return np.column_stack(columns)


def nominal_forces(rig: Rig, states: States) -> Array:
    """What the nominal springs and dampers do to the nodes [N]."""
    to = rig.elongations()
    k = np.array([e.stiffness for e in rig.elements])
    c = np.array([e.damping for e in rig.elements])
    return np.asarray(-(states.displacement @ to.T * k + states.velocity @ to.T * c) @ to)


def by_element(coefficients: Array, rig: Rig) -> Array:
    """Force of each element's terms: the mean of what its two ends say [element, term]."""
    table = coefficients.reshape(len(rig.elements), len(TERMS), rig.size)
    forces = np.zeros(table.shape[:2])
    for i, element in enumerate(rig.elements):
        said = [-table[i, :, element.second]]
        if element.first != BASE:
            said.append(table[i, :, element.first])
        forces[i] = np.mean(said, axis=0)
    return forces


def name(
    forces: Array, features: Array, claimed: Claimed, method: str
) -> tuple[str, list[dict[str, object]]]:
    """Name the term that carries most; linear ones count beyond thrice their tolerance."""
    rig = claimed.rig
    excess = forces.copy()
    for i, element in enumerate(rig.elements):
        nominal = (element.stiffness, element.damping)
        for term in (0, 1):
            change = forces[i, term] - (0.0 if method == "discrepancy" else nominal[term])
            free = 3 * claimed.tolerance[term] * nominal[term]
            excess[i, term] = np.sign(change) * max(abs(change) - free, 0.0)
    carried = np.abs(excess) * features.std(axis=0).reshape(excess.shape)
    if not carried.any():
        return "nothing_missing", []
    row, column = divmod(int(carried.argmax()), len(TERMS))
    kind = list(TERMS)[column]
    value = float(excess[row, column])
    if kind == "cubic":
        kind = "cubic_hardening" if value > 0 else "cubic_softening"
    parameter, sign = PARAMETERS[kind]
    effect = {
        "effect": kind, "family": family_of(kind),
        "where": {"kind": "element", "id": rig.elements[row].id},
        "parameters": {parameter: {"value": sign * value, "sd": None}},
        "probability": float(carried.max() / carried.sum()),
    }  # fmt: skip
    return "missing_effect", [effect]


def free_run(
    claimed: Claimed, coefficients: Array | None, states: States, scale: Array, nominal: bool
) -> Array:
    """Run nominal model or discovered equation on a record from its smoothed first state."""
    rig, n = claimed.rig, claimed.rig.size
    to, masses = rig.elongations(), np.array(rig.masses)
    k = np.array([e.stiffness for e in rig.elements]) * nominal
    c = np.array([e.damping for e in rig.elements]) * nominal
    times = np.arange(len(states.force)) / states.rate_hz

    def rates(y: Array, t: float) -> Array:
        place = min(int(t * states.rate_hz), len(times) - 2)
        part = t * states.rate_hz - place
        force = states.force[place] * (1 - part) + states.force[place + 1] * part
        e, v = to @ y[:n], to @ y[n:]
        force = force - (k * e + c * v) @ to
        if coefficients is not None:
            slip = np.tanh(v / scale)
            terms = np.column_stack([e, v, e**2, e**3, np.abs(v) * v, slip, e**2 * v])
            force = force + terms.ravel() @ coefficients
        return np.asarray(np.concatenate([y[n:], force / masses]))

    start = np.concatenate([states.displacement[0], states.velocity[0]])
    moved = odeint(rates, start, times, rtol=1e-5, atol=1e-7 * np.abs(start).max() + 1e-9)
    moved = np.clip(np.nan_to_num(moved), -1e6, 1e6)
    acceleration = np.array([rates(y, t)[n:] for y, t in zip(moved, times, strict=True)])
    columns = []
    for sensor in claimed.sensors:
        node = rig.nodes.index(sensor["node"])
        of = {"displacement": moved[:, node], "velocity": moved[:, n + node]}
        of["acceleration"] = acceleration[:, node] + states.base
        columns.append(of[sensor["quantity"]])
    return np.column_stack(columns)


def main() -> int:
    """Answer as `slowtime diagnose` does."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--method", required=True)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--holdout", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    begun = time.monotonic()
    warnings.simplefilter("ignore")
    claimed = read_model(given.files[0])
    records = [read_states(path, claimed) for path in given.files[1:]]
    regression = Regression(given.method, claimed)
    rows = [regression.rows(states) for states in records]
    coefficients = regression.best(rows)
    features = np.concatenate([f for f, _ in rows])
    forces = by_element(coefficients, claimed.rig)
    verdict, effects = name(forces, features, claimed, given.method)
    held = read_states(given.holdout, claimed)
    to = claimed.rig.elongations()
    scale = 0.02 * np.concatenate([s.velocity @ to.T for s in records]).std(axis=0)
    found = free_run(claimed, coefficients, held, scale, given.method == "discrepancy")
    runs = {"augmented": found, "nominal": free_run(claimed, None, held, scale, True)}
    report = {"verdict": verdict, "effects": effects, "seconds": time.monotonic() - begun}
    write_report(given.out, report, runs, [s["channel"] for s in claimed.sensors])
    return 0


if __name__ == "__main__":
    sys.exit(main())
