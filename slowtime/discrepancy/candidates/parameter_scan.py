"""A kind and a place in; the parameters with which it explains most there, out."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.localization import Located
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Hidden,
    InputChange,
    Kind,
    Law,
    Motion,
    Parameter,
    Place,
    SensorChange,
    force_along,
)
from slowtime.dynamics.plant.parameter_names import lowest
from slowtime.dynamics.units import unit_factor

from .force_space import Space
from .modulation import modulation_frequencies_hz

STEP = 1e-4
"""Of a parameter of a sensor or an input, to see what it does."""
NOTHING_LEFT = 0.01
"""Share of a series that a factor must leave: less is another series, not the same changed."""
IDLE = 0.02
"""Share of a series below which a change of it is none."""
STILL_HZ, COARSE_TURN, POLISHED = 1e-12, 0.1, 3
"""A frequency at which nothing turns; turns over the campaign by which one is moved at first,
and how often one looks closer."""
LOUD = 2
"""Lines of each record, the loudest at the sensors, about which a tone is looked for."""
MOST_CLOSER, ASIDE = 4, 0.12
"""How often one looks closer at an instant or a resonance, and how far beside that at first."""
FINEST_S = 0.02
"""Spacing of instants at which looking closer ends."""
SOME = 4
"""Shapes of a law to begin a fit with, where none is known to be the best."""

HALF, SCANNED, NEWTON = 0.5, 16, 5
"""Relative change of a series from one scanned value to the next; values on either side; steps
from the best of them."""

Shape = Mapping[str, float]
Column = Float[np.ndarray, "time column"]
Values = Float[np.ndarray, " value"]


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
        return _polished(kind, found, space, motions)
    best = _best_shape(kind, space, motions, shapes)
    if best is not None and isinstance(kind.action, Hidden) and kind.action.coordinates:
        return _nearer(kind, best, space, motions)
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


def scanned(kind: Kind, space: Space) -> list[dict[str, float]]:
    """Give a kind in every shape that makes sense, with a unit of its strength."""
    unit = 1.0 if kind.strength is None else _unit(kind)
    shapes = _shapes(kind, space, [latent.motion for latent in space.latents])
    return [dict(shape) | _scaled(kind, shape, unit) for shape in shapes]


def sized(kind: Kind, parameters: Shape, strength: float) -> dict[str, float]:
    """Give a kind so many times its strength, with all that goes with that."""
    scaled = (kind.strength, *kind.scales)
    return {n: strength * value if n in scaled else value for n, value in parameters.items()}


def has_strength(kind: Kind) -> bool:
    """Whether a kind is a force that one number, and no phase, makes stronger."""
    law = isinstance(kind.action, Law | Friction | Hidden)
    return law and bool(kind.strength) and not kind.quadrature


def as_strong(
    kind: Kind,
    place: Place,
    motion: Motion,
    force: Float[np.ndarray, " time"],
    description: Description,
    shares: Sequence[float],
    most: int = SOME,
) -> Iterator[Effect]:
    """Give a law in some of its shapes, its force so many times as strong as another.

    Parameters
    ----------
    motion, force
        At its place.
    most
        Shapes.
    """
    shapes = list(kind.shapes(motion))
    some = np.unique(np.linspace(0, len(shapes) - 1, min(most, len(shapes))).astype(int))
    assert kind.strength is not None
    for shape in (shapes[i] for i in some):
        unit = dict(shape) | {kind.strength: 1.0}
        size = float(np.std(force_along(kind, unit, motion)))
        if not 0 < size < math.inf:
            continue
        for share in shares:
            strength = share * float(np.std(force)) / size
            parameters = sized(kind, unit, strength)
            if strength and possible(kind, parameters, description, place):
                yield Effect(kind.name, place, parameters)


def possible(kind: Kind, parameters: Shape, description: Description, place: Place) -> bool:
    """Whether a kind may have such parameters at a place."""
    least = lowest(description, place, kind)
    return not any(kind.parameter(n).refuses(v) or v <= least for n, v in parameters.items())


def made_by(kind: Kind, effect: Effect, space: Space) -> list[Column]:
    """Give what an effect does at its place, along the motion recovered there."""
    action = kind.action
    if not isinstance(action, SensorChange | InputChange):
        return [force_along(kind, effect.parameters, x.motion)[:, None] for x in space.latents]
    values, factor = kind.values(effect.parameters), _factor(space)
    return [
        factor * (action.act(x.motion.e, x.motion.times, values) - x.motion.e)[:, None]
        for x in space.latents
    ]


def gained(found: tuple[Effect, float]) -> float:
    """Second of a pair: what an effect gains."""
    return found[1]


def _shapes(kind: Kind, space: Space, motions: list[Motion]) -> list[Shape]:
    """Shapes that make sense: frequencies of one record at a time, all else of the campaign."""
    if not any(parameter.unit == "Hz" for parameter in kind.parameters):
        return kind.shapes(joined(motions))
    longest = max(range(len(motions)), key=lambda i: len(motions[i].times))
    shapes = kind.shapes(motions[longest])
    if kind.quadrature is None or "frequency_hz" not in kind.names:
        return shapes
    return shapes + _turning(kind, shapes, space)


def _turning(kind: Kind, shapes: list[Shape], space: Space) -> list[Shape]:
    """Frequencies of a clock that is none of the motion's."""
    assert kind.quadrature is not None
    assert kind.strength is not None
    others = dict(shapes[0]) if shapes else {}
    still = others | {kind.strength: 1.0, kind.quadrature: 0.0, "frequency_hz": STILL_HZ}
    if set(still) != set(kind.names):
        return []
    # A sine is nothing where a cosine is whole.
    turns = ({**still, kind.quadrature: turn} for turn in (0.0, math.pi / 2))
    both = (
        [force_along(kind, one, latent.motion) for latent in space.latents] for one in turns
    )
    laws = max(both, key=lambda forces: sum(float(one @ one) for one in forces))
    same = all(bool(np.all(law == law[:1])) for law in laws)
    found = modulation_frequencies_hz(
        [latent.force for latent in space.latents],
        laws,
        [latent.motion.times for latent in space.latents],
        _heard_hz(space.located) if same else (),
    )
    return [others | {"frequency_hz": hertz} for hertz in found]


