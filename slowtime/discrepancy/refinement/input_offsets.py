"""Constant offsets of the inputs of floating structures, as effects.

A constant error of a force moves a structure that stands by a little, and one that floats away:
its free run is not to be had without. So each input of such a structure has an offset, fitted
with all else from the beginning as initial states are, and told of where it is seen.
"""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.candidates.library_fit import OFFSET
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.noise import has_rigid_motion
from slowtime.discrepancy.quoting import numbers_of, sentence_of
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind

REPORTED_SDS = 3.3
"""[standard deviations] From zero, from which an offset is reported. Source: a two-sided
p-value of 1 in 1000."""


def with_offsets(description: Description, kinds: Mapping[str, Kind]) -> Description:
    """Give every input of a structure that floats an offset, zero to begin with."""
    if OFFSET not in kinds or not has_rigid_motion(description):
        return description
    has = {str(e.get("input")) for e in description.effects if e["effect"] == OFFSET}
    more = tuple(
        {"effect": OFFSET, "input": entry.channel, "bias": 0.0}
        for entry in description.inputs
        if entry.channel not in has
    )
    return dataclasses.replace(description, effects=(*description.effects, *more))


def offsets(fit: Fit, given: Description, kinds: Mapping[str, Kind]) -> list[NamedEffect]:
    """Tell of the offsets that were added to what is given, where they are not about zero."""
    found = []
    for number, effect in enumerate(fitted_effects(fit)):
        if effect.kind != OFFSET or number < len(given.effects):
            continue
        numbers = numbers_of(fit, number)
        if abs(numbers["bias"].value) <= REPORTED_SDS * numbers["bias"].sd:
            continue
        kind = kinds[OFFSET]
        found.append(
            NamedEffect(
                effect=effect,
                family=kind.family,
                numbers=numbers,
                probability=0.99,
                rivals=(),
                sentence=sentence_of(kind, effect.place, numbers),
            )
        )
    return found
