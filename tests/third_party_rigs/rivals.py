r"""How far the best rival of what is missing is from it: what no diagnosis could tell apart.

A rival has another change of the model in the place of one of those that are missing. With
sizes, shapes and the constants of the model fitted within their tolerances, its noise-free
output differs from the true one by some nats: half the sum of squares, in standard deviations
of the noise. Forces are those along the true motion, and their difference reaches the sensors
through the true structure, linearised: exact to the first order in the difference of outputs,
and so where it is small. Without measured forces the spectra of parts of the records are
compared instead, whose distance is :math:`\tfrac12 \sum \| \Sigma^{-1/2} \delta\Sigma
\Sigma^{-1/2} \|^2` to that order; a law counts by its equivalent stiffness and damping in each.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import scipy.linalg
import scipy.optimize
from scipy.interpolate import CubicSpline

from .laws import EVERY, LAWS, ON_ONLY, RECORD_S, Change
from .rigs import FINE, GROUND, STILL, Excitation, Structure, direction, ground_motion, plain

REFINED = 6
"""Rivals whose shape is fitted, of those that are nearest with the shapes of the list."""
SHAPE_ERROR = 1e-6
"""[1] Of a shape that is fitted, over the distance of those in the list: what is seen lies up
to ten thousand standard deviations over the noise."""
PARTS = 3
"""Parts of an ambient record, so that what changes with time shows."""
KNOTS = 4
"""Of the shape of the spectrum of unmeasured forces."""
MEMORY_STEPS = 4
"""Of a law with memory, for each sample."""
DELAYS = (-0.02, -0.015, -0.01, -0.005, -0.002, 0.002, 0.005, 0.01, 0.015, 0.02)


@dataclasses.dataclass(frozen=True)
class Seen:
    """One record without noise.

    Parameters
    ----------
    motion
        Of the structure with all that the model lacks.
    told
        What its sensors tell of it [time, sensor], and its input [time], if any.
    noise
        Standard deviation of each sensor.
    """

    given: Excitation
    motion: Mapping[str, np.ndarray]
    told: np.ndarray
    input: np.ndarray | None
    noise: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """[s]."""
        return np.arange(self.given.samples) / self.given.rate_hz


@dataclasses.dataclass(frozen=True)
class Rig:
    """What is really there, and what its model says of it.

    Parameters
    ----------
    structure
        With all that the model lacks.
    missing
        What that is.
    amplitude
        Of elongation [m] and rate [m/s] between two points, by which shapes are scaled.
    off
        Of stiffness and damping of each part in the model, relative to the true ones.
    tolerance
        Of stiffness and damping, relative.
    ambient
        Whether forces are not measured.
    """

    structure: Structure
    missing: tuple[Change, ...]
    amplitude: Callable[[tuple[int, int]], tuple[float, float]]
    off: np.ndarray
    tolerance: tuple[float, float]
    ambient: bool

    @property
    def size(self) -> int:
        """Number of masses."""
        return len(self.structure.masses)


def told_late(series: np.ndarray, times: np.ndarray, late_s: float) -> np.ndarray:
    """Tell a series late by some seconds."""
    then = np.clip(times - late_s, times[0], times[-1])
    return np.asarray(CubicSpline(times, series)(then))


def values_along(change: Change, rig: Rig, seen: Seen) -> np.ndarray:
    """Force of a law for one unit of its size, along the true motion [time]."""
    e, v = elongation(change.at, seen.given, seen.motion)
    scale = rig.amplitude((change.at[0], change.at[1]))
    if change.what == "bouc_wen":
        return _memory(e, v, seen.given.rate_hz, 0.7 * change.shape * scale[0])
    law = EVERY[change.what].force(1.0, *scale, change.shape)
    return np.array([law(*one) for one in zip(e.tolist(), v.tolist(), seen.times, strict=True)])


def elongation(
    pair: tuple[int, ...], given: Excitation, motion: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Elongation [m] and its rate [m/s] between two points."""
    along = direction((pair[0], pair[1]), motion["x"].shape[1])
    e, v = motion["x"] @ along, motion["dx"] @ along
    if STILL in pair:
        times = np.arange(given.samples) / given.rate_hz
        ground, sign = ground_motion(given), 1.0 if pair[0] == STILL else -1.0
        e, v = e + sign * ground(times), v + sign * ground(times, 1)
    return e, v


