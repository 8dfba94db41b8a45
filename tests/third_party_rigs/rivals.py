"""How far the best rival of a linear effect is from it: what no diagnosis could tell apart.

A rival is another linear change of the model. With its size and the constants of the model
fitted within their tolerances, its noise-free output differs from the true one by some nats:
half the sum of squares, in standard deviations of the noise. Steady response at the lines of
the record; whatever is not linear has no number.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from .rigs import GROUND, Structure, direction

Change = tuple[str, tuple[int, ...]]
"""What is changed, and between or at which masses."""
LINES = 400
"""Lines of the spectrum that are compared, of those at which the load is."""
MOST_FITTED = 6
"""Rivals that are fitted to the end, of those that are nearest after one step."""


def changes(size: int) -> Iterator[Change]:
    """List every linear change of a model of some masses in one direction each."""
    pairs = list(itertools.combinations([GROUND, *range(size)], 2))
    yield from ((what, pair) for what in ("spring", "damper") for pair in pairs)
    yield from (("gyroscopic", pair) for pair in pairs if GROUND not in pair)
    for what in ("mass", "sensor gain", "sensor delay"):
        yield from ((what, (at,)) for at in range(size))
    yield from ((what, ()) for what in ("input gain", "input delay"))


def told(
    structure: Structure,
    factors: np.ndarray,
    change: Change,
    value: float,
    omega: np.ndarray,
    load: np.ndarray,
) -> np.ndarray:
    """Spectrum of each accelerometer [line, mass] under a load on the last mass.

    Parameters
    ----------
    factors
        Of the stiffness of each link, then of the damping of each [1].
    """
    what, at = change
    size, s = len(structure.masses), 1j * omega
    mass, damping, stiffness = (
        np.diag(structure.masses),
        np.zeros((size,) * 2),
        np.zeros((size,) * 2),
    )
    half = len(structure.links)
    for k, link in enumerate(structure.links):
        outer = np.outer(*[direction(link.between, size)] * 2)
        stiffness = stiffness + factors[k] * link.stiffness * outer
        damping = damping + factors[half + k] * link.damping * outer
    along = direction(at, size) if len(at) == 2 else np.zeros(size)
    stiffness = stiffness + value * np.outer(along, along) * (what == "spring")
    damping = damping + value * np.outer(along, along) * (what == "damper")
    if what == "gyroscopic":
        damping[at] += value
        damping[at[::-1]] -= value
    if what == "mass":
        mass[at[0], at[0]] += value
    whole = s[:, None, None] ** 2 * mass + s[:, None, None] * damping + stiffness
    push = np.zeros((len(omega), size, 1), dtype=complex)
    push[:, -1, 0] = load
    seen = s[:, None] ** 2 * np.linalg.solve(whole, push)[:, :, 0]
    factor = np.exp(-s * value) if what.endswith("delay") else np.full(len(s), value + 0j)
    if what.startswith("input"):
        seen = seen * factor[:, None]
    elif what.startswith("sensor"):
        seen[:, at[0]] *= factor
    return np.asarray(seen)


def least_nats(
    structure: Structure, model: dict[str, Any], truth: Sequence[Any], record: Any
) -> float | None:
    """Nats between the truth and its best rival; None where the truth is not one linear change.

    Parameters
    ----------
    structure
        What the model stands for, without the change.
    model
        As a user has it.
    truth
        What it lacks.
    record
        With times `t` and load `u`.
    """
    if len(truth) != 1 or truth[0].linear is None or not structure.links:
        return None
    size, samples = len(structure.masses), len(record["t"])
    spectrum = np.fft.rfft(record["u"])
    omega = 2 * np.pi * np.fft.rfftfreq(samples, record["t"][1] - record["t"][0])
    loud = np.flatnonzero(np.abs(spectrum) > 0.05 * np.abs(spectrum).max())
    kept = loud[:: max(len(loud) // LINES, 1)]
    omega, load = omega[kept], spectrum[kept]
    ones = np.ones(2 * len(structure.links))
    given = np.array([
        part[key] / getattr(link, own)
        for key, own in (("stiffness_n_per_m", "stiffness"), ("damping_n_s_per_m", "damping"))
        for part, link in zip(model["elements"], structure.links, strict=True)
    ])  # fmt: skip
    spread = np.repeat(
        [model["tolerance"]["stiffness"], model["tolerance"]["damping"]], len(ones) // 2
    )
    true = told(structure, ones, truth[0].linear, truth[0].value, omega, load)
    noise = np.array([one["noise_sd"] for one in model["sensors"]])
    # White noise has the mean square n sd^2 at each line, half of it in either part.
    weight = np.sqrt(len(loud) / len(kept) * 2 / samples) / noise

    def left(x: np.ndarray, change: Change, unit: float, none: float) -> np.ndarray:
        seen = told(structure, x[:-1], change, none + unit * x[-1], omega, load)
        apart = ((seen - true) * weight).ravel()
        return np.concatenate([apart.real, apart.imag, (x[:-1] - given) / spread])

    def fitted(change: Change, starts: Sequence[np.ndarray], evaluations: int) -> float:
        none, unit = float(change[0].endswith("gain")), _unit(structure, change)
        costs = [
            least_squares(left, x, args=(change, unit, none), max_nfev=evaluations).cost
            for x in starts
        ]
        return float(min(costs))

    own = truth[0].linear
    size_of = (truth[0].value - float(own[0].endswith("gain"))) / _unit(structure, own)
    least = fitted(own, [np.append(ones, size_of)], 30)
    starts = [np.append(given, sign * 0.1) for sign in (-1.0, 1.0)]
    rivals = [one for one in changes(size) if one != own]
    near = sorted(rivals, key=lambda one: fitted(one, starts, 2))[:MOST_FITTED]
    return max(min(fitted(one, starts, 30) for one in near) - least, 0.0)


def _unit(structure: Structure, change: Change) -> float:
    """Size of a change that is a large one."""
    stiffness = float(np.mean([link.stiffness for link in structure.links]))
    omega = 2 * np.pi * float(structure.frequencies_hz().min())
    mass = float(np.mean(structure.masses))
    return {
        "spring": stiffness, "damper": stiffness / omega, "gyroscopic": stiffness / omega,
        "mass": mass, "sensor delay": 0.1, "input delay": 0.1,
    }.get(change[0], 1.0)  # fmt: skip
