"""Refutation of named laws by a free force beside them.

A law close to the right one leaves too little to be seen in the whole residual, but a free
force at the same place shows it. The law that acts there is then not in the library. A law of
several parameters may be another one at an end of its range, as van der Pol's without its
negative part; which of the two it is, is then undecided.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.optimize
import scipy.special
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit, attempt
from slowtime.discrepancy.calibration.measured_friction import needs_measured_friction
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Effect, Hidden, Kind, Law, Motion, Place, force_along

from .free_force import CURVE_KIND, LAG_KIND, FreeForce

REFUTED_P_VALUE = 1e-3
"""[probability] p-value of the score test below which named laws are refuted. Source:
docs/decisions/0018; none of 900 right ones was."""
RIGHT_SHARE = 0.03
"""[share of its force] Within which a law is right, as no structure follows a law exactly.
Source: docs/decisions/0018."""
EXCESS_P_VALUE = 0.05
"""[probability] p-value from which an excess over `RIGHT_SHARE` may be noise. Source:
docs/decisions/0026; one in twenty."""


@dataclasses.dataclass(frozen=True, slots=True)
class LawDoubt:
    """Evidence against the laws that were named at an element.

    Laws `idle` are those that the others make needless; without any, the laws are refuted.
    """

    place: Place
    idle: tuple[int, ...]


def refuted_by_free_force(
    fit: Fit,
    first: int,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> LawDoubt | None:
    """Find an element at which the named laws are refuted, or one of them is needless."""
    if needs_measured_friction(fit.plant, fit.noise):
        return None
    places = _named_elements(fit, first)
    for place in places:
        p_value = REFUTED_P_VALUE / len(places)
        found = attempt(_test_element, place, p_value, fit, first, trials, kinds)
        if found is not None:
            return found
    return None


def _named_elements(fit: Fit, first: int) -> tuple[Place, ...]:
    """Elements with named effects, and elements that end at nodes with such."""
    named = [effect.place for effect in fit.plant.effects[first:]]
    nodes = {place.id for place in named if place.kind == "node"}
    ending = [
        Place("element", element.id)
        for element in fit.plant.description.elements
        if isinstance(element, Spring) and nodes & set(element.between)
    ]
    return tuple(dict.fromkeys([*(p for p in named if p.kind == "element"), *ending]))


def _test_element(
    place: Place,
    chance: float,
    fit: Fit,
    first: int,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> LawDoubt | None:
    runs = list(fit.motions(trials))
    motions = [run[place] for run in runs]
    scales = {"e_m": _rms([m.e for m in motions]), "v_m_per_s": _rms([m.v for m in motions])}
    if min(scales.values()) == 0.0:
        return None
    free = LAG_KIND if _has_memory(fit, first, kinds) else CURVE_KIND
    flat = scales | dict.fromkeys(free.names[len(scales) :], 0.0)
    beside = FreeForce.of(fit, Effect(free.name, place, flat), trials, kinds)
    wide = math.sqrt(max(fit.chi2_in_band, 1.0))
    here = [n for n, one in enumerate(fit.plant.effects) if n >= first and one.place == place]
    taken = beside.score_test()
    chance_of = functools.partial(scipy.special.chdtrc, taken.degrees)
    idle = tuple(number for number in here if _is_idle(number, fit, beside, wide, kinds))
    several = any(sum(name[:2] == ("effect", n) for name in beside.names) > 1 for n in idle)
    doubt = LawDoubt(place, idle) if several else None
    # Without any direction that is determined, no other force can be tested.
    if not taken.degrees or chance_of(taken.gain / wide**2) > chance:
        return doubt
    laws = [
        _effect_force_along(number, fit, runs, kinds)
        for number in here or _effects_at_ends(place, fit, first)
    ]
    e, v = np.concatenate([m.e for m in motions]), np.concatenate([m.v for m in motions])
    known = np.stack(
        [x / _rms([x]) for x in (e, v, *(laws if here else ())) if x.any()], axis=1
    )
    forces = np.stack(
        [_curve_force_along(free, scales, column, motions) for column in taken.spread.T], 1
    )
    own = forces - known @ np.linalg.lstsq(known, forces, rcond=None)[0]
    off = _distance_to_small_force(
        own.T @ own / len(own), taken.steps, RIGHT_SHARE * _rms([np.sum(laws, axis=0)])
    )
    return doubt if chance_of(off / wide**2) > EXCESS_P_VALUE else LawDoubt(place, ())


def _distance_to_small_force(
    power: Float[np.ndarray, "direction direction"],
    steps: Float[np.ndarray, " direction"],
    most: float,
) -> float:
    """Squared distance [sd²] to the nearest force of a root mean square up to `most` [N]."""
    # A quadratic with one quadratic constraint, solved by its Lagrange multiplier. `power`
    # holds mean products of the forces of one standard deviation along each direction [N²].
    squares, turned = np.linalg.eigh(power)
    squares, along = np.maximum(squares, 0.0), turned.T @ steps

    def beyond(log: float) -> float:
        return float(np.sum(squares * (along / (1 + math.exp(log) * squares)) ** 2)) - most**2

    scale = -math.log(max(float(squares.max()), np.finfo(float).tiny))
    low, high = scale - 30.0, scale + 80.0
    if beyond(low) <= 0:
        return 0.0
    weight = math.exp(scipy.optimize.brentq(beyond, low, high) if beyond(high) < 0 else high)
    return float(np.sum((along * weight * squares / (1 + weight * squares)) ** 2))


def _curve_force_along(
    free: Kind,
    scales: Mapping[str, float],
    strengths: Float[np.ndarray, " curve"],
    motions: Sequence[Motion],
) -> Float[np.ndarray, " time"]:
    """Force [N] of curves with given strengths along the motion of the fit."""
    names = free.names[len(scales) :]
    numbers = {**scales, **dict(zip(names, strengths.tolist(), strict=True))}
    return np.concatenate([force_along(free, numbers, motion) for motion in motions])


def _has_memory(fit: Fit, first: int, kinds: Mapping[str, Kind]) -> bool:
    """Whether a named law, linear or with states, may stand for a force with memory."""
    actions = [kinds[effect.kind].action for effect in fit.plant.effects[first:]]
    return any(isinstance(a, Hidden) or (isinstance(a, Law) and a.rates) for a in actions)


def _effects_at_ends(place: Place, fit: Fit, first: int) -> list[int]:
    """Numbers of the named effects at the end nodes of an element."""
    ends = next(e.between for e in fit.plant.description.elements if e.id == place.id)
    return [
        number
        for number, effect in enumerate(fit.plant.effects)
        if number >= first and effect.place.kind == "node" and effect.place.id in ends
    ]


def _effect_force_along(
    number: int, fit: Fit, runs: Sequence[Mapping[Place, Motion]], kinds: Mapping[str, Kind]
) -> Float[np.ndarray, " time"]:
    """Force [N] of one effect along the motion of the fit."""
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    effect = fit.plant.effects[number]
    kind = kinds[effect.kind]
    own = {name: values["effect", number, name] for name in kind.names}
    return np.concatenate([force_along(kind, own, run[effect.place]) for run in runs])


def _is_idle(
    number: int, fit: Fit, beside: FreeForce, wide: float, kinds: Mapping[str, Kind]
) -> bool:
    """Whether the strength of a law is not significant after one more step of the fit."""
    name = ("effect", number, kinds[fit.plant.effects[number].kind].strength)
    if name not in beside.names:
        return False
    value, sd = beside.step_without(name)
    return abs(value) < LIMITS.seen_sds * wide * sd


def _rms(series: Sequence[Float[np.ndarray, " _"]]) -> float:
    return math.sqrt(float(np.mean(np.concatenate(series) ** 2)))
