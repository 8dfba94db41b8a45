"""Computes failure probability, survival and hazard from forecast and limit states."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.degradation import Mixture
from slowtime.dynamics.description import Description
from slowtime.evolution.life.probability_words import foretold, probability_in_words
from slowtime.evolution.life.remaining_life import RemainingLife
from slowtime.evolution.life.threshold_crossing import SampledFutures
from slowtime.limit_states import Assessment, LimitState, Threshold, assess, history
from slowtime_schemas.slow_times import time_in_words
from slowtime_services.models import description_of
from slowtime_services.plugins.discovery import PluginError, exception_text, find
from twin_server.registration.limit_states import (
    MASS,
    SPRING,
    OwnState,
    limit_state_of,
    one_mass,
)
from twin_server.registration.thresholds import shown, signed
from twin_server.registration.twin import Registration

from .checkpoint import Checkpoint
from .forecast.changes import Past
from .forecast.futures import PATHS, futures_of

EVERY = 2
"""Every second of the forecast's futures, and of their instants, is given to a limit state that
is run for each [1]: 1,000 tell a probability of 0.01 to 30 %."""

LEAST_PATHS = 1.0 / PATHS
"""Probability below which futures do not resolve a limit state without a load."""

MOST_PAST = 200
"""Past readings whose probability is told: the newest."""


@dataclasses.dataclass(frozen=True, slots=True)
class RiskOrder:
    """Input of the risk of one twin.

    Parameters
    ----------
    laws
        Of each quantity, its degradation laws after the last reading.
    common
        Of the error that all readings share, over 1 + change [1].
    past
        Readings of each quantity.
    since, horizon
        Slow time of the last reading, and the latest that is looked at.
    unit
        Of slow time.
    widening
        Factor of the spread of the futures of each quantity; 1 where none is given.
    """

    registration: Registration
    checkpoint: Checkpoint
    laws: Mapping[str, Mixture]
    common: Mapping[str, float]
    past: Mapping[str, Past]
    since: float
    horizon: float
    unit: str
    widening: Mapping[str, float] = dataclasses.field(default_factory=dict)


def risk_answer(twin_id: str, order: RiskOrder) -> dict[str, Any]:
    """Assess every limit state of a registration, as REST answers.

    A limit state that this twin cannot answer is told with its reason, and keeps none of the
    others from being assessed.
    """
    futures = {
        name: futures_of(laws, order.common[name], order.horizon, order.widening.get(name, 1.0))
        for name, laws in order.laws.items()
    }
    found = [_one(spec, order, futures) for spec in order.registration.limit_states]
    return {
        "id": twin_id,
        "since": order.since,
        "horizon": order.horizon,
        "slow_time_unit": order.unit,
        "limit_states": found,
        "valid": all(one["valid"] for one in found),
        "reasons": [reason for one in found for reason in one["reasons"]],
    }


def _one(spec: Any, order: RiskOrder, futures: Mapping[str, SampledFutures]) -> dict[str, Any]:
    empty = {"name": spec.name, "kind": spec.kind, "accepted": spec.accepted, "points": []}
    none: dict[str, Any] = dict.fromkeys(("now", "within", "until"))
    none |= {"past": [], "sentence": ""}
    try:
        state = _built(spec, order)
        later = next(iter(futures.values())).later[::EVERY]
        paths = {name: one.paths[::EVERY, ::EVERY] for name, one in futures.items()}
        found = assess(state, later, paths)
        told = _past_probabilities(state, order)
    except ValueError as error:
        return {**empty, **none, "valid": False, "reasons": [str(error)]}
    life = None
    if isinstance(state, Threshold):
        # When it is first passed, between the instants too.
        life = futures[state.quantity].crossing(state.at, toward=state.toward)
        found = _with_survival(found, life)
    until = found.when(spec.accepted)
    reasons = _against(spec.name, state, found)
    return {
        **empty,
        "now": _at(found, 0),
        "within": _quantity(found.failure[-1], 1 - found.survival_hi[-1],
                            1 - found.survival_lo[-1]),
        "until": until if math.isfinite(until) else None,
        "points": [
            {"slow_time": float(time), **_at(found, k)} for k, time in enumerate(later)
        ],
        "past": told,
        "sentence": _sentence(spec, found, until, order),
        "valid": not reasons,
        "reasons": reasons,
    }  # fmt: skip


def _built(spec: Any, order: RiskOrder) -> LimitState:
    if isinstance(spec, OwnState):
        return _installed_limit_state(spec)
    registration, known = order.registration, order.checkpoint.known
    if registration.changes == "elements":
        assert registration.model is not None
        description: Description | None = description_of(registration.model)
        parts = {name: _part(name) for name in order.laws}
        return limit_state_of(spec, description=description, parts=parts, frequency_hz=None)
    stands = {"stiffness_change": f"{SPRING}.stiffness", "mass_change": f"{MASS}.mass"}
    parts = {name: stands[name] for name in order.laws}
    if known is None:
        return limit_state_of(spec, description=None, parts=parts, frequency_hz=None)
    nominal = registration.nominal
    mass = None if nominal is None else nominal.mass_kg
    damping = known.damping_ratio
    if spec.kind == "response" and not damping > 0.0:
        raise ValueError(
            f"{spec.name}: no damping ratio of this twin is known. Give nominal.damping_ratio "
            "in its registration."
        )
    if spec.kind == "response" and mass is None and spec.load.on != "base":
        raise ValueError(
            f"{spec.name}: a force moves a mass that is not known. Give nominal.mass_kg, or a "
            "load on the base."
        )
    description = one_mass(known.frequency_hz, damping, mass) if damping > 0.0 else None
    return limit_state_of(
        spec, description=description, parts=parts, frequency_hz=known.frequency_hz
    )


def _installed_limit_state(spec: OwnState) -> LimitState:
    """Make the limit state that an installed part of the owner's holds."""
    part = find("slowtime.limit_states", spec.part)
    try:
        state = part.load()(**spec.settings)
    except PluginError:
        raise
    except Exception as error:  # a part of somebody's raises whatever it likes
        raise PluginError(f"{part} cannot be made: {exception_text(error)}.") from error
    if not isinstance(state, LimitState):
        raise PluginError(
            f"{part} made a {type(state).__name__}, which is no limit state. Give one with "
            "quantities, events and given."
        )
    return state


