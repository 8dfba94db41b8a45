"""Proposal of a further measurement: a sensor, an added mass or a force."""

import dataclasses
from collections.abc import Iterator
from typing import Literal

import numpy as np

from .fit import StructurePosterior, total_misfit
from .identifiability import IdentifiabilityLimit, ratio_along
from .measured_modes import MeasuredModes
from .parametric_structure import ParametricStructure

Means = Literal["sensor", "added mass", "measured force"]

_ENOUGH = 0.5  # posterior over prior standard deviation at which a direction counts as told
_MASS = 0.1  # known added mass over the mass that is there
_SHAPE_SD = 0.02  # of a unit shape, where the present data have none to go by


@dataclasses.dataclass(frozen=True, slots=True)
class Remedy:
    """One measurement that would help.

    Parameters
    ----------
    means
        `sensor`, `added mass` or `measured force`.
    where
        Names of the degrees of freedom it would take.
    tells
        Which of the limits it would lift.
    ratio
        Largest posterior over prior standard deviation along those, with it.
    sentence
        For a person.
    """

    means: Means
    where: tuple[str, ...]
    tells: tuple[IdentifiabilityLimit, ...]
    ratio: float
    sentence: str


def propose_measurements(
    structure: ParametricStructure,
    measured: MeasuredModes,
    posterior: StructurePosterior,
    limits: tuple[IdentifiabilityLimit, ...],
) -> tuple[Remedy, ...]:
    """Propose, for each means, the place that lifts most of the limits; none if it lifts none.

    Parameters
    ----------
    structure, measured, posterior, limits
        As they were; the same modes are supposed to be measured as well as now.

    Returns
    -------
    The best place of each means.
    """
    slope = posterior.optima[0].whitened
    information = slope.T @ slope
    best: dict[Means, Remedy] = {}
    for means, where, extra in _candidates(structure, measured, posterior):
        rows = total_misfit(structure, (extra,), posterior.theta, posterior.prior_sd).slope
        more = information + (rows * posterior.prior_sd).T @ (rows * posterior.prior_sd)
        after = [ratio_along(more, limit.direction) for limit in limits]
        lifted = [k for k, ratio in enumerate(after) if ratio < _ENOUGH]
        if not lifted:
            continue
        remedy = _remedy(
            means, where, tuple(limits[k] for k in lifted), max(after[k] for k in lifted)
        )
        if means not in best or _better(remedy, best[means]):
            best[means] = remedy
    return tuple(best.values())


def _better(one: Remedy, other: Remedy) -> bool:
    return (len(one.tells), -one.ratio) > (len(other.tells), -other.ratio)


def _candidates(
    structure: ParametricStructure, measured: MeasuredModes, posterior: StructurePosterior
) -> Iterator[tuple[Means, tuple[str, ...], MeasuredModes]]:
    """Measurements that could be made, as the model at the posterior would give them."""
    sites = np.eye(structure.size)
    present = measured.seen_by(structure) if measured.shapes is not None else sites[:0]
    for d, name in enumerate(structure.dof_names):
        others = [present] if len(present) else [sites[e : e + 1] for e in range(d)]
        for other in others:
            names = (name,) if len(present) else (structure.dof_names[other.argmax()], name)
            if not (other == sites[d]).all(axis=1).any():
                seen = np.concatenate([other, sites[d : d + 1]])
                yield "sensor", names, _would_be(structure, measured, posterior, seen)
        yield (
            "measured force",
            (name,),
            _would_be(structure, measured, posterior, sites[d : d + 1], scaled=True),
        )
        extra = _MASS * structure.mass[d, d] * np.outer(sites[d], sites[d])
        yield (
            "added mass",
            (name,),
            _would_be(structure, measured, posterior, None, added_mass=extra),
        )


def _would_be(
    structure: ParametricStructure,
    measured: MeasuredModes,
    posterior: StructurePosterior,
    channels: np.ndarray | None,
    *,
    scaled: bool = False,
    added_mass: np.ndarray | None = None,
) -> MeasuredModes:
    """Show the modes measured now to other sensors or loaded, by the model."""
    now = total_misfit(structure, (measured,), posterior.theta, posterior.prior_sd)
    modes = structure.modes(posterior.theta, added_mass)
    frequency = modes.frequency_hz[now.pairs]
    # Frequencies count again only with a mass on; shapes alone are what sensors add.
    sd = measured.relative_sd if added_mass is not None else np.full(len(frequency), 1e9)
    shapes = shape_sd = None
    if channels is not None:
        shapes = (channels @ modes.shape[:, now.pairs]).T
        norm = np.linalg.norm(modes.shape[:, now.pairs], axis=0)
        shape_sd = np.broadcast_to(_shape_sd(measured) * norm[:, None], shapes.shape)
    return MeasuredModes(
        frequency_hz=frequency,
        frequency_sd_hz=sd * frequency,
        shapes=shapes,
        shape_sd=shape_sd,
        channels=channels,
        scaled=scaled,
        added_mass=added_mass,
    )


def _shape_sd(measured: MeasuredModes) -> float:
    """Typical standard deviation of a component of a shape of unit norm."""
    if measured.shapes is None or measured.shape_sd is None:
        return _SHAPE_SD
    norm = np.sqrt(np.nansum(measured.shapes**2, axis=1, keepdims=True))
    return float(np.nanmedian(measured.shape_sd / norm))


def _remedy(
    means: Means, where: tuple[str, ...], tells: tuple[IdentifiabilityLimit, ...], ratio: float
) -> Remedy:
    places = " and ".join(where)
    opening = {
        "sensor": f"{'Sensors' if len(where) > 1 else 'One more sensor'} at {places}",
        "added mass": f"Frequencies with a known mass of {_MASS:.0%} more at {places}",
        "measured force": f"A measured force, and a sensor, at {places}",
    }[means]
    what = "; ".join(dict.fromkeys(_subject(limit) for limit in tells))
    return Remedy(means, where, tells, ratio, f"{opening} would tell: {what}.")


def _subject(limit: IdentifiabilityLimit) -> str:
    if limit.kind == "scale":
        return "the common factor on stiffness and mass"
    if limit.kind == "alike":
        return f"{limit.names[0]} from {limit.names[1]}"
    if limit.kind == "mass against stiffness":
        return "mass from stiffness"
    return " and ".join(limit.names)
