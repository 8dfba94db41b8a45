"""Refitted models in; how probable each is, which word that makes, and sentences, out."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.effects import Effect, Kind, Place, Unmeasured

from .candidates import Candidate
from .diagnosis import Named as Answer
from .diagnosis import Number, Rival, Verdict
from .locate import Located
from .naming import Named, settled
from .refit import Fit
from .screen import Finding

DECIDED = 0.9
"""Probability from which a name is given."""
FALSE_ALARM = 1e-4
"""Chance at which a force found somewhere is taken for one."""
LEAST_GAIN = 6.0
"""Log evidence that an effect has to bring."""
MOVED = 3.5
"""Tolerances by which a constant must have moved to be told."""
SIZE_SD = 0.05
"""Relative standard deviation of the size of a random motion, as recovered in band."""
BY_LAWS = 0.6
"""Share of a gain that some law may explain of what nobody within the structure makes."""
TEMPER = 0.5
"""Power to which evidence is taken: models are never quite as right as it supposes."""


def probabilities(scores: Sequence[float], excess: float) -> list[float]:
    """From log evidence, tempered by what the best model leaves over the noise."""
    left = np.asarray(scores) * TEMPER / max(excess, 1.0)
    odds = np.exp(left - left.max())
    return [float(p) for p in odds / odds.sum()]


def answer_of(found: Sequence[Named], kinds: Mapping[str, Kind]) -> Answer:
    """Give the best label, with its numbers and rivals."""
    best = found[0]
    effect = settled(best)
    shares = probabilities([n.score for n in found], best.fit.chi2_in_band)
    rivals = tuple(
        Rival(n.effect.kind, n.effect.place, p)
        for n, p in zip(found[1:], shares[1:], strict=True)
        if p > 1e-6
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


def base_answer(
    located: Located, tried: Sequence[Candidate], kinds: Mapping[str, Kind], *, first: bool
) -> Answer | None:
    """Name a motion of the base that nobody measured, where it beats all else.

    It must be likelier than an unknown force anywhere else, and than any law; where it enters
    tells it from a force. Where sensors are too few for that, no law may explain much:
    a force within the structure is made by the motion, one from outside is not. Nor can it then
    be told once something else was found `first`.
    """
    group = located.groups[0]
    unmeasured = [k for k in kinds.values() if isinstance(k.action, Unmeasured)]
    place = next((p for p in group.places if p.kind == "base"), None)
    if not unmeasured or place is None or unmeasured[0].strength is None:
        return None
    if any(p.kind in ("element", "node") for p in group.places):
        return None
    likelihood = group.explained.likelihood
    apart = [g for g in located.groups[1:] if not set(g.places) & set(group.twins)]
    rivals = [g.explained.likelihood for g in apart]
    rivals += [-c.cost / 2 for c in tried]
    lead = likelihood - max(rivals, default=-math.inf)
    if lead < LEAST_GAIN or located.p_value > FALSE_ALARM:
        return None
    made = max((-c.cost / 2 for c in tried), default=-math.inf)
    if group.twins and (not first or made > likelihood - (1 - BY_LAWS) * group.score):
        return None
    kind = unmeasured[0]
    assert kind.strength is not None
    forces = [located.latent(place, i).force for i in range(len(located.trials))]
    power = float(np.mean(np.concatenate(forces) ** 2))
    size = math.sqrt(power)
    numbers = {kind.strength: Number(size, SIZE_SD * size, kind.parameter(kind.strength).unit)}
    return Answer(
        effect=Effect(kind.name, place, {kind.strength: size}),
        family=kind.family,
        numbers=numbers,
        probability=float(1 / (1 + math.exp(-min(TEMPER * lead, 50.0)))),
        rivals=(),
        sentence=sentence_of(kind, place, numbers),
    )


def numbers_of(fit: Fit, which: int) -> dict[str, Number]:
    """Numbers of one effect, widened by what the model leaves over the noise."""
    wide = math.sqrt(max(fit.chi2_in_band, 1.0))
    sds = dict(zip(fit.prior.names, fit.sd.tolist(), strict=True))
    return {
        str(name[2]): Number(value, wide * sds.get(name, 0.0), entry.unit)
        for (name, entry), value in zip(
            fit.plant.entries.items(), fit.values.tolist(), strict=True
        )
        if len(name) == 3 and name[1] == which
    }


def moved_of(fit: Fit) -> dict[str, Number]:
    """Constants that left their tolerance."""
    sds = dict(zip(fit.prior.names, fit.sd.tolist(), strict=True))
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return {
        f"{name[0]} {name[1]}": Number(values[name], sds[name], fit.plant.entries[name].unit)
        for name, pull in fit.pulls.items()
        if name[0] != "effect" and abs(pull) > MOVED
    }


def sentence_of(kind: Kind, place: Place, numbers: Mapping[str, Number]) -> str:
    """Name an effect for people."""
    told = ", ".join(
        f"{name} = {n.value:.4g} ± {n.sd:.2g} {n.unit}".rstrip()
        for name, n in numbers.items()
        if n.sd > 0
    )
    words = kind.name.replace("_", " ")
    where = "at the base" if place.kind == "base" else f"at {place}"
    return f"{words.capitalize()} {where}" + (f": {told}. " if told else ". ") + kind.sentence


def fault_of(finding: Finding, kinds: Mapping[str, Kind]) -> Answer | None:
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
    units = {p.name: p.unit for p in kinds[name].parameters}
    return Answer(
        effect=Effect(name, place, parameters),
        family=kinds[name].family,
        numbers={key: Number(value, 0.0, units[key]) for key, value in parameters.items()},
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
    """Give the labels that make up the greater part of the probability."""
    kept, total = [], 0.0
    for named, share in zip(found, shares, strict=True):
        kept.append(Rival(named.effect.kind, named.effect.place, share))
        total += share
        if total > DECIDED:
            break
    return tuple(kept)
