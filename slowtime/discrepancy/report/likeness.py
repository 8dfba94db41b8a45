"""Comparison of a measured force surface with laws that have a name, and over which range."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.dynamics.effects import Friction, Hidden, Kind, Law, Place, force_along

MIN_LIKENESS = 0.5
"""[share of the force] That a law has to explain to be said to be like the surface, beside a
spring and a damper. Source: a decision: below half, most of the force is another's."""
MAX_LIKE = 2
"""[laws] That are named. Source: a decision."""
BINS = 8
"""[1] Ranges of elongation, or of speed, of as many samples each, in which a law is compared
with the surface. Source: as many as a sentence can tell apart."""
UNLIKE_SHARE = 0.5
"""[share of the mean square of the force in a range] That a law leaves where it is not like
the surface. Source: that of `MIN_LIKENESS`."""
MAX_SAMPLES = 20_000
"""[samples] Of all records that are compared. Source: a decision: a share is then known to one
percent."""

OWN_CLOCK = ("time-varying", "parametric", "tonal input")
"""Families of laws that follow a clock of their own, which a surface over motion has not."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Likeness:
    """A law beside a surface along the motion of the records.

    Parameters
    ----------
    share
        Share of the force of the surface that it explains, beside a spring and a damper.
    unlike_above
        Elongation and speed above which it is not like the surface; infinite where it is.
    linear
        Constant [N], stiffness [N/m] and damping [N s/m] beside it.
    """

    kind: str
    share: float
    unlike_above: tuple[float, float]
    parameters: Mapping[str, float]
    strength: float
    linear: tuple[float, float, float]


def describe_likeness(like: Sequence[Likeness], kinds: Mapping[str, Kind], unit: str) -> str:
    """Say which laws a surface is most like, and where it is not like them."""
    if not like:
        return " It does not resemble any law of the catalogue."
    told = []
    for one in like[:MAX_LIKE]:
        text = f"{kinds[one.kind].words} ({100 * one.share:.0f} % of its force"
        limits = describe_limits(one, unit)
        text += f"; not above {limits})" if limits else ")"
        told.append(text)
    return (
        " Of the laws in slowtime's catalogue, it most resembles "
        f"{' and '.join(told)} along the motion of these records."
    )


def describe_limits(one: Likeness, unit: str) -> str:
    """Say above which elongation and rate a law is not like the surface; empty for none."""
    return " and ".join(
        f"{limit:.2g} {name}"
        for limit, name in zip(one.unlike_above, (unit, f"{unit}/s"), strict=True)
        if np.isfinite(limit)
    )


def likenesses(
    fit: Fit, place: Place, found: Hypothesis, kinds: Mapping[str, Kind]
) -> list[Likeness]:
    """Rank the candidates at a place by the share of the surface's force that they explain."""
    if found.localized is None:
        return []
    located = found.localized
    motions = [located.latent(place, i).motion for i in range(len(located.trials))]
    surface = fit.plant.effects[-1]
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    number = len(fit.plant.effects) - 1
    own = {n: values["effect", number, n] for n in fit.plant.kinds[surface.kind].names}
    stride = max(sum(len(m.e) for m in motions) // MAX_SAMPLES, 1)

    def along(kind: Kind, parameters: Mapping[str, float]) -> Float[np.ndarray, " time"]:
        return np.concatenate([force_along(kind, parameters, m) for m in motions])[::stride]

    e = np.concatenate([m.e for m in motions])[::stride]
    v = np.concatenate([m.v for m in motions])[::stride]
    linear = np.stack([np.ones_like(e), e, v], axis=1)
    whole = along(fit.plant.kinds[surface.kind], own)
    force = _without(linear, whole)
    best: dict[str, Likeness] = {}
    for kind, parameters in _laws(place, found, kinds):
        plain = along(kind, parameters)
        law = _without(linear, plain)
        power = float(law @ law)
        if not (np.isfinite(power) and power > 0 and float(force @ force) > 0):
            continue
        strength = max(float(law @ force) / power, 0.0)
        left = force - law * strength
        share = 1 - float(left @ left) / float(force @ force)
        if share >= MIN_LIKENESS and share > getattr(best.get(kind.name), "share", 0.0):
            limits = tuple(_unlike_above(np.abs(u), force, left) for u in (e, v))
            beside = np.linalg.lstsq(linear, whole - strength * plain, rcond=None)[0].tolist()
            best[kind.name] = Likeness(
                kind.name, share, (limits[0], limits[1]), parameters, strength,
                (beside[0], beside[1], beside[2]),
            )  # fmt: skip
    return sorted(best.values(), key=lambda one: -one.share)


def _laws(
    place: Place, found: Hypothesis, kinds: Mapping[str, Kind]
) -> Iterator[tuple[Kind, Mapping[str, float]]]:
    """Laws at a place that hang on its motion alone."""
    every = [
        *(one.effect for one in found.tried),
        *(one.effect for one in found.fitted),
        *(one.effect for one in found.nested),
    ]
    for effect in every:
        kind = kinds[effect.kind]
        is_force = isinstance(kind.action, Law | Friction | Hidden)
        if effect.place == place and is_force and kind.family not in OWN_CLOCK:
            yield kind, effect.parameters


def _without(
    linear: Float[np.ndarray, "time column"], force: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """Force without what a constant, a spring and a damper explain of it."""
    if not np.isfinite(force).all():
        return np.zeros_like(force)
    return np.asarray(force - linear @ np.linalg.lstsq(linear, force, rcond=None)[0])


def _unlike_above(
    size: Float[np.ndarray, " time"],
    force: Float[np.ndarray, " time"],
    left: Float[np.ndarray, " time"],
) -> float:
    """Give the size above which a law leaves most of the force; infinite where it does not."""
    edges = np.quantile(size, np.linspace(0, 1, BINS + 1))
    limit = np.inf
    for low, high in zip(edges[-2::-1], edges[:0:-1], strict=True):
        inside: Bool[np.ndarray, " time"] = (size >= low) & (size <= high)
        if np.sum(left[inside] ** 2) <= UNLIKE_SHARE * np.sum(force[inside] ** 2):
            break
        limit = float(low)
    return limit if limit > edges[0] else np.inf
