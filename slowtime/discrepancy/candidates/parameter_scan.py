"""Parameters with which a kind of effect explains most at a place."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.localization import Localization
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

from .force_space import ForceSpace
from .modulation import modulation_frequencies_hz

DIFFERENCE_STEP = 1e-4
"""[1] Step of a parameter of a sensor or an input for a difference of its effect. Source:
near the cube root of double precision, with margin for noise of the series."""
MIN_FACTOR = 0.01
"""[1] That a factor of a series must leave: less is another series. Source:
docs/what_decides.md: half and double change no answer."""
IDLE_SHARE = 0.02
"""[share of a series] Below which a change of it is none. Source: docs/what_decides.md: half
and double change no answer."""
STILL_HZ = 1e-12
"""[Hz] A frequency at which nothing turns. Source: one turn in 30,000 years."""
COARSE_TURN = 0.1
"""[turns over the campaign] By which a frequency is moved at first. Source:
docs/what_decides.md: half and double change no answer."""
FREQUENCY_REFINEMENTS = 3
"""[1] Times that step is refined, by four. Source: docs/what_decides.md: half and double change
no answer."""
LOUDEST_LINES = 2
"""[lines] Of each record about which a tone is looked for. Source: docs/what_decides.md: half
and double change no answer."""
REFINEMENTS = 4
"""[1] Times an instant or a resonance is refined at most. Source: docs/what_decides.md: half
and double change no answer."""
RESONANCE_STEP = 0.12
"""[1] Relative step of a resonance at first. Source: docs/what_decides.md: half and double
change no answer."""
MIN_INSTANT_STEP_S = 0.02
"""[s] Spacing of instants at which the refinement ends. Source: docs/what_decides.md: half and
double change no answer."""
MAX_START_SHAPES = 4
"""[1] Shapes of a law to begin a fit with, where none is known to be the best. Source:
docs/what_decides.md: half and double change no answer."""

SCAN_CHANGE = 0.5
"""[1] Relative change of a series from one scanned value to the next. Source:
docs/what_decides.md: half and double change no answer."""
SCAN_VALUES = 16
"""[1] Values that are scanned on either side. Source: docs/what_decides.md: half and double
change no answer."""
GAUSS_NEWTON_STEPS = 5
"""[steps] Of Gauss and Newton from the best of them. Source: docs/what_decides.md: half and
double change no answer."""

Shape = Mapping[str, float]
Column = Float[np.ndarray, "time column"]
Values = Float[np.ndarray, " value"]


@runtime_checkable
class ParameterAction(Protocol):
    """Change of a series by a value of a parameter, trial by trial."""

    def __call__(self, value: float, only: int | None = None) -> list[Column]:
        """Compute the change, in one trial only where its number is given."""
        ...


def best_effect(kind: Kind, space: ForceSpace) -> tuple[Effect, float] | None:
    """Fit a kind at a place; give the chi squared explained, or None where it does nothing."""
    if isinstance(kind.action, Law | Friction | Hidden):
        return _best_force(kind, space)
    if isinstance(kind.action, SensorChange | InputChange):
        return _best_change(kind, kind.action, space)
    return None


def _best_force(kind: Kind, space: ForceSpace) -> tuple[Effect, float] | None:
    motions = [latent.motion for latent in space.latents]
    shapes = _shapes(kind, space, motions)
    if not shapes:
        return None
    if kind.quadrature is not None:
        found = _best_quadrature(kind, space, motions, shapes)
        if "frequency_hz" not in kind.names:
            return found
        return _refine_frequency(kind, found, space, motions)
    best = _best_shape(kind, space, motions, shapes)
    if best is not None and isinstance(kind.action, Hidden) and kind.action.coordinates:
        return _refine_resonance(kind, best, space, motions)
    switches = kind.action.switches if isinstance(kind.action, Law) else ()
    if best is None or len(switches) != 1:
        return best
    finer = shapes
    for _ in range(REFINEMENTS):
        finer = _refined_shapes(switches[0], best[0], finer)
        best = max(best, _best_shape(kind, space, motions, finer) or best, key=gain_of)
        instants = sorted(shape[switches[0]] for shape in finer)
        if instants[1] - instants[0] < MIN_INSTANT_STEP_S:
            break
    return best


def unit_strength_shapes(kind: Kind, space: ForceSpace) -> list[dict[str, float]]:
    """Parameters of a kind in every shape that is tried, with unit strength."""
    unit = 1.0 if kind.strength is None else _strength_sign(kind)
    shapes = _shapes(kind, space, [latent.motion for latent in space.latents])
    return [dict(shape) | _with_strength(kind, shape, unit) for shape in shapes]


def scale_to_strength(kind: Kind, parameters: Shape, strength: float) -> dict[str, float]:
    """Multiply the strength of a kind, and the parameters that scale with it."""
    scaled = (kind.strength, *kind.scales)
    return {n: strength * value if n in scaled else value for n, value in parameters.items()}


def has_strength(kind: Kind) -> bool:
    """Whether a kind is a force with a strength and without a phase."""
    law = isinstance(kind.action, Law | Friction | Hidden)
    return law and bool(kind.strength) and not kind.quadrature


def effects_of_strength(
    kind: Kind,
    place: Place,
    motion: Motion,
    force: Float[np.ndarray, " time"],
    description: Description,
    shares: Sequence[float],
    most: int = MAX_START_SHAPES,
) -> Iterator[Effect]:
    """Give a law in some of its shapes, its force so many times as strong as another."""
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
            parameters = scale_to_strength(kind, unit, strength)
            if strength and is_possible(kind, parameters, description, place):
                yield Effect(kind.name, place, parameters)


def is_possible(kind: Kind, parameters: Shape, description: Description, place: Place) -> bool:
    """Whether parameters are within the bounds of a kind at a place."""
    least = lowest(description, place, kind)
    return not any(kind.parameter(n).refuses(v) or v <= least for n, v in parameters.items())


def effect_forces(kind: Kind, effect: Effect, space: ForceSpace) -> list[Column]:
    """Force of an effect along the motion recovered at its place (time, 1), by trial."""
    action = kind.action
    if not isinstance(action, SensorChange | InputChange):
        return [force_along(kind, effect.parameters, x.motion)[:, None] for x in space.latents]
    values, factor = kind.values(effect.parameters), _unit_factor(space)
    return [
        factor * (action.act(x.motion.e, x.motion.times, values) - x.motion.e)[:, None]
        for x in space.latents
    ]


def gain_of(found: tuple[Effect, float]) -> float:
    """Second of a pair: the chi squared that an effect explains."""
    return found[1]


def _shapes(kind: Kind, space: ForceSpace, motions: list[Motion]) -> list[Shape]:
    """Shapes to try: frequencies of one record at a time, all else of the campaign."""
    if not any(parameter.unit == "Hz" for parameter in kind.parameters):
        return kind.shapes(concatenate_motions(motions))
    longest = max(range(len(motions)), key=lambda i: len(motions[i].times))
    shapes = kind.shapes(motions[longest])
    if kind.quadrature is None or "frequency_hz" not in kind.names:
        return shapes
    return shapes + _modulated_shapes(kind, shapes, space)


def _modulated_shapes(kind: Kind, shapes: list[Shape], space: ForceSpace) -> list[Shape]:
    """Shapes whose frequencies are found by demodulation, independent of the motion."""
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
        _strongest_lines_hz(space.located) if same else (),
    )
    return [others | {"frequency_hz": hertz} for hertz in found]


def _strongest_lines_hz(located: Localization) -> list[float]:
    """Frequencies of the strongest lines over the noise, of each record [Hz]."""
    found: list[float] = []
    for one in located.lines:
        loud = np.sum(np.abs(one.residual) ** 2 / one.noise, axis=1)
        found += one.frequency_hz[np.argsort(-loud)[:LOUDEST_LINES]].tolist()
    return [hertz for hertz in found if hertz > 0]


def _refine_frequency(
    kind: Kind, found: tuple[Effect, float], space: ForceSpace, motions: list[Motion]
) -> tuple[Effect, float]:
    """Refine a frequency in steps of a fraction of one over the campaign."""
    span = max(float(m.times[-1]) for m in motions) - min(float(m.times[0]) for m in motions)
    step = COARSE_TURN / span
    for _ in range(FREQUENCY_REFINEMENTS):
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
        found = max(found, near, key=gain_of)
        step /= 4
    return found


def _refine_resonance(
    kind: Kind, found: tuple[Effect, float], space: ForceSpace, motions: list[Motion]
) -> tuple[Effect, float]:
    """Refine a resonance, which is narrower than the steps of the first scan."""
    assert kind.strength is not None
    wide = RESONANCE_STEP
    for _ in range(REFINEMENTS):
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
        found = max(found, _best_shape(kind, space, motions, near) or found, key=gain_of)
        wide /= 2
    return found


def _refined_shapes(name: str, found: Effect, shapes: list[Shape]) -> list[Shape]:
    """Values of one shape parameter between the neighbours of the best one."""
    values = sorted({shape[name] for shape in shapes})
    at = int(np.argmin(np.abs(np.array(values) - found.parameters[name])))
    low, high = values[max(at - 1, 0)], values[min(at + 1, len(values) - 1)]
    others = next(shape for shape in shapes if shape[name] == values[at])
    return [dict(others) | {name: float(v)} for v in np.linspace(low, high, 21)]


def _best_shape(
    kind: Kind, space: ForceSpace, motions: list[Motion], shapes: list[Shape]
) -> tuple[Effect, float] | None:
    best: tuple[Effect, float] | None = None
    unit = 1.0 if kind.strength is None else _strength_sign(kind)
    whole = [dict(shape) | _with_strength(kind, shape, unit) for shape in shapes]
    forces = space.lines_of(
        np.array([force_along(kind, p, motion) for p in whole]).T for motion in motions
    )
    strengths, gains = space.separate_fits(forces)
    for parameters, strength, gain in zip(whole, strengths, gains, strict=True):
        found = scale_to_strength(kind, parameters, float(strength))
        can = is_possible(kind, found, space.located.linear.description, space.place)
        if can and gain > 0 and (best is None or gain > best[1]):
            best = Effect(kind.name, space.place, found), float(gain)
    return best


def _best_quadrature(
    kind: Kind,
    space: ForceSpace,
    motions: list[Motion],
    shapes: list[Shape],
) -> tuple[Effect, float]:
    """Fit strength and phase by two quadratures; `shapes` must not be empty."""
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
    inner, seen = space.normal_equations(forces)
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
    kind: Kind, action: SensorChange | InputChange, space: ForceSpace
) -> tuple[Effect, float] | None:
    """Fit the parameter of a change of a sensor or an input, from where it does nothing."""
    fitted = [p for p in kind.parameters if p.fitted]
    if len(fitted) != 1:
        return None
    fixed = {p.name: _default_value(p.default, space) for p in kind.parameters if not p.fitted}
    name, factor = fitted[0].name, _unit_factor(space)
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
            float(np.abs(one).max(initial=0.0)) <= IDLE_SHARE * size
            for one, size in zip(acted(value), sizes, strict=True)
        )

    for idle in (0.0, 1.0):
        if fitted[0].refuses(idle) is None and idles(idle):
            step = DIFFERENCE_STEP if fitted[0].unit in ("", "s") else 1.0
            if not any(one.any() for one in acted(idle + step)):
                continue
            found = _best_parameter_value(space, acted, fitted[0], idle, step)
            if found is None:
                return None
            return Effect(kind.name, space.place, fixed | {name: found[0]}), found[1]
    return _scan_saturation(kind, space, acted, fixed, name)


def _best_parameter_value(
    space: ForceSpace, acted: ParameterAction, parameter: Parameter, idle: float, step: float
) -> tuple[float, float] | None:
    """Value that explains most, and its gain: in one step where its action is linear."""
    # Otherwise by a scan of the shortest record, each value changing the series by half of
    # itself more, and by Gauss-Newton steps from the best.
    moved = acted(idle + step)
    double = acted(idle + 2 * step)
    if all(
        np.allclose(2 * one, two, rtol=1e-6) for one, two in zip(moved, double, strict=True)
    ):
        strength, won = space.separate_fits(space.lines_of([one / step for one in moved]))
        value = idle + float(strength[0])
        fine = parameter.refuses(value) is None and won[0] > 0
        fine = fine and (idle == 0 or abs(value) > MIN_FACTOR)
        return (value, float(won[0])) if fine else None
    sizes = [float(np.linalg.norm(latent.motion.e)) for latent in space.latents]
    changes = [float(np.linalg.norm(one)) for one in moved]
    wide = SCAN_CHANGE * step * sum(sizes) / max(sum(changes), 1e-300)
    shortest = int(np.argmin([len(latent.motion.e) for latent in space.latents]))
    best = idle, 0.0
    for number in range(-SCAN_VALUES, SCAN_VALUES + 1):
        value = idle + number * wide
        if number == 0 or parameter.refuses(value) is not None:
            continue
        series = [
            one if i == shortest else np.zeros_like(one)
            for i, one in enumerate(acted(value, only=shortest))
        ]
        inner, seen = space.normal_equations(space.lines_of(series))
        gain = float(2 * seen[0] - inner[0, 0])
        best = (value, gain) if gain > best[1] else best
    value, gain = best[0], -math.inf
    for _ in range(GAUSS_NEWTON_STEPS):
        here, there = acted(value), acted(value + step)
        pair = [
            np.concatenate([a, (b - a) / step], axis=1)
            for a, b in zip(here, there, strict=True)
        ]
        inner, seen = space.normal_equations(space.lines_of(pair))
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


def _scan_saturation(
    kind: Kind,
    space: ForceSpace,
    acted: ParameterAction,
    fixed: dict[str, float],
    name: str,
) -> tuple[Effect, float] | None:
    """Scan the level of a sensor's saturation, which is linear only at an infinite one."""
    top = max(float(np.abs(latent.motion.e).max()) for latent in space.latents)
    best: tuple[Effect, float] | None = None
    for share in np.geomspace(0.25, 0.97, 14):
        forces = space.lines_of(acted(share * top))
        inner, seen = space.normal_equations(forces)
        gain = float(2 * seen[0] - inner[0, 0])
        if gain > 0 and (best is None or gain > best[1]):
            best = Effect(kind.name, space.place, fixed | {name: float(share * top)}), gain
    return best


