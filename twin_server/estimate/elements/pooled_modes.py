"""Mean of the modes of several readings, for one comparison with the reference."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin_server.estimate.covariates import Removed

from .compared_modes import ComparedMode, Nominal
from .memory import Baseline, ModePool, ReadingPool
from .mode_matching import aligned
from .observed_modes import ObservedMode


def added(
    pool: ReadingPool,
    modes: Sequence[ObservedMode],
    pairs: Mapping[int, int],
    nominal: Nominal,
    removed: Sequence[Removed],
    t_ns: int,
) -> ReadingPool:
    """Add the modes of one reading to a pool.

    Parameters
    ----------
    modes
        Of the reading.
    pairs
        Place of a baseline → place of its mode.
    removed
        Effect of covariates on each baseline; none without covariates.
    t_ns
        Sensor time of the reading [ns].
    """
    pools = list(pool.modes or (ModePool(),) * len(nominal.baselines))
    for i, j in pairs.items():
        effect = removed[i] if removed else None
        pools[i] = _with(pools[i], nominal.baselines[i], modes[j], effect)
    since = pool.since_ns if pool.readings else t_ns
    return dataclasses.replace(
        pool,
        modes=tuple(pools),
        readings=pool.readings + 1,
        since_ns=since,
        until_ns=max(pool.until_ns, t_ns),
    )


def _with(
    pool: ModePool, baseline: Baseline, mode: ObservedMode, effect: Removed | None
) -> ModePool:
    noise, common = baseline.scatter * mode.relative_sd, baseline.relative_sd
    frequency = mode.frequency_hz
    if effect is not None and baseline.condition is not None:
        # What a law leaves of one reading, it may leave of the next ones as well.
        normal = baseline.condition.normal
        noise = math.hypot(noise, normal.noise)
        common = math.hypot(normal.wander_sd, effect.law_sd)
        frequency *= effect.factor
    weight = noise**-2.0
    found = dataclasses.replace(
        pool,
        readings=pool.readings + 1,
        weight=pool.weight + weight,
        weighted=pool.weighted + weight * math.log(frequency / baseline.frequency_hz),
        common=max(pool.common, common),
    )
    if mode.shape is None or mode.shape_sd is None or baseline.shape is None:
        return found
    turned, factor = aligned(mode.shape, np.array(baseline.shape))
    precision = (factor * mode.shape_sd) ** -2.0
    known = np.isfinite(turned) & np.isfinite(precision)
    zeros = np.zeros(len(turned))
    before = np.array(pool.shape_weight or zeros), np.array(pool.shape_weighted or zeros)
    heard = np.where(known, precision, 0.0)
    return dataclasses.replace(
        found,
        shape_weight=tuple((before[0] + heard).tolist()),
        shape_weighted=tuple((before[1] + heard * np.nan_to_num(turned)).tolist()),
    )


def means(
    pool: ReadingPool, *, frequency_error: float, shape_error: float
) -> list[ComparedMode]:
    """Average the modes that at least half of the readings have shown.

    Parameters
    ----------
    frequency_error, shape_error
        Scatter of means besides their standard deviations, relative, and of components of a
        shape of norm 1 [1].

    Returns
    -------
    Modes of the present beside the baselines.
    """
    found = []
    for place, one in enumerate(pool.modes):
        if 2 * one.readings < pool.readings or not one.weight > 0.0:
            continue
        sd = math.sqrt(1.0 / one.weight + one.common**2 + frequency_error**2)
        shape = _mean_shape(one, shape_error)
        ratio = math.exp(one.weighted / one.weight)
        found.append(ComparedMode(place, ratio, sd, shape))
    return found


def _mean_shape(pool: ModePool, shape_error: float) -> ObservedMode:
    """Mean shape; only its components are those of a mode."""
    nothing: dict[str, Any] = dict.fromkeys(
        ("frequency_hz", "relative_sd", "damping_ratio", "damping_sd"), math.nan
    )
    weight = np.array(pool.shape_weight)
    heard = weight > 0.0
    if heard.sum() < 2:
        return ObservedMode(0, **nothing, identity=None, shape=None, shape_sd=None)
    safe = np.where(heard, weight, 1.0)
    shape = np.where(heard, np.array(pool.shape_weighted) / safe, np.nan)
    norm = float(np.sqrt(np.nansum(shape**2)))
    sd = np.where(heard, np.hypot(safe**-0.5, shape_error * norm), np.nan)
    return ObservedMode(0, **nothing, identity=None, shape=shape, shape_sd=sd)