def _part(name: str) -> str:
    return name if name.endswith(".mass") else f"{name}.stiffness"


def _with_survival(found: Assessment, life: RemainingLife) -> Assessment:
    survival = np.nan_to_num(life.survival(found.slow_time), nan=0.0)
    survival = np.minimum.accumulate(survival)
    return dataclasses.replace(
        found, survival=survival, survival_lo=survival, survival_hi=survival
    )


def _past_probabilities(state: LimitState, order: RiskOrder) -> list[dict[str, Any]]:
    """Probability at past readings, each by its own standard deviation."""
    one = order.past[state.quantities[0]]
    rows = slice(-MOST_PAST, None)
    value = {name: order.past[name].value[rows] for name in state.quantities}
    sd = {name: order.past[name].sd[rows] for name in state.quantities}
    mean, lo, hi = history(state, value, sd)
    return [
        {"slow_time": t, "probability": _quantity(m, low, high)}
        for t, m, low, high in zip(
            one.slow_time[rows].tolist(), mean.tolist(), lo.tolist(), hi.tolist(), strict=True
        )
    ]


def _at(found: Assessment, k: int) -> dict[str, Any]:
    return {
        "probability": _quantity(found.probability[k], found.lo[k], found.hi[k]),
        "beta": float(found.beta[k]),
        "survival": _quantity(found.survival[k], found.survival_lo[k], found.survival_hi[k]),
        "hazard": float(found.hazard[k]),
    }


def _quantity(value: float, lo: float, hi: float) -> dict[str, float]:
    return {"value": float(value), "lo": float(lo), "hi": float(hi)}


def _against(name: str, state: LimitState, found: Assessment) -> list[str]:
    """Return the reasons against relying on a probability."""
    failed = float(found.failure[-1])
    if state.events is None and 0.0 <= failed < LEAST_PATHS and isinstance(state, Threshold):
        return [
            f"{name}: fewer than one of {PATHS} futures fails up to the horizon, so that the "
            f"probability is only known to be below {LEAST_PATHS:g}."
        ]
    return []


def _sentence(spec: Any, found: Assessment, until: float, order: RiskOrder) -> str:
    failed = float(found.failure[-1])
    what = spec.name
    if spec.kind == "threshold":
        words, unit, times = shown(spec.quantity)
        side, at = ("below", spec.below) if spec.below is not None else ("above", spec.above)
        what = f"{spec.name} ({words} {side} {signed(times * at)} {unit})"
    horizon = time_in_words(order.horizon, order.unit)
    said = (
        f"{what}: as of {time_in_words(order.since, order.unit)}, fails with probability "
        f"{probability_in_words(failed)} up to {horizon}; now "
        f"{probability_in_words(float(found.probability[0]))}"
    )
    if math.isfinite(until):
        reached = time_in_words(foretold(until, order.since), order.unit)
        return f"{said}. The accepted {spec.accepted:g} is reached at {reached}."
    return f"{said}. The accepted {spec.accepted:g} is not reached by then."
