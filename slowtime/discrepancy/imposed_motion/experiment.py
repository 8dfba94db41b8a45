"""Proposal of an imposed motion that distinguishes laws which the records cannot."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import Experiment
from slowtime.dynamics.effects import Motion

from .records import ForceRecord
from .regression import ForceFit, ForceRegression, Series

FACTORS = (2.0, 0.5, 3.0, 1 / 3)
"""[1] On the amplitude or the speed of what was imposed, the mildest first. Source: a decision:
rigs rarely allow more than three times."""
WORTH_TRYING = 1.3
"""[1] Ratio of separations from which a motion of more effort is proposed. Source: a
decision."""
SAMPLES = 2000
"""[samples] Of each imposed motion. Source: several cycles are enough."""
CYCLES = 4
"""[cycles] Of a triangular motion. Source: the first forgets what was before."""


def deciding_experiment(
    regression: ForceRegression, fits: Sequence[ForceFit], rest: float, count: float
) -> Experiment | None:
    """Propose the imposed motion along which rival laws differ most.

    It has the greatest gain of log evidence between the two rivals that it separates least;
    None without two rivals. `rest` is what the best leaves, over the scatter of the force.
    """
    if len(fits) < 2:
        return None
    record = max(regression.records, key=lambda one: float(np.ptp(one.motion.e)))
    level = max(rest * float(np.std(regression.force)), np.finfo(float).tiny)
    best: Experiment | None = None
    for option, motion in _options(record):
        forces = [_beyond_line(regression.laws(one, motion), motion) for one in fits]
        least = min(float(np.mean((a - b) ** 2)) for a, b in itertools.combinations(forces, 2))
        gain = count / 2 * math.log1p(least / level**2) if math.isfinite(least) else 0.0
        if best is None or gain > WORTH_TRYING * best.separation:
            best = dataclasses.replace(option, separation=gain)
    return best


def _options(record: ForceRecord) -> Iterator[tuple[Experiment, Motion]]:
    seen = record.motion
    motion = Motion(*(one[:SAMPLES] for one in (seen.e, seen.v, seen.a, seen.times)))
    for factor in FACTORS:
        yield (
            Experiment(
                f"Repeat the motion with {factor:.2g} times the amplitude at the same speed.",
                level=factor,
            ),
            _scaled(motion, factor, factor),
        )
        yield (
            Experiment(
                f"Repeat the motion at {factor:.2g} times the speed with the same stroke."
            ),
            _scaled(motion, 1.0, 1 / factor),
        )
    for factor in (1.0, 0.3):
        yield (
            Experiment(
                "Impose a triangular motion (constant speed) of "
                f"{factor:.2g} times the stroke, so that build-up after each reversal and "
                "sliding at one speed can be distinguished.",
                level=factor,
            ),
            _triangle(motion, factor),
        )


def _scaled(motion: Motion, size: float, duration: float) -> Motion:
    return Motion(
        e=size * motion.e,
        v=size / duration * motion.v,
        a=size / duration**2 * motion.a,
        times=motion.times[0] + duration * (motion.times - motion.times[0]),
    )


def _triangle(motion: Motion, factor: float) -> Motion:
    reach = factor * 0.5 * float(np.ptp(motion.e))
    speed = max(float(np.sqrt(np.mean(motion.v**2))), np.finfo(float).tiny)
    phase = np.linspace(0.0, CYCLES, SAMPLES)
    times = 4 * reach / speed * phase
    way = np.abs((phase + 0.25) % 1.0 - 0.5)
    v = np.where((phase + 0.25) % 1.0 < 0.5, speed, -speed)
    return Motion(e=reach * (1 - 4 * way), v=v, a=np.zeros(SAMPLES), times=times)


def _beyond_line(force: Series, motion: Motion) -> Float[np.ndarray, " later"]:
    """Take off what a spring, a damper and a constant can follow; the first half settles."""
    later = slice(len(force) // 2, None)
    line = np.stack([motion.e, motion.v, np.ones(len(force))], axis=1)[later]
    weights, *_ = np.linalg.lstsq(line, force[later], rcond=None)
    return np.asarray(force[later] - line @ weights)
