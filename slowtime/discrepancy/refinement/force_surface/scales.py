"""Scales of a force surface, read off the motion that was recovered."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.localization.places import LatentForce
from slowtime.dynamics.effects.library.parameter_grids import lines_hz

MARGIN = 1.02
"""[1] Range of the surface, over the largest motion that was recovered. Source: a decision;
beyond it the surface is extrapolated."""
DENSE_SHARE = 0.25
"""[share of the standard deviation of the motion] Up to which knots are dense. Source: with it
knots lie near the quantiles of a normal motion, and still reach its peaks."""
DIRECTION_SHARES = (0.3, 0.1, 0.03)
"""[share of the root mean square speed] At which a direction has changed. Source: from rounded
friction to one whose reversal a sampled motion does not resolve."""
SIDE_SHARES = (0.2, 0.05)
"""[share of the standard deviation of the elongation] At which a side has changed. Source:
narrower than a knot interval, wider than the error of the motion."""
PATH_SHARES = (0.03, 0.15, 0.5)
"""[share of the largest elongation] Paths over which memory fades. Source: presliding of dry
joints to yielding of springs."""
LAG_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)
"""[periods of the strongest line] Times over which memory fades. Source: shorter ones are no
memory, longer ones a spring."""
LEVEL_PERIODS = (3.0, 10.0, 30.0, 100.0)
"""[periods of the strongest line] Times over which the level of the recent vibration fades.
Source: shorter ones follow the motion itself, longer ones than most records are ageing."""
PEAK_LAG = 0.1
"""[periods of the strongest line] In which the largest elongation so far is followed. Source:
short beside a period, and no shorter than the samples of most records."""
AGE_SHARES = (0.1, 0.2, 0.4, 0.8, 1.6)
"""[share of the time at which the last record ends] Times of ageing. Source: from one that ends
within the first records to one that is nearly a straight line."""


@dataclasses.dataclass(frozen=True, slots=True)
class ColumnGroup:
    """Columns of a surface that are chosen together, and the scales that they need.

    Of several blocks of one group one is chosen.
    """

    group: str
    names: tuple[str, ...]
    scales: Mapping[str, float]


def fixed_scales(latents: Sequence[LatentForce]) -> dict[str, float] | None:
    """Give the range of the surface and where its knots are dense; None where nothing moves."""
    e = np.concatenate([one.motion.e for one in latents])
    v = np.concatenate([one.motion.v for one in latents])
    force = np.concatenate([one.force for one in latents])
    if not all(np.isfinite(one).all() and np.ptp(one) > 0 for one in (e, v, force)):
        return None
    low, high, middle = float(e.min()), float(e.max()), float(np.median(e))
    room = (MARGIN - 1) * (high - low) / 2
    return {
        "centre_m": middle,
        "dense_m": DENSE_SHARE * float(np.std(e)),
        "low_m": low - room,
        "high_m": high + room,
        "dense_m_per_s": DENSE_SHARE * float(np.std(v)),
        "high_m_per_s": MARGIN * float(np.abs(v).max()),
        "vs_m_per_s": DIRECTION_SHARES[1] * float(np.std(v)),
        "eq_m": SIDE_SHARES[1] * float(np.std(e)),
        "spread_n": float(np.abs(force).max()),
        "path_m": PATH_SHARES[1] * max(abs(low), abs(high)),
        "lag_s": LAG_SHARES[2] / _pitch_hz(latents),
        "lag_of": 0.0,
        "level_s": LEVEL_PERIODS[1] / _pitch_hz(latents),
        "level_of": 0.0,
        "level_mean": float(np.mean(v**2)) / (MARGIN * float(np.abs(v).max())) ** 2,
    }


def blocks_of(
    latents: Sequence[LatentForce], groups: Mapping[str, tuple[str, ...]]
) -> list[ColumnGroup]:
    """List the blocks of columns, each group at each scale that is tried."""
    e = np.concatenate([one.motion.e for one in latents])
    v = np.concatenate([one.motion.v for one in latents])
    pitch = _pitch_hz(latents)
    end_s = max(float(one.motion.times[-1]) for one in latents)
    levels = [(periods / pitch, 0.0) for periods in LEVEL_PERIODS]
    levels += [(PEAK_LAG / pitch, 1.0)] + [(share * end_s, 2.0) for share in AGE_SHARES]
    scales: dict[str, list[dict[str, float]]] = {
        "friction": [{"vs_m_per_s": s * float(np.std(v))} for s in DIRECTION_SHARES],
        "side": [{"eq_m": s * float(np.std(e))} for s in SIDE_SHARES],
        "path": [{"path_m": s * float(np.abs(e).max())} for s in PATH_SHARES],
        "time": [
            {"lag_s": share / pitch, "lag_of": of} for share in LAG_SHARES for of in (0.0, 1.0)
        ],
        "level": [{"level_s": time, "level_of": of} for time, of in levels],
    }
    return [
        ColumnGroup(group, names, scale)
        for group, names in groups.items()
        for scale in scales.get(group, [{}])
    ]


def _pitch_hz(latents: Sequence[LatentForce]) -> float:
    """Give the strongest line of the longest record [Hz]; of a short one, its own inverse."""
    longest = max(latents, key=lambda one: len(one.force)).motion
    found = lines_hz(longest.v, longest.times, 1)
    return found[0] if found else 1 / float(longest.times[-1] - longest.times[0])
