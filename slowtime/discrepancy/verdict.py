"""Refitted models in; how probable each is, which word that makes, and sentences, out."""

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place

from .diagnosis import Named as Answer
from .diagnosis import Number, Rival, Verdict
from .naming import Named, settled, unseen
from .narrowing import leniency
from .refit import UNCLAIMED, Fit
from .screen import Finding

DECIDED = 0.9
"""Probability from which a name is given."""
GREATER = 0.95
"""Share of the probability that those have together which are called undecided."""
FALSE_ALARM = 1e-4
"""Chance at which a force found somewhere is taken for one."""
EXPLAINED = 1.5
"""Mean square over the noise, in band, up to which a model is taken to explain the records."""
LEAST_SHARE = 1e-6
"""Probability from which a rival is told."""
LEAST_GAIN = 6.0
"""Log evidence that an effect has to bring."""
MOVED = 3.0
"""Tolerances by which a constant must have moved to be told."""
OF_SENSOR = "unit of the sensor"
"""In place of a unit, in kinds that sit on a sensor."""
TEMPER = 0.5
"""Power to which evidence is taken: models are never quite as right as it supposes."""
FLECK = 2e-4
"""Share of what was missing at first, by which a later effect that explains no more is none: no
law is as true as that. True second effects in eighty hidden cases that no constant could stand
for explained 7e-4 at least."""
FLAW = 0.003
"""Share of what was missing that a right model may leave: friction that sticks leaves a little
wherever its fit ends, for its misfit has many minima."""


def hardly_any(last: Fit, first: Fit) -> bool:
    """Whether a fit leaves hardly any of what the first left beyond the noise."""
    return last.chi2_in_band - 1 < FLAW * (first.chi2_in_band - 1)


def probabilities(scores: Sequence[float], excess: float) -> list[float]:
    """From log evidence, tempered by what the best model leaves over the noise."""
    left = np.asarray(scores) * TEMPER / max(excess, 1.0)
    odds = np.exp(left - left.max())
    return [float(p) for p in odds / odds.sum()]


def shares_of(
    found: Sequence[Named],
    kinds: Mapping[str, Kind],
    besides: Sequence[float] = (),
    bare: Fit | None = None,
) -> list[float]:
    """Give the probability of each label, in their order.

    Parameters
    ----------
    besides
        Log evidence of other answers, no effect among them, that take their share.
    bare
        The fit without any of them.
    """
    scores = [n.score + leniency(n, kinds, bare) for n in found]
    return probabilities([*scores, *besides], found[0].fit.chi2_in_band)[: len(scores)]


def answer_of(
    found: Sequence[Named], shares: Sequence[float], kinds: Mapping[str, Kind]
) -> Answer:
    """Give the best label, with its numbers and rivals."""
    best = found[0]
    effect = settled(best)
    rivals = tuple(
        Rival(n.effect.kind, n.effect.place, p)
        for n, p in zip(found[1:], shares[1:], strict=True)
        if p > LEAST_SHARE
    )
    numbers = numbers_of(best.fit, len(best.description.effects) - 1)
    kind = kinds[effect.kind]
    return Answer(
        effect=effect,
        family=kind.family,
        numbers=numbers,
        probability=shares[0],
        rivals=rivals,
        sentence=sentence_of(kind, effect.place, numbers),
    )


def numbers_of(fit: Fit, which: int) -> dict[str, Number]:
    """Numbers of one effect, widened by what the model leaves over the noise."""
    sds = dict(zip(fit.prior.names, fit.widened_sd.tolist(), strict=True))
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    # Nothing is known of them but that they lie within the campaign.
    sds |= {name: abs(values[name]) for name in unseen(fit)}
    given, place = fit.plant.description, fit.plant.effects[which].place
    return {
        str(name[2]): Number(value, sds.get(name, 0.0), unit_at(given, place, entry.unit))
        for (name, entry), value in zip(
            fit.plant.entries.items(), fit.values.tolist(), strict=True
        )
        if len(name) == 3 and name[1] == which
    }


def unit_at(given: Description, place: Place, unit: str) -> str:
    """Give a unit, that of the sensor where an effect sits on one and takes its unit."""
    told = [s.unit for s in given.sensors if s.channel == place.id]
    return told[0] if unit == OF_SENSOR and told else unit


