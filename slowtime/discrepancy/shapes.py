"""A kind and a place in; the parameters with which it explains most there, out."""

import math
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Hidden,
    InputChange,
    Kind,
    Law,
    Motion,
    Parameter,
    SensorChange,
    force_along,
)
from slowtime.dynamics.units import unit_factor

from .space import Space

MOST_STEPS = 100
"""Frequencies that are tried on either side of one that was found."""
STEP = 1e-4
"""Of a parameter of a sensor or an input, to see what it does."""
IDLE = 0.02
"""Share of a series below which a change of it is none."""
MOST_CLOSER = 4
"""How often one looks closer at an instant, and at what."""
FINEST_S = 0.02
"""Spacing of instants at which looking closer ends."""

HALF, SCANNED, NEWTON = 0.5, 16, 5
"""Relative change of a series from one scanned value to the next; values on either side; steps
from the best of them."""

Shape = Mapping[str, float]
Column = Float[np.ndarray, "time column"]


@runtime_checkable
class Acted(Protocol):
    """What a value of a parameter changes, trial by trial; or in one only."""

    def __call__(self, value: float, only: int | None = None) -> list[Column]:
        """Give the change."""
        ...


def best_of(kind: Kind, space: Space) -> tuple[Effect, float] | None:
    """Give the parameters of a kind that explain most at a place, and what they gain."""
    if isinstance(kind.action, Law | Friction | Hidden):
        return _best_force(kind, space)
    if isinstance(kind.action, SensorChange | InputChange):
        return _best_change(kind, kind.action, space)
    return None


def _best_force(kind: Kind, space: Space) -> tuple[Effect, float] | None:
    motions = [latent.motion for latent in space.latents]
    shapes = _shapes(kind, space, motions)
    if not shapes:
        return None
    if kind.quadrature is not None:
        found = _best_quadrature(kind, space, motions, shapes)
        if "frequency_hz" not in kind.names:
            return found
        finer = _beside(kind, found[0], motions)
        return max(found, _best_quadrature(kind, space, motions, finer), key=gained)
    best = _best_shape(kind, space, motions, shapes)
    switches = kind.action.switches if isinstance(kind.action, Law) else ()
    if best is None or len(switches) != 1:
        return best
    finer = shapes
    for _ in range(MOST_CLOSER):
        finer = _between(switches[0], best[0], finer)
        best = max(best, _best_shape(kind, space, motions, finer) or best, key=gained)
        instants = sorted(shape[switches[0]] for shape in finer)
        if instants[1] - instants[0] < FINEST_S:
            break
    return best


def gained(found: tuple[Effect, float]) -> float:
    """Second of a pair: what an effect gains."""
    return found[1]


def _shapes(kind: Kind, space: Space, motions: list[Motion]) -> list[Shape]:
    """Shapes that make sense: frequencies of one record at a time, all else of the campaign."""
    if not any(parameter.unit == "Hz" for parameter in kind.parameters):
        return kind.shapes(_joined(motions))
    longest = max(range(len(motions)), key=lambda i: len(motions[i].times))
    shapes = kind.shapes(motions[longest])
    if kind.where == "node" and kind.quadrature is not None:
        # A tone from outside is a line of the force, be it none of the motion.
        force, times = space.latents[longest].force, motions[longest].times
        shapes = shapes + kind.shapes(Motion(e=force, v=force, a=force, times=times))
    return shapes


def _beside(kind: Kind, found: Effect, motions: list[Motion]) -> list[Shape]:
    """Frequencies about one that was found, close enough for phases to hold all along."""
    first = min(float(m.times[0]) for m in motions)
    last = max(float(m.times[-1]) for m in motions)
    width = 1.0 / min(float(m.times[-1] - m.times[0]) for m in motions)
    steps = min(int(np.ceil(4 * width * (last - first))), MOST_STEPS)
    about = found.parameters["frequency_hz"] + width * np.linspace(-1, 1, 2 * steps + 1)
    kept = {
        name: value
        for name, value in found.parameters.items()
        if name not in (kind.strength, kind.quadrature)
    }
    return [kept | {"frequency_hz": float(f)} for f in about if f > 0]


def _between(name: str, found: Effect, shapes: list[Shape]) -> list[Shape]:
    """Values of one shape parameter between the neighbours of the one that was best."""
    values = sorted({shape[name] for shape in shapes})
    at = int(np.argmin(np.abs(np.array(values) - found.parameters[name])))
    low, high = values[max(at - 1, 0)], values[min(at + 1, len(values) - 1)]
    others = next(shape for shape in shapes if shape[name] == values[at])
    return [dict(others) | {name: float(v)} for v in np.linspace(low, high, 21)]