def _heard_hz(located: Located) -> list[float]:
    """Lines that are loudest over the noise of the sensors, those of each record."""
    found: list[float] = []
    for one in located.lines:
        loud = np.sum(np.abs(one.residual) ** 2 / one.noise, axis=1)
        found += one.frequency_hz[np.argsort(-loud)[:LOUD]].tolist()
    return [hertz for hertz in found if hertz > 0]


def _polished(
    kind: Kind, found: tuple[Effect, float], space: Space, motions: list[Motion]
) -> tuple[Effect, float]:
    """Give a better frequency: one over the campaign is how far a phase holds."""
    span = max(float(m.times[-1]) for m in motions) - min(float(m.times[0]) for m in motions)
    step = COARSE_TURN / span
    for _ in range(POLISHED):
        here = found[0].parameters["frequency_hz"]
        rest = {
            name: value
            for name, value in found[0].parameters.items()
            if name not in (kind.strength, kind.quadrature)
        }
        about = [rest | {"frequency_hz": here + k * step} for k in (-3, -2, -1, 1, 2, 3)]
        near = _best_quadrature(
            kind, space, motions, [one for one in about if one["frequency_hz"] > 0]
        )
        found = max(found, near, key=gained)
        step /= 4
    return found


def _nearer(
    kind: Kind, found: tuple[Effect, float], space: Space, motions: list[Motion]
) -> tuple[Effect, float]:
    """Give a better resonance: a light one is far narrower than the first look is fine."""
    assert kind.strength is not None
    wide = ASIDE
    for _ in range(MOST_CLOSER):
        known = found[0].parameters
        scaled = (kind.strength, *kind.scales)
        here = {
            name: value / known[kind.strength] if name in scaled else value
            for name, value in known.items()
        }
        others = [name for name in kind.scales if here[name] > 0]
        near: list[Shape] = [
            here
            | {name: here[name] * (1 + k * wide) for name in here if name not in scaled}
            | {name: here[name] * (1 + 4 * wide) ** turn for name in others}
            for k in (-1.0, -0.5, 0.0, 0.5, 1.0)
            for turn in (-1, 0, 1)
        ]
        found = max(found, _best_shape(kind, space, motions, near) or found, key=gained)
        wide /= 2
    return found


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
        np.array([force_along(kind, p, motion) for p in whole]).T for motion in motions
    )
    strengths, gains = space.one(forces)
    for parameters, strength, gain in zip(whole, strengths, gains, strict=True):
        found = sized(kind, parameters, float(strength))
        can = possible(kind, found, space.located.linear.description, space.place)
        if can and gain > 0 and (best is None or gain > best[1]):
            best = Effect(kind.name, space.place, found), float(gain)
    return best


