"""Parameters of fitted effects in numbers, units and sentences for people."""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.calibration import DEFAULT_RELATIVE_SD, Fit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.diagnosis import NamedEffect, Number, Rival
from slowtime.discrepancy.estimation.model_evidence import undetermined_parameters
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place
from slowtime.dynamics.units import unit_of_parameter

OF_SENSOR = "unit of the sensor"
"""In place of a unit, in kinds that sit on a sensor."""


def numbers_of(fit: Fit, which: int) -> dict[str, Number]:
    """Numbers of one effect, widened by what the model leaves over the noise."""
    sds = dict(zip(fit.prior.names, fit.inflated_sd.tolist(), strict=True))
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    # Nothing is known of them but that they lie within the campaign.
    sds |= {name: abs(values[name]) for name in undetermined_parameters(fit)}
    given, place = fit.plant.description, fit.plant.effects[which].place
    return {
        str(name[2]): Number(value, sds.get(name, 0.0), unit_at(given, place, entry.unit))
        for (name, entry), value in zip(
            fit.plant.entries.items(), fit.values.tolist(), strict=True
        )
        if len(name) == 3 and name[1] == which
    }


def numbers_of_effect(
    effect: Effect, sds: Mapping[str, float], kind: Kind, given: Description
) -> dict[str, Number]:
    """Numbers of an effect that is in no fitted model, by the name of its parameters."""
    return {
        name: Number(
            value, sds.get(name, 0.0), unit_at(given, effect.place, kind.parameter(name).unit)
        )
        for name, value in effect.parameters.items()
    }


def unit_at(given: Description, place: Place, unit: str) -> str:
    """Give a unit, that of the sensor where an effect sits on one and takes its unit."""
    if unit != OF_SENSOR:
        return unit_of_parameter(unit, given.unit_of_coordinate)
    return next((s.unit for s in given.sensors if s.channel == place.id), unit)


def moved_of(fit: Fit) -> dict[str, Number]:
    """Constants that left their tolerance."""
    sds = dict(zip(fit.prior.names, fit.sd.tolist(), strict=True))
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return {
        f"{name[0]} {name[1]}": Number(values[name], sds[name], fit.plant.entries[name].unit)
        for name, pull in fit.constant_pulls.items()
        if abs(pull) > LIMITS.moved_tolerances
    }


def renumbered(fit: Fit, given: Description) -> dict[str, Number]:
    """Constants of effects in the model as given that are off by more than springs may be."""
    # A model states no tolerance of its effects: they are held for as well known as the springs
    # are.
    claimed = given.tolerance.stiffness if given.tolerance else DEFAULT_RELATIVE_SD["stiffness"]
    found = {}
    for name, value, mean, sd in zip(
        fit.prior.names, fit.free, fit.prior.mean, fit.inflated_sd, strict=True
    ):
        if name[0] != "effect" or int(name[1]) >= len(given.effects):
            continue
        if abs(value - mean) > LIMITS.moved_tolerances * max(
            float(sd), claimed * abs(float(mean))
        ):
            effect = fit.plant.effects[int(name[1])]
            found[f"{name[-1]} of {effect.kind} at {effect.place}"] = Number(
                float(value), float(sd), fit.plant.entries[name].unit
            )
    return found


def sentence_of(kind: Kind, place: Place, numbers: Mapping[str, Number]) -> str:
    """Name an effect for people, and say what it means."""
    # One number needs no name; of several, each is told by its meaning.
    told = [(name, n) for name, n in numbers.items() if n.sd > 0]
    if len(told) == 1:
        size = told[0][1].text
    else:
        size = ", ".join(f"{kind.parameter(name).meaning} {n.text}" for name, n in told)
    where = "" if place.kind == "base" else f" at {place}"
    return f"{kind.words}{where}" + (f": {size}. " if size else ". ") + kind.sentence


def quoted(
    effect: Effect,
    numbers: Mapping[str, Number],
    kind: Kind,
    probability: float,
    rivals: Sequence[Rival] = (),
) -> NamedEffect:
    """Name an effect with its numbers, in a sentence."""
    return NamedEffect(
        effect=effect,
        family=kind.family,
        numbers=numbers,
        probability=probability,
        rivals=tuple(rivals),
        sentence=sentence_of(kind, effect.place, numbers),
    )


def requote_all(
    answers: Sequence[NamedEffect], fit: Fit, kinds: Mapping[str, Kind]
) -> list[NamedEffect]:
    """Give answers about the last effects of a fit the numbers that those have in it."""
    own = len(fit.plant.effects) - len(answers)
    return [requoted(answer, fit, own + i, kinds) for i, answer in enumerate(answers)]


def requoted_by_place(
    answers: Sequence[NamedEffect], fit: Fit, kinds: Mapping[str, Kind]
) -> list[NamedEffect]:
    """Give answers the numbers that the effect of their kind at their place has in a fit.

    An answer that is none of its effects, such as a fault of a sensor, stays as it is; so does
    an offset by record, whose numbers are initial states.
    """
    at = {(e.kind, e.place): number for number, e in enumerate(fit.plant.effects)}
    return [
        requoted(answer, fit, at[answer.effect.kind, answer.effect.place], kinds)
        if (answer.effect.kind, answer.effect.place) in at
        and not kinds[answer.effect.kind].is_by_record
        else answer
        for answer in answers
    ]


def requoted(
    answer: NamedEffect, fit: Fit, number: int, kinds: Mapping[str, Kind]
) -> NamedEffect:
    """Give an answer the numbers that its effect has in the last fit."""
    effect = fitted_effects(fit)[number]
    numbers = numbers_of(fit, number)
    return dataclasses.replace(
        answer,
        effect=effect,
        numbers=numbers,
        sentence=sentence_of(kinds[effect.kind], effect.place, numbers),
    )


def percent(share: float) -> str:
    """Write a share [1] in per cent, with two digits below ten.

    Examples
    --------
    >>> percent(0.123), percent(0.0123)
    ('12 %', '1.2 %')
    """
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"