def _memory(e: np.ndarray, v: np.ndarray, rate_hz: float, yields_m: float) -> np.ndarray:
    found, z = np.zeros(len(e)), 0.0
    step = 1 / (rate_hz * MEMORY_STEPS)
    fine = np.interp(np.arange(len(v) * MEMORY_STEPS) / MEMORY_STEPS, np.arange(len(v)), v)
    for k, speed in enumerate(fine.tolist()):
        if k % MEMORY_STEPS == 0:
            found[k // MEMORY_STEPS] = z
        share = (z / yields_m) ** 2
        z += step * speed * (1.0 - share * (1.0 + np.sign(speed * z)) / 2.0)
        # The law never goes beyond its yield; an explicit step that is too coarse would.
        z = min(max(z, -yields_m), yields_m)
    return found


def _share(what: str, times: np.ndarray) -> np.ndarray:
    """Share of a mass that is there."""
    if what == "lighter in time":
        return times / RECORD_S
    return np.where(times >= 0.4 * RECORD_S, 1.0, 0.0) if what == "lost mass" else times * 0 + 1


def _ridden(change: Change, omega: np.ndarray) -> np.ndarray:
    """Mass that a rider of unit mass seems to have, at each frequency."""
    own = 2 * math.pi * change.shape
    held = own**2 + 0.1j * own * omega
    return np.asarray(held / (held - omega**2))


def pushed(change: Change, rig: Rig, seen: Seen) -> np.ndarray:
    """Force on each coordinate by one unit of a change, along the true motion [time, dof]."""
    size, what, at = seen.motion["x"].shape[1], change.what, change.at
    found = np.zeros((seen.given.samples, size))
    if what in ("mass", "lighter in time", "lost mass"):
        found[:, at[0]] = -_share(what, seen.times) * seen.motion["a"][:, at[0]]
    elif what == "rider":
        omega = 2 * np.pi * np.fft.rfftfreq(2 * len(found), 1 / seen.given.rate_hz)
        spectrum = np.fft.rfft(seen.motion["a"][:, at[0]], 2 * len(found))
        found[:, at[0]] = -np.fft.irfft(spectrum * _ridden(change, omega))[: len(found)]
    elif what == "gyroscopic":
        found[:, at[0]] = -seen.motion["dx"][:, at[1]]
        found[:, at[1]] = seen.motion["dx"][:, at[0]]
    elif what.startswith("input"):
        assert seen.input is not None
        late = told_late(seen.input, seen.times, change.shape) - seen.input
        found[:, rig.size - 1] = seen.input if what == "input gain" else late
    else:
        along = direction((at[0], at[1]), size)
        found -= np.outer(values_along(change, rig, seen), along)
    return found


def misread(change: Change, seen: Seen) -> np.ndarray:
    """Change of what the sensors tell by one unit of a fault of theirs [time, sensor]."""
    found, i = np.zeros_like(seen.told), change.at[0]
    own = seen.motion["a"][:, i]
    found[:, i] = {
        "sensor gain": lambda: own,
        "sensor delay": lambda: told_late(own, seen.times, change.shape) - own,
        "elsewhere": lambda: seen.motion["a"][:, change.at[-1]] - own,
    }[change.what]()
    return found


def dynamic_stiffness(
    change: Change, rig: Rig, seen: Seen, omega: np.ndarray, part: slice = slice(None)
) -> np.ndarray:
    """Dynamic stiffness of one unit of a change, of laws an equivalent one [line, dof, dof]."""
    size, what, at, s = seen.motion["x"].shape[1], change.what, change.at, 1j * omega
    shape = np.zeros((size, size))
    if what in ("mass", "lighter in time", "lost mass", "rider"):
        shape[at[0], at[0]] = 1.0
        seems = np.full(len(s), float(np.mean(_share(what, seen.times)[part])))
        inertia = s**2 * (_ridden(change, omega) if what == "rider" else seems)
        return np.asarray(inertia[:, None, None] * shape)
    if what == "gyroscopic":
        shape[at], shape[at[::-1]] = 1.0, -1.0
        return np.asarray(s[:, None, None] * shape)
    along = direction((at[0], at[1]), size)
    force = values_along(change, rig, seen)[part]
    e, v = (one[part] - one[part].mean() for one in elongation(at, seen.given, seen.motion))
    force = force - force.mean()
    k, c = force @ e / (e @ e), force @ v / (v @ v)
    return np.asarray((k + c * s)[:, None, None] * np.outer(along, along))


def _true_stiffness(rig: Rig, seen: Seen, omega: np.ndarray) -> np.ndarray:
    """Dynamic stiffness of what is really there [line, dof, dof]."""
    mass, damping, stiffness = rig.structure.matrices()
    s = (1j * omega)[:, None, None]
    whole = s**2 * mass + s * damping + stiffness
    for one in rig.missing:
        if one.what in (*EVERY, "bouc_wen", "lighter in time", "lost mass"):
            whole = whole + one.size * dynamic_stiffness(one, rig, seen, omega)
    return np.asarray(whole)


Columns = Callable[[Change], np.ndarray]
"""From one unit of a change to what it does to all that is seen, in its standard deviations."""


class _Forced:
    """Outputs under measured forces, a measured motion of the base, or after a release."""

    def __init__(self, rig: Rig, records: Sequence[Seen]) -> None:
        self.rig, self.records = rig, records
        self.transfer = [self._transfer(seen) for seen in records]

    def _transfer(self, seen: Seen) -> np.ndarray:
        omega = 2 * np.pi * np.fft.rfftfreq(2 * seen.given.samples, 1 / seen.given.rate_hz)
        found = np.linalg.inv(_true_stiffness(self.rig, seen, omega))
        extra = self.rig.structure.extra or plain(found.shape[1], self.rig.size)
        return np.asarray(-(omega**2)[:, None, None] * (extra.reading @ found))

    def column(self, change: Change) -> np.ndarray:
        faulty = change.what in ("sensor gain", "sensor delay", "elsewhere")
        return self._stacked(
            misread(change, seen) if faulty else self._seen(i, pushed(change, self.rig, seen))
            for i, seen in enumerate(self.records)
        )

    def _seen(self, i: int, push: np.ndarray) -> np.ndarray:
        lines = np.fft.rfft(push, 2 * len(push), axis=0)
        return np.fft.irfft((self.transfer[i] @ lines[:, :, None])[:, :, 0], axis=0)[
            : len(push)
        ]

    def _stacked(self, parts: Iterator[np.ndarray]) -> np.ndarray:
        return np.concatenate([
            (part / seen.noise).ravel()
            for part, seen in zip(parts, self.records, strict=True)
        ])  # fmt: skip

    def constants(self) -> Iterator[np.ndarray]:
        for what, matrix in self.rig.structure.constants():
            yield self._stacked(
                self._seen(i, -seen.motion["x" if what == "stiffness" else "dx"] @ matrix)
                for i, seen in enumerate(self.records)
            )

    def nuisances(self) -> Iterator[np.ndarray]:
        """Give the decay of each coordinate from one unit of displacement and of velocity."""
        mass, damping, stiffness = self.rig.structure.matrices()
        size = len(mass)
        extra = self.rig.structure.extra or plain(size, self.rig.size)
        rows = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
        flow = np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), rows])
        for i, seen in enumerate(self.records):
            step = scipy.linalg.expm(flow / seen.given.rate_hz)
            state, decays = np.eye(2 * size), []
            for _ in range(seen.given.samples):
                decays.append(extra.reading @ rows @ state)
                state = step @ state
            each = np.stack(decays)
            for k in range(2 * size):
                none = [np.zeros_like(one.told) for one in self.records]
                none[i] = each[:, :, k]
                yield self._stacked(iter(none))


