r"""Parameters and combinations of parameters that the data do not determine.

A direction :math:`\varphi` of the parameters, in prior standard deviations, is not told when
its posterior is hardly narrower than its prior, whatever else were known:
:math:`|\tilde J \varphi|^2 < 1` for :math:`|\varphi| = 1`. Directions with a name come first
(one common factor on everything, one element alone, one element against another); what
then remains of the weak singular vectors of :math:`\tilde J` is told by its largest members.
"""

import dataclasses
import itertools
from typing import Literal

import numpy as np
from jaxtyping import Float

from .fit import StructurePosterior
from .updatable_models import UpdatableModel

Kind = Literal["scale", "unseen", "alike", "mass against stiffness", "combination"]

_TOLD = 1.0  # information, in inverse prior variances, from which a direction counts as told
_MAIN = 0.35  # share of the largest member from which a member is named


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class IdentifiabilityLimit:
    """One thing that the data cannot tell.

    Parameters
    ----------
    kind
        `scale` (one factor on all stiffness and mass), `unseen` (one parameter alone), `alike`
        (one parameter or the other), `mass against stiffness`, or another `combination`.
    names
        Of the parameters concerned.
    direction
        In prior standard deviations, of unit norm.
    ratio
        Posterior over prior standard deviation along it [1].
    sentence
        For a person.
    """

    kind: Kind
    names: tuple[str, ...]
    direction: Float[np.ndarray, " parameter"]
    ratio: float
    sentence: str


def identifiability_limits(
    structure: UpdatableModel, posterior: StructurePosterior
) -> tuple[IdentifiabilityLimit, ...]:
    """Say what the data that led to `posterior` leave open."""
    slope, sd = posterior.optima[0].whitened, posterior.prior_sd
    information = slope.T @ slope
    found = [*_scale(structure, information, sd), *_unseen(structure, information, sd)]
    hidden = {limit.names[0] for limit in found if limit.kind == "unseen"}
    found += _alike(structure, information, sd, hidden)
    return (*found, *_rest(structure, information, sd, found))


def ratio_along(
    information: Float[np.ndarray, "parameter parameter"],
    direction: Float[np.ndarray, " parameter"],
) -> float:
    """Posterior over prior standard deviation along a direction.

    Parameters
    ----------
    information
        Information of the data on the parameters, each in prior standard deviations [1].
    direction
        Direction of unit norm, in prior standard deviations [1].

    Returns
    -------
    Ratio [1]: 1 where the data say nothing.
    """
    covariance = np.linalg.inv(np.eye(len(direction)) + information)
    return float(np.sqrt(direction @ covariance @ direction))


def _told(information: np.ndarray, direction: np.ndarray) -> bool:
    return bool(direction @ information @ direction >= _TOLD)


def _scale(
    structure: UpdatableModel, information: np.ndarray, sd: np.ndarray
) -> list[IdentifiabilityLimit]:
    if not structure.node_names or not (sd > 0.0).all():
        return []
    common = (1.0 / sd) / np.linalg.norm(1.0 / sd)
    if _told(information, common):
        return []
    sentence = (
        "One common factor on all stiffness and all mass changes nothing that was measured, so "
        "stiffness and mass are known only relative to each other."
    )
    ratio = ratio_along(information, common)
    return [IdentifiabilityLimit("scale", structure.names, common, ratio, sentence)]


def _unseen(
    structure: UpdatableModel, information: np.ndarray, sd: np.ndarray
) -> list[IdentifiabilityLimit]:
    found = []
    for i, name in enumerate(structure.names):
        alone = np.eye(len(sd))[i]
        if sd[i] > 0.0 and not _told(information, alone):
            sentence = f"{name} hardly moves anything that was measured; it is not told at all."
            ratio = ratio_along(information, alone)
            found.append(IdentifiabilityLimit("unseen", (name,), alone, ratio, sentence))
    return found


def _alike(
    structure: UpdatableModel, information: np.ndarray, sd: np.ndarray, hidden: set[str]
) -> list[IdentifiabilityLimit]:
    """Pairs of one kind of parameter whose exchange cannot be seen."""
    found = []
    for group in (structure.element_names, structure.node_names):
        for one, other in itertools.combinations(group, 2):
            i, j = structure.names.index(one), structure.names.index(other)
            if {one, other} & hidden or sd[i] == 0.0 or sd[j] == 0.0:
                continue
            against = np.zeros(len(sd))
            against[i], against[j] = 1.0 / sd[i], -1.0 / sd[j]
            against /= np.linalg.norm(against)
            if not _told(information, against):
                sentence = f"{one} or {other}: what one loses looks like what the other loses."
                ratio = ratio_along(information, against)
                found.append(
                    IdentifiabilityLimit("alike", (one, other), against, ratio, sentence)
                )
    return found


def _rest(
    structure: UpdatableModel,
    information: np.ndarray,
    sd: np.ndarray,
    found: list[IdentifiabilityLimit],
) -> list[IdentifiabilityLimit]:
    """Weak directions that no sentence has covered yet."""
    values, vectors = np.linalg.eigh(information)
    free = np.sum(vectors[sd > 0.0] ** 2, axis=0) > 0.5
    weak = vectors[:, (values < _TOLD) & free]
    said = np.array([limit.direction for limit in found]).reshape(len(found), len(sd))
    basis = np.linalg.svd(said, full_matrices=False)
    covered = basis[2][basis[1] > 1e-6]
    left = weak - covered.T @ (covered @ weak)
    directions, size, _ = np.linalg.svd(left, full_matrices=False)
    return [
        _combination(structure, information, directions[:, k])
        for k in range(len(size))
        if size[k] > 0.5
    ]


def _combination(
    structure: UpdatableModel, information: np.ndarray, direction: np.ndarray
) -> IdentifiabilityLimit:
    main = np.abs(direction) > _MAIN * np.abs(direction).max()
    names = tuple(name for name, keep in zip(structure.names, main, strict=True) if keep)
    both = set(names) & set(structure.element_names) and set(names) & set(structure.node_names)
    kind: Kind = "mass against stiffness" if both else "combination"
    signs = np.sign(direction[main])
    up = [n for n, s in zip(names, signs, strict=True) if s == signs[0]]
    down = [n for n, s in zip(names, signs, strict=True) if s != signs[0]]
    against = f" while {' and '.join(down)} fall" if down else ""
    cause = "; mass is not told from stiffness there" if both else ""
    sentence = f"{' and '.join(up)} could rise{against}, and the data would not show it{cause}."
    return IdentifiabilityLimit(
        kind, names, direction, ratio_along(information, direction), sentence
    )