def _best_quadrature(
    kind: Kind,
    space: Space,
    motions: list[Motion],
    shapes: list[Shape],
) -> tuple[Effect, float]:
    """Of a phase, by its two quadratures; `shapes` must not be empty."""
    assert kind.quadrature is not None
    assert kind.strength is not None
    whole = [
        dict(shape) | {kind.quadrature: turn, kind.strength: 1.0}
        for shape in shapes
        for turn in (0.0, math.pi / 2)
    ]
    forces = space.lines_of(
        np.array([force_along(kind, p, motion) for p in whole]).T for motion in motions
    )
    inner, seen = space.normal(forces)
    best: tuple[float, Shape, Values] | None = None
    for number, shape in enumerate(shapes):
        own = slice(2 * number, 2 * number + 2)
        strength = np.linalg.lstsq(inner[own, own], seen[own], rcond=1e-9)[0]
        gain = float(strength @ seen[own])
        if best is None or gain > best[0]:
            best = gain, shape, strength
    assert best is not None
    gain, shape, strength = best
    found = dict(shape) | {
        kind.strength: float(np.hypot(*strength)),
        kind.quadrature: float(np.arctan2(strength[1], strength[0])),
    }
    return Effect(kind.name, space.place, found), gain


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
        fine = fine and (idle == 0 or abs(value) > NOTHING_LEFT)
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


def joined(motions: list[Motion]) -> Motion:
    """One motion after the other as the campaign went, for what shapes make sense."""
    motions = sorted(motions, key=lambda motion: float(motion.times[0]))
    return Motion(
        e=np.concatenate([m.e for m in motions]),
        v=np.concatenate([m.v for m in motions]),
        a=np.concatenate([m.a for m in motions]),
        times=np.concatenate([m.times for m in motions]),
    )


def retuned(kind: Kind, space: Space) -> tuple[Effect, float] | None:
    """Of an effect that is to the sensors as if constants had moved: by their own moves.

    They have tolerances, the effect has none; a mass that is added is to a shaken base as if
    both stiffness and damping were smaller.
    """
    if not like_constant(kind):
        return None
    unit = dict.fromkeys(kind.names, 1.0)
    force = [force_along(kind, unit, latent.motion)[:, None] for latent in space.latents]
    strength, gain = space.within_constants(space.lines_of(force))
    found = {kind.names[0]: strength}
    can = possible(kind, found, space.located.linear.description, space.place)
    if gain <= 0 or not can:
        return None
    return Effect(kind.name, space.place, found), gain


def like_constant(kind: Kind) -> bool:
    """Whether a kind does what a constant of its place does: the constant's tolerance tells."""
    action = kind.action
    return isinstance(action, Hidden) and not action.coordinates and len(kind.names) == 1