def _best_shape(
    kind: Kind, space: Space, motions: list[Motion], shapes: list[Shape]
) -> tuple[Effect, float] | None:
    best: tuple[Effect, float] | None = None
    unit = 1.0 if kind.strength is None else _unit(kind)
    whole = [dict(shape) | _scaled(kind, shape, unit) for shape in shapes]
    forces = space.lines_of(
        np.stack([force_along(kind, p, motion) for p in whole], axis=1) for motion in motions
    )
    strengths, gains = space.one(forces)
    for parameters, strength, gain in zip(whole, strengths, gains, strict=True):
        found = dict(parameters)
        for name in (kind.strength, *kind.scales):
            if name is not None:
                found[name] = parameters[name] * float(strength)
        refused = any(kind.parameter(n).refuses(v) for n, v in found.items())
        if not refused and gain > 0 and (best is None or gain > best[1]):
            best = Effect(kind.name, space.place, found), float(gain)
    return best


def _best_quadrature(
    kind: Kind, space: Space, motions: list[Motion], shapes: list[Shape]
) -> tuple[Effect, float]:
    """Of a phase, by its two quadratures; `shapes` must not be empty."""
    assert kind.quadrature is not None
    assert kind.strength is not None
    best: tuple[Effect, float] | None = None
    for shape in shapes:
        pair = [
            dict(shape) | {kind.quadrature: turn, kind.strength: 1.0}
            for turn in (0.0, math.pi / 2)
        ]
        forces = space.lines_of(
            np.stack([force_along(kind, p, motion) for p in pair], axis=1) for motion in motions
        )
        inner, seen = space.normal(forces)
        strength = np.linalg.lstsq(inner, seen, rcond=1e-9)[0]
        gain = float(strength @ seen)
        if best is None or gain > best[1]:
            found = dict(shape) | {
                kind.strength: float(np.hypot(*strength)),
                kind.quadrature: float(np.arctan2(strength[1], strength[0])),
            }
            best = Effect(kind.name, space.place, found), gain
    assert best is not None
    return best


def _best_change(
    kind: Kind, action: SensorChange | InputChange, space: Space
) -> tuple[Effect, float] | None:
    """Of a sensor or an input: a parameter that can do nothing does a little."""
    fitted = [p for p in kind.parameters if p.fitted]
    if len(fitted) != 1:
        return None
    fixed = {p.name: _end(p.default, space) for p in kind.parameters if not p.fitted}
    name, factor = fitted[0].name, _factor(space)
    series = [(latent.motion.e, latent.motion.times) for latent in space.latents]

    def acted(value: float, only: int | None = None) -> list[Column]:
        values = kind.values(fixed | {name: value})
        return [
            factor * (action.act(one, times, values) - one)[:, None]
            if only in (None, i)
            else one[:, None]
            for i, (one, times) in enumerate(series)
        ]

    sizes = [float(np.abs(factor * one).max(initial=0.0)) for one, _ in series]

    def idles(value: float) -> bool:
        return all(
            float(np.abs(one).max(initial=0.0)) <= IDLE * size
            for one, size in zip(acted(value), sizes, strict=True)
        )

    for idle in (0.0, 1.0):
        if fitted[0].refuses(idle) is None and idles(idle):
            step = STEP if fitted[0].unit in ("", "s") else 1.0
            if not any(one.any() for one in acted(idle + step)):
                continue
            found = _best_value(space, acted, fitted[0], idle, step)
            if found is None:
                return None
            return Effect(kind.name, space.place, fixed | {name: found[0]}), found[1]
    return _best_bend(kind, space, acted, fixed, name)