def moved_of(fit: Fit) -> dict[str, Number]:
    """Constants that left their tolerance."""
    sds = dict(zip(fit.prior.names, fit.sd.tolist(), strict=True))
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return {
        f"{name[0]} {name[1]}": Number(values[name], sds[name], fit.plant.entries[name].unit)
        for name, pull in fit.bent.items()
        if abs(pull) > MOVED
    }


def renumbered(fit: Fit, given: Description) -> dict[str, Number]:
    """Constants of the effects in a model as given that are off by more than its springs may.

    A model states no tolerance of them: they are held for as well known as the springs are.
    """
    claimed = given.tolerance.stiffness if given.tolerance else UNCLAIMED["stiffness"]
    found = {}
    for name, value, mean, sd in zip(
        fit.prior.names, fit.free, fit.prior.mean, fit.widened_sd, strict=True
    ):
        if name[0] != "effect" or int(name[1]) >= len(given.effects):
            continue
        if abs(value - mean) > MOVED * max(float(sd), claimed * abs(float(mean))):
            effect = fit.plant.effects[int(name[1])]
            found[f"{name[-1]} of {effect.kind} at {effect.place}"] = Number(
                float(value), float(sd), fit.plant.entries[name].unit
            )
    return found


def sentence_of(kind: Kind, place: Place, numbers: Mapping[str, Number]) -> str:
    """Name an effect for people, and say what it means.

    One number needs no name; of several, each is told by its meaning.
    """
    told = [(name, n) for name, n in numbers.items() if n.sd > 0]
    if len(told) == 1:
        size = told[0][1].text
    else:
        size = ", ".join(f"{kind.parameter(name).meaning} {n.text}" for name, n in told)
    where = "" if place.kind == "base" else f" at {place}"
    return f"{kind.words}{where}" + (f": {size}. " if size else ". ") + kind.sentence


def fault_of(finding: Finding, given: Description, kinds: Mapping[str, Kind]) -> Answer | None:
    """Read a finding of the screen as an effect of the sensor."""
    lost = finding.fault in ("stuck", "zero", "missing", "constant")
    name = "sensor_dropout" if lost else "sensor_saturation"
    if name not in kinds or not finding.spans_s:
        return None
    place = Place("sensor", finding.channel)
    first, last = finding.spans_s[0]
    parameters = (
        {"from_s": first, "for_s": last - first, "held": float(finding.fault == "stuck")}
        if lost
        else {p.name: finding.level for p in kinds[name].parameters[:1]}
    )
    ends = finding.instant_sd
    sds = (
        {"from_s": ends, "for_s": math.sqrt(2) * ends}
        if lost
        else dict.fromkeys(parameters, finding.level_sd)
    )
    units = {p.name: unit_at(given, place, p.unit) for p in kinds[name].parameters}
    return Answer(
        effect=Effect(name, place, parameters),
        family=kinds[name].family,
        numbers={
            key: Number(value, sds.get(key, 0.0), units[key])
            for key, value in parameters.items()
        },
        probability=0.99,
        rivals=(),
        sentence=finding.sentence,
    )


def verdict_of(answers: Sequence[Answer], kinds: Mapping[str, Kind]) -> Verdict:
    """One word for what was named: physics first."""
    where = {kinds[a.effect.kind].where for a in answers}
    if where & {"element", "node", "base"}:
        return "missing_effect"
    return "sensor_fault" if "sensor" in where else "input_fault"


def rivals_within(found: Sequence[Named], shares: Sequence[float]) -> tuple[Rival, ...]:
    """Give the labels that make up the greater part of the probability, the likeliest first."""
    return _greater([
        Rival(named.effect.kind, named.effect.place, share)
        for named, share in zip(found, shares, strict=True)
    ])  # fmt: skip


def doubts_about(answer: Answer) -> tuple[Rival, ...]:
    """Give what an answer may be, itself first; nothing where it is decided."""
    if answer.probability >= DECIDED:
        return ()
    own = Rival(answer.effect.kind, answer.effect.place, answer.probability)
    return _greater([own, *answer.rivals])


def _greater(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    total = sum(rival.probability for rival in rivals)
    known = itertools.accumulate((rival.probability for rival in rivals), initial=0.0)
    enough = GREATER * total
    return tuple(r for r, before in zip(rivals, known, strict=False) if before <= enough)
