"""Catalogue of all built-in kinds of effect, by name."""

import functools
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from .kind import Kind
from .library import (
    damping,
    friction,
    harmonic_forces,
    hysteresis,
    input_offset,
    inputs,
    linear,
    measured_force,
    record_offsets,
    sensors,
    stiffness,
    varying_mass,
    varying_stiffness,
    viscoelasticity,
)

FAMILIES = (
    stiffness,
    friction,
    damping,
    hysteresis,
    linear,
    measured_force,
    viscoelasticity,
    varying_stiffness,
    varying_mass,
    harmonic_forces,
    inputs,
    input_offset,
    sensors,
    record_offsets,
)


def catalogue(own: Iterable[Kind] = ()) -> Mapping[str, Kind]:
    """Kinds by name, those of a user's `own` among them.

    Parameters
    ----------
    own
        Kinds of the user.

    Returns
    -------
    Kinds by name.

    Raises
    ------
    ValueError
        Where one of the user's own bears a name that is taken.

    Examples
    --------
    >>> catalogue()["coulomb"].equation
    'Fc sign(v), at v = 0 whatever up to Fc it takes to stick'
    """
    own = tuple(own)
    if not own:
        return _built_in()
    known = dict(_built_in())
    for kind in own:
        if kind.name in known:
            raise ValueError(f"A kind is called {kind.name!r} already. Rename your own.")
        known[kind.name] = kind
    return MappingProxyType(known)


def simple_kinds(kinds: Mapping[str, Kind]) -> list[Kind]:
    """List kinds that stand in the place of no simpler ones, which are tried first."""
    return [
        kind
        for kind in kinds.values()
        if not (kind.simpler or kind.is_surface or kind.is_by_record)
    ]


def general_kinds(kinds: Mapping[str, Kind]) -> list[Kind]:
    """List kinds that are tried where the simpler ones that they stand for do not suffice."""
    return [kind for kind in kinds.values() if kind.simpler]


@functools.cache
def _built_in() -> Mapping[str, Kind]:
    kinds = (kind for family in FAMILIES for kind in family.KINDS)
    return MappingProxyType({kind.name: kind for kind in kinds})
