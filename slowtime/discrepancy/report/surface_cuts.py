"""Cuts through a measured force surface, and where the records measured it, for pictures."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import ForceCut, MeasuredForce
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.refinement.force_surface import surface_band
from slowtime.dynamics.effects import Friction, Kind, Law, Motion, force_along
from slowtime.dynamics.effects.library.measured_force import MEMORY_TERMS

from .gap_closure import ClosedGap
from .likeness import Likeness, describe_limits

BEYOND = 0.35
"""[share of half the measured range] That cuts go on to either side. Source: a decision; wide
enough to see how the band opens."""
POINTS = 161
"""[1] Of a cut, and one of them at zero. Source: a decision."""
CELLS = 24
"""[1] Of the grid of forces, each way. Source: a decision."""
MAX_SAMPLES = 3000
"""[samples] That show where the records come. Source: a decision; more are one stain."""

Series = Float[np.ndarray, " point"]


def measured_force(
    closed: ClosedGap, like: Sequence[Likeness], found: Hypothesis, kinds: Mapping[str, Kind]
) -> MeasuredForce:
    """Cut a force surface along the elongation and along the rate, with bands.

    The recovered motion of what was found says where the records come.
    """
    plant = closed.fit.plant
    own = plant.effects[-1].parameters
    low, high, most = own["low_m"], own["high_m"], own["high_m_per_s"]
    e, v = _visited(closed, found)
    grid_e, grid_v = np.linspace(low, high, CELLS + 1), np.linspace(-most, most, CELLS + 1)
    seen = np.histogram2d(v, e, bins=(grid_v, grid_e))[0] > 0
    middle_e, middle_v = (grid_e[1:] + grid_e[:-1]) / 2, (grid_v[1:] + grid_v[:-1]) / 2
    over_v, over_e = np.meshgrid(middle_v, middle_e, indexing="ij")
    force = _surface(closed, over_e.ravel(), over_v.ravel())[0].reshape(seen.shape)
    room = BEYOND * (high - low) / 2
    at_e = np.linspace(low - room, high + room, POINTS)
    at_v = np.linspace(-1, 1, POINTS) * (1 + BEYOND) * most
    held = 0.0 if low < 0 < high else own["centre_m"]
    stride = max(len(e) // MAX_SAMPLES, 1)
    best = like[0] if like else None
    unit = plant.description.unit_of_coordinate
    names = {name for _, group in MEMORY_TERMS for name, _ in group}
    return MeasuredForce(
        place=closed.place,
        over_e=_cut(closed, best, kinds, at_e, 0.0, along_rate=False),
        over_v=_cut(closed, best, kinds, at_v, held, along_rate=True),
        low=low, high=high, most=most,
        e=e[::stride], v=v[::stride],
        grid_e=middle_e, grid_v=middle_v, grid_force=np.where(seen, force, np.nan),
        shape=closed.shaped.shape.words,
        remembers=not names.isdisjoint(closed.shaped.terms.coefficients),
        law="" if best is None else kinds[best.kind].words,
        share=0.0 if best is None else best.share,
        limits="" if best is None else describe_limits(best, unit),
    )  # fmt: skip


def _visited(
    closed: ClosedGap, found: Hypothesis
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
    """Elongation and rate of the records at the surface."""
    located = found.localized
    assert located is not None
    motions = [located.latent(closed.place, i).motion for i in range(len(located.trials))]
    return np.concatenate([m.e for m in motions]), np.concatenate([m.v for m in motions])


def _cut(
    closed: ClosedGap,
    law: Likeness | None,
    kinds: Mapping[str, Kind],
    at: Series,
    held: float,
    *,
    along_rate: bool,
) -> ForceCut:
    fixed = np.full_like(at, held)
    e, v = (fixed, at) if along_rate else (at, fixed)
    force, sd = _surface(closed, e, v)
    own = closed.fit.plant.effects[-1].parameters
    inside = (e >= own["low_m"]) & (e <= own["high_m"]) & (np.abs(v) <= own["high_m_per_s"])
    told = None if law is None else _law(law, kinds, e, v)
    return ForceCut(
        at, held, force, sd, None if told is None else np.where(inside, told, np.nan)
    )


def _surface(closed: ClosedGap, e: Series, v: Series) -> tuple[Series, Series]:
    """Force and standard deviation [N] of each point by itself, without memory."""
    return surface_band(closed.fit, _points(e, v), instantaneous=True)


def _law(law: Likeness, kinds: Mapping[str, Kind], e: Series, v: Series) -> Series | None:
    """Force of a law [N], with the spring and damper beside it; None if it remembers."""
    kind = kinds[law.kind]
    if kind.states or not isinstance(kind.action, Law | Friction):
        return None
    constant, stiffness, damping = law.linear
    force = law.strength * force_along(kind, law.parameters, _points(e, v))
    return np.asarray(force + constant + stiffness * e + damping * v)


def _points(e: Series, v: Series) -> Motion:
    return Motion(e=e, v=v, a=np.zeros_like(e), times=np.arange(len(e), dtype=float))