def _best_value(
    space: Space, acted: Acted, parameter: Parameter, idle: float, step: float
) -> tuple[float, float] | None:
    """Value that explains most, and its gain: by one step where its action is proportional.

    Else by a scan of one record, each value changing the series by half of itself more, and by
    Gauss's and Newton's steps from the best.
    """
    moved = acted(idle + step)
    double = acted(idle + 2 * step)
    if all(
        np.allclose(2 * one, two, rtol=1e-6) for one, two in zip(moved, double, strict=True)
    ):
        strength, won = space.one(space.lines_of([one / step for one in moved]))
        value = idle + float(strength[0])
        fine = parameter.refuses(value) is None and won[0] > 0
        return (value, float(won[0])) if fine else None
    sizes = [float(np.linalg.norm(latent.motion.e)) for latent in space.latents]
    changes = [float(np.linalg.norm(one)) for one in moved]
    wide = HALF * step * sum(sizes) / max(sum(changes), 1e-300)
    shortest = int(np.argmin([len(latent.motion.e) for latent in space.latents]))
    best = idle, 0.0
    for number in range(-SCANNED, SCANNED + 1):
        value = idle + number * wide
        if number == 0 or parameter.refuses(value) is not None:
            continue
        series = [
            one if i == shortest else np.zeros_like(one)
            for i, one in enumerate(acted(value, only=shortest))
        ]
        inner, seen = space.normal(space.lines_of(series))
        gain = float(2 * seen[0] - inner[0, 0])
        best = (value, gain) if gain > best[1] else best
    value, gain = best[0], -math.inf
    for _ in range(NEWTON):
        here, there = acted(value), acted(value + step)
        pair = [
            np.concatenate([a, (b - a) / step], axis=1)
            for a, b in zip(here, there, strict=True)
        ]
        inner, seen = space.normal(space.lines_of(pair))
        now = float(2 * seen[0] - inner[0, 0])
        if now > gain:
            best, gain = (value, now), now
        if inner[1, 1] <= 0:
            break
        move = float((seen[1] - inner[0, 1]) / inner[1, 1])
        value += float(np.clip(move, -wide, wide))
        if parameter.refuses(value) is not None:
            break
    return best if gain > 0 else None


def _best_bend(
    kind: Kind,
    space: Space,
    acted: Acted,
    fixed: dict[str, float],
    name: str,
) -> tuple[Effect, float] | None:
    """Of a sensor that can only be straight by an endless parameter: a scan."""
    top = max(float(np.abs(latent.motion.e).max()) for latent in space.latents)
    best: tuple[Effect, float] | None = None
    for share in np.geomspace(0.25, 0.97, 14):
        forces = space.lines_of(acted(share * top))
        inner, seen = space.normal(forces)
        gain = float(2 * seen[0] - inner[0, 0])
        if gain > 0 and (best is None or gain > best[1]):
            best = Effect(kind.name, space.place, fixed | {name: float(share * top)}), gain
    return best


def _end(default: float | None, space: Space) -> float:
    last = max(float(latent.motion.times[-1]) for latent in space.latents)
    return last if default is None or math.isnan(default) else default


def _factor(space: Space) -> float:
    """From the unit of an input to SI; sensors keep theirs."""
    description = space.located.linear.description
    if space.place.kind != "input":
        return 1.0
    entry = next(i for i in description.inputs if i.channel == space.place.id)
    coordinate = description.unit_of_coordinate
    if entry.node is None:
        return unit_factor(entry.unit, "acceleration", coordinate)
    return unit_factor(entry.unit, "force", coordinate)


def _unit(kind: Kind) -> float:
    assert kind.strength is not None
    parameter = kind.parameter(kind.strength)
    return -1.0 if parameter.high <= 0 else 1.0


def _scaled(kind: Kind, shape: Shape, unit: float) -> dict[str, float]:
    return (
        {} if kind.strength is None else {kind.strength: unit * shape.get(kind.strength, 1.0)}
    )


def _joined(motions: list[Motion]) -> Motion:
    """One motion after the other as the campaign went, for what shapes make sense."""
    motions = sorted(motions, key=lambda motion: float(motion.times[0]))
    return Motion(
        e=np.concatenate([m.e for m in motions]),
        v=np.concatenate([m.v for m in motions]),
        a=np.concatenate([m.a for m in motions]),
        times=np.concatenate([m.times for m in motions]),
    )


def retuned(kind: Kind, space: Space) -> tuple[Effect, float] | None:
    """Of an effect that does what a constant of its element does: the constant's own move.

    To the sensors both are one; but the constant has a tolerance, the effect has none.
    """
    if (
        not isinstance(kind.action, Hidden)
        or kind.action.coordinates
        or kind.where != "element"
    ):
        return None
    if set(kind.names) != {kind.strength}:
        return None
    own = [float(matrix.sum()) for matrix in kind.action.matrices(np.ones(1))]
    acts = [i for i, one in enumerate(own) if one != 0]
    what = ("mass", "damping", "stiffness")[acts[0]]
    if len(acts) != 1 or (what, space.place.id) not in space.moves:
        return None
    moved, pull = space.moves[what, space.place.id]
    assert kind.strength is not None
    value = moved / own[acts[0]]
    if kind.parameter(kind.strength).refuses(value) is not None:
        return None
    return Effect(kind.name, space.place, {kind.strength: value}), pull**2