class _Ambient:
    """Spectral matrices of the parts of records, under forces that nobody measures."""

    def __init__(self, rig: Rig, records: Sequence[Seen]) -> None:
        self.rig, self.records = rig, records
        self.pieces = [self._piece(seen, k) for seen in records for k in range(PARTS)]

    def _piece(self, seen: Seen, k: int) -> dict[str, np.ndarray]:
        count = seen.given.samples // PARTS
        part = slice(k * count, (k + 1) * count)
        loads = seen.given.loads[::FINE]
        power = np.abs(np.fft.rfft(loads, axis=0)[:, 0])
        own = np.fft.rfftfreq(len(loads), 1 / seen.given.rate_hz)[power > 0.1 * power.max()]
        hertz = np.fft.rfftfreq(count, 1 / seen.given.rate_hz)
        hertz = hertz[(hertz > own[0]) & (hertz < own[-1])]
        omega = 2 * np.pi * hertz
        extra = self.rig.structure.extra or plain(seen.motion["x"].shape[1], self.rig.size)
        moved = np.linalg.inv(_true_stiffness(self.rig, seen, omega))
        read = -(omega**2)[:, None, None] * extra.reading
        density = loads.var(axis=0) / (own[-1] - own[0])
        push = extra.reading.T * np.sqrt(density)
        noise = np.diag(2 * seen.noise**2 / seen.given.rate_hz)
        told = read @ moved @ push
        sigma = told @ told.conj().swapaxes(1, 2) + noise
        white = np.linalg.inv(np.linalg.cholesky(sigma))
        return {
            "omega": omega, "moved": moved, "read": read, "push": push, "told": told,
            "sigma": sigma, "white": white, "noise": noise,
            "part": np.array([part.start, part.stop]),
        }  # fmt: skip

    def _whitened(self, deltas: Sequence[np.ndarray | None]) -> np.ndarray:
        flat = []
        for piece, delta in zip(self.pieces, deltas, strict=True):
            if delta is None:
                flat.append(np.zeros(2 * piece["sigma"].size))
                continue
            own = piece["white"] @ delta @ piece["white"].conj().swapaxes(1, 2)
            flat.append(np.concatenate([own.real.ravel(), own.imag.ravel()]))
        return np.concatenate(flat)

    def _moved(self, piece: dict[str, np.ndarray], stiffness: np.ndarray) -> np.ndarray:
        change = -piece["read"] @ piece["moved"] @ stiffness @ piece["moved"] @ piece["push"]
        half = change @ piece["told"].conj().swapaxes(1, 2)
        return np.asarray(half + half.conj().swapaxes(1, 2))

    def column(self, change: Change) -> np.ndarray:
        return self._whitened([
            self._delta(change, piece, self.records[i // PARTS])
            for i, piece in enumerate(self.pieces)
        ])  # fmt: skip

    def _delta(self, change: Change, piece: dict[str, np.ndarray], seen: Seen) -> np.ndarray:
        omega, i = piece["omega"], change.at[0]
        clean = piece["sigma"] - piece["noise"]
        turn = np.tile(np.eye(self.rig.size, dtype=complex), (len(omega), 1, 1))
        if change.what == "sensor gain":
            half = np.zeros_like(clean)
            half[:, i] = clean[:, i]
            return np.asarray(half + half.conj().swapaxes(1, 2))
        if change.what == "sensor delay":
            turn[:, i, i] = np.exp(-1j * omega * change.shape)
        elif change.what == "elsewhere":
            turn[:, i, i], turn[:, i, change.at[-1]] = 0.0, 1.0
        else:
            part = slice(*piece["part"].tolist())
            return self._moved(piece, dynamic_stiffness(change, self.rig, seen, omega, part))
        return np.asarray(turn @ clean @ turn.conj().swapaxes(1, 2) - clean)

    def constants(self) -> Iterator[np.ndarray]:
        for what, matrix in self.rig.structure.constants():
            order = int(what == "damping")
            yield self._whitened([
                self._moved(p, ((1j * p["omega"]) ** order)[:, None, None] * matrix)
                for p in self.pieces
            ])  # fmt: skip

    def nuisances(self) -> Iterator[np.ndarray]:
        """Give the density of each force, their shape, and the noise, in each record."""
        for record in range(len(self.records)):
            own = range(record * PARTS, (record + 1) * PARTS)

            for delta in self._of_forces():
                yield self._whitened([
                    delta(p) if i in own else None for i, p in enumerate(self.pieces)
                ])  # fmt: skip

    def _of_forces(self) -> Iterator[Callable[[dict[str, np.ndarray]], np.ndarray]]:
        """Give functions from a part to what density, noise and shape change in it."""
        for k in range(self.rig.size):

            def density(p: dict[str, np.ndarray], k: int = k) -> np.ndarray:
                told = p["told"][:, :, k]
                return np.asarray(told[:, :, None] * told[:, None, :].conj())

            def noise(p: dict[str, np.ndarray], k: int = k) -> np.ndarray:
                one = np.zeros_like(p["sigma"])
                one[:, k, k] = p["noise"][k, k]
                return one

            yield density
            yield noise
        for k in range(1, KNOTS):

            def shape(p: dict[str, np.ndarray], k: int = k) -> np.ndarray:
                log = np.log(p["omega"])
                hat = np.interp(log, np.linspace(log[0], log[-1], KNOTS), np.eye(KNOTS)[k])
                return np.asarray((p["sigma"] - p["noise"]) * hat[:, None, None])

            yield shape


def rivals(rig: Rig) -> Iterator[tuple[Change, ...]]:
    """List the changes of the generator's own list, each in every shape."""
    size = rig.size
    joined = {frozenset(link.between) for link in rig.structure.links}
    ends = [GROUND, *range(size)]
    ends += [STILL] * any(STILL in one.at for one in rig.missing)
    pairs = [p for p in itertools.combinations(ends, 2) if set(p) != {GROUND, STILL}]
    for pair in pairs:
        pair = (pair[1], pair[0]) if pair[1] == STILL else pair
        for what, law in EVERY.items():
            if what not in ON_ONLY or frozenset(pair) in joined:
                yield tuple(Change(what, pair, shape=shape) for shape in law.shapes)
        yield tuple(Change("bouc_wen", pair, shape=shape) for shape in LAWS["gap"].shapes)
        if GROUND not in pair and STILL not in pair:
            yield (Change("gyroscopic", pair),)
    lowest = float(rig.structure.frequencies_hz().min())
    for at in range(size):
        for what in ("mass", "lighter in time", "lost mass", "sensor gain"):
            yield (Change(what, (at,)),)
        own = (0.6, 0.8, 1.0, 1.3, 2.0, 3.0)
        yield tuple(Change("rider", (at,), shape=ratio * lowest) for ratio in own)
        yield tuple(Change("sensor delay", (at,), shape=late) for late in DELAYS)


def _rivals_of_input() -> Iterator[tuple[Change, ...]]:
    yield (Change("input gain", ()),)
    yield tuple(Change("input delay", (), shape=late) for late in DELAYS)


def distance(rig: Rig, records: Sequence[Seen]) -> tuple[float, float, str]:
    """Nats from what is missing to its best rival, and to a model that lacks nothing.

    Parameters
    ----------
    rig
        With at least one change that is missing.
    records
        Those that a diagnosis learns from.

    Returns
    -------
    Both distances, and the name of the best rival with its place.
    """
    found = _Distances(rig, records)
    least, name = math.inf, ""
    every = [*rivals(rig)]
    if records[0].input is not None:
        every += _rivals_of_input()
    ranked: list[tuple[float, int, tuple[Change, ...], Change]] = []
    for own in range(len(rig.missing)):
        for shapes in every:
            if (shapes[0].what, _ends(shapes[0])) == (
                rig.missing[own].what, _ends(rig.missing[own])
            ):  # fmt: skip
                continue
            nats, best = min(((found.of(own, one), one) for one in shapes), key=lambda o: o[0])
            ranked.append((nats, own, shapes, best))
    ranked.sort(key=lambda one: one[0])
    for nats, own, shapes, best in ranked[:REFINED]:
        fine = found.refined(own, shapes, best) if len(shapes) > 1 else nats
        if fine < least:
            least, name = fine, f"{best.what} at {'-'.join(map(str, best.at))}"
    return max(least, 0.0), found.none, name


def _ends(change: Change) -> frozenset[int]:
    return frozenset(change.at)


class _Distances:
    """Least squares of what is missing by other changes, constants and nuisances."""

    def __init__(self, rig: Rig, records: Sequence[Seen]) -> None:
        self.rig = rig
        self.side = (_Ambient if rig.ambient else _Forced)(rig, records)
        self.own = [self.side.column(one) for one in rig.missing]
        target = sum(one.size * c for one, c in zip(rig.missing, self.own, strict=True))
        constants = [*self.side.constants()]
        count = len(constants)
        sd = np.repeat(rig.tolerance, count // 2)
        common = np.stack([*constants, *self.side.nuisances()], axis=1)
        # Prior rows: the model states constants that are off, within their tolerances.
        prior = np.zeros((count, common.shape[1]))
        prior[:, :count] = np.diag(1 / sd)
        whole = np.concatenate([common, prior])
        self.rows = count
        self.known: dict[Change, np.ndarray] = {}
        self.basis = scipy.linalg.orth(whole / np.linalg.norm(whole, axis=0))
        self.left = self._free(np.concatenate([target, rig.off / sd]))
        self.own = [self._padded(c) for c in self.own]
        self.least = self._cost(self.own)
        self.none = self._cost([]) - self.least

    def _column(self, change: Change) -> np.ndarray:
        if change not in self.known:
            self.known[change] = self._padded(self.side.column(change))
        return self.known[change]

    def _padded(self, column: np.ndarray) -> np.ndarray:
        return self._free(np.concatenate([column, np.zeros(self.rows)]))

    def _free(self, column: np.ndarray) -> np.ndarray:
        return np.asarray(column - self.basis @ (self.basis.T @ column))

    def _cost(self, columns: Sequence[np.ndarray], signs: Sequence[bool] = ()) -> float:
        """Half the squares that are left; infinite where the last size has the wrong sign."""
        if not columns:
            return float(self.left @ self.left) / 2
        matrix = np.stack(columns, axis=1)
        sizes, *_ = np.linalg.lstsq(matrix, self.left, rcond=1e-10)
        if any(signs) and sizes[-1] < 0:
            return math.inf
        rest = self.left - matrix @ sizes
        return float(rest @ rest) / 2

    def of(self, own: int, rival: Change) -> float:
        """Nats of a rival in the place of one of what is missing."""
        others = [c for i, c in enumerate(self.own) if i != own]
        mine = self._column(rival)
        positive = rival.what in LAWS or rival.what in ("bouc_wen", "rider")
        return self._cost([*others, mine], [positive]) - self.least

    def refined(self, own: int, shapes: tuple[Change, ...], best: Change) -> float:
        """Nats of a rival with the best shape."""
        every = sorted(one.shape for one in shapes)
        at = every.index(best.shape)
        low, high = every[max(at - 1, 0)], every[min(at + 1, len(every) - 1)]
        solved = scipy.optimize.minimize_scalar(
            lambda shape: min(self.of(own, dataclasses.replace(best, shape=shape)), 1e12),
            bounds=(low, high), method="bounded",
            options={"maxiter": 40, "xatol": SHAPE_ERROR * (high - low)},
        )  # fmt: skip
        return float(min(solved.fun, self.of(own, best)))