def _default_value(default: float | None, space: ForceSpace) -> float:
    last = max(float(latent.motion.times[-1]) for latent in space.latents)
    return last if default is None or math.isnan(default) else default


def _unit_factor(space: ForceSpace) -> float:
    """Factor from the unit of an input to SI; 1 for sensors."""
    description = space.located.linear.description
    if space.place.kind != "input":
        return 1.0
    entry = next(i for i in description.inputs if i.channel == space.place.id)
    coordinate = description.unit_of_coordinate
    if entry.node is None:
        return unit_factor(entry.unit, "acceleration", coordinate)
    return unit_factor(entry.unit, "force", coordinate)


def _strength_sign(kind: Kind) -> float:
    assert kind.strength is not None
    parameter = kind.parameter(kind.strength)
    return -1.0 if parameter.high <= 0 else 1.0


def _with_strength(kind: Kind, shape: Shape, unit: float) -> dict[str, float]:
    return (
        {} if kind.strength is None else {kind.strength: unit * shape.get(kind.strength, 1.0)}
    )


def concatenate_motions(motions: list[Motion]) -> Motion:
    """Concatenate motions in the order of the campaign."""
    motions = sorted(motions, key=lambda motion: float(motion.times[0]))
    return Motion(
        e=np.concatenate([m.e for m in motions]),
        v=np.concatenate([m.v for m in motions]),
        a=np.concatenate([m.a for m in motions]),
        times=np.concatenate([m.times for m in motions]),
    )


def best_within_tolerances(kind: Kind, space: ForceSpace) -> tuple[Effect, float] | None:
    """Fit an effect that changed constants can reproduce, by the priors of these constants."""
    if not is_constant_change(kind):
        return None
    unit = dict.fromkeys(kind.names, 1.0)
    force = [force_along(kind, unit, latent.motion)[:, None] for latent in space.latents]
    # The constants have tolerances, the effect has none. With a shaken base, an added mass is
    # equivalent to less stiffness and damping.
    strength, gain = space.fit_within_tolerances(space.lines_of(force))
    found = {kind.names[0]: strength}
    can = is_possible(kind, found, space.located.linear.description, space.place)
    if gain <= 0 or not can:
        return None
    return Effect(kind.name, space.place, found), gain


def is_constant_change(kind: Kind) -> bool:
    """Whether a kind is a change of a linear constant of its place."""
    action = kind.action
    return isinstance(action, Hidden) and not action.coordinates and len(kind.names) == 1
