"""A history diagnosed: what it follows, how surely, and what adopting that is worth."""

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.identification.estimates import Measured

from . import model, modes, pictures, words
from .history import Covariate, Filled, Scaled, Series, history, scaled
from .kinds import kinds
from .law import Readings, solve
from .model import SlowModel
from .outliers import agreeing, left_over
from .parameters import Parameter, Units, parameters
from .report import Alternative, SlowEffect, SlowReport, Verdict
from .search import Contest, Found, search
from .swapped import Swap, swapped

Quantity = Literal["stiffness_change", "frequency_ratio", "frequency_hz"]

Readouts: TypeAlias = Float[np.ndarray, " time"] | Float[np.ndarray, "time mode"]

_SUBJECT = {
    "stiffness_change": ("stiffness", "%", 100.0),
    "frequency_ratio": ("frequency", "%", 100.0),
    "frequency_hz": ("frequency", "Hz", 1.0),
}
_DECIDED = 0.8  # probability of a family from which on it is named
_MENTIONED = 0.05
_POSSIBLE = 0.5  # probability of something from which on nothing is not claimed either
_WHITE = 0.01


def diagnose_history(
    slow_time: Series,
    value: Readouts,
    sd: Readouts,
    covariates: Sequence[Covariate] = (),
    *,
    quantity: Quantity = "stiffness_change",
    time_unit: str = "day",
    max_effects: int = 3,
    progress: Callable[[str, float], None] | None = None,
) -> SlowReport:
    """Find what a history of features follows that its twin does not know of.

    The twin as it is expects a constant that wanders (a Matérn process whose spread and length
    are learnt). An effect is named if the readings are much more probable with it, by the
    state-space likelihood with coefficients integrated out and shapes paid for; and one by
    one, until nothing more is missing.

    Parameters
    ----------
    slow_time
        Of the epochs, in any order and at any distance.
    value, sd
        Relative change of stiffness, or frequency, with its stated standard deviation (which
        may be wrong by a factor that all share); NaN where missing. With several modes, one
        column each: what they do together is diagnosed, and whether one leaves the others.
    covariates
        What was read beside; with gaps.
    quantity
        What the values are.
    time_unit
        Of slow time: "s", "min", "h", "day", "year", or any other name for what is no time.
    max_effects
        Where to stop.
    progress
        Called with a word and the share that is done.

    Returns
    -------
    The report; `adopt` makes the model of it that foretells.

    Examples
    --------
    >>> rng = np.random.default_rng(5)
    >>> day = np.arange(200.0)
    >>> warmth = 10.0 * np.sin(day / 20.0) + rng.normal(0.0, 4.0, 200)
    >>> change = -0.001 * warmth + rng.normal(0.0, 0.002, 200)
    >>> report = diagnose_history(day, change, np.full(200, 0.002),
    ...                           [Covariate("temperature", warmth, "°C")])
    >>> report.verdict, report.effects[0].effect
    ('missing_effect', 'temperature_linear')
    """
    tell = progress or (lambda word, share: None)
    gone = None
    if value.ndim == 2 and value.shape[1] > 1:
        tell("modes", 0.0)
        gone = modes.departure(slow_time, value, sd)
        if gone is not None:
            value, sd = modes.without(value, gone), modes.without(sd, gone)
        value, sd = modes.together(value, sd)
    past = history(slow_time, value.reshape(len(value)), sd.reshape(len(sd)), tuple(covariates))
    inner = scaled(past)
    readings, swap = _judged(inner)
    tried = kinds(inner, time_unit)
    found = search(readings, tried, max_effects, tell)
    nominal = model.learn(past, found.readings, (), found.nominal.wander)
    augmented = nominal
    if terms := found.augmented.terms:
        augmented = model.learn(
            past,
            found.readings,
            terms,
            found.augmented.wander,
            nominal,
            model.rivals(found.contests),
        )
    tell("done", 1.0)
    return _report(found, nominal, augmented, quantity, time_unit, swap, gone)


def _judged(past: Scaled) -> tuple[Readings, Swap | None]:
    """Sort out which readings are none of this mode, or outliers."""
    nothing, barred = np.empty((len(past.time), 0)), np.zeros(len(past.time), dtype=bool)
    mask = agreeing(past, nothing, barred)
    swap = swapped(left_over(past, mask))
    if swap is not None:
        barred = swap.which
        mask = agreeing(past, nothing, barred)
    return Readings(past, mask, past.sd**2, barred), swap


def adopt(report: SlowReport, effects: Sequence[int] | None = None) -> SlowModel:
    """Take effects of a report into the twin: the model with which to foretell.

    Parameters
    ----------
    report
        Of `diagnose_history`.
    effects
        Indices of those to adopt; left out, all.

    Returns
    -------
    For `forecast` and `follow`; `undo` gives back the one before.
    """
    count = len(report.effects)
    if wrong := [index for index in effects or () if not 0 <= index < count]:
        raise ValueError(
            f"Effects {wrong} were asked for, but the report holds {count}. Give indices from "
            "0, or none for all of them."
        )
    whole = report.augmented
    laws = range(len(whole.names))
    chosen = [index for index in laws if effects is None or index in effects]
    if len(chosen) == len(whole.names):
        return whole
    best = whole.members[0]
    terms = tuple(best.terms[index] for index in chosen)
    return model.learn(whole.past, whole.readings, terms, best.wander, report.nominal)


def _report(
    found: Found,
    nominal: SlowModel,
    augmented: SlowModel,
    quantity: Quantity,
    time_unit: str,
    swap: Swap | None,
    gone: modes.Departure | None,
) -> SlowReport:
    subject, unit, factor = _SUBJECT[quantity]
    units = Units(unit, factor, time_unit)
    past, mask = augmented.readings.past, augmented.readings.mask
    laws = tuple(
        _effect(found.contests[i], augmented, i, subject, units)
        for i in range(len(augmented.names))
    )
    effects = (*laws, *_of_sensors(augmented, swap, gone, units))
    undecided = _undecided(found, len(laws))
    verdict = _verdict(effects, undecided)
    best = augmented.members[0]
    spread = float(
        np.sqrt(solve(augmented.readings, best.terms, best.wander)[0].noise_variance)
    )
    p_value = pictures.whiteness(augmented)
    followed = {name: who for contest in (*found.contests, found.last)
                for name, who in _followed(contest, past.covariates)}  # fmt: skip
    span = f"{past.span:.3g} {time_unit}"
    return SlowReport(
        verdict=verdict,
        sentence=_sentence(verdict, effects, undecided, subject),
        effects=effects,
        undecided=undecided,
        experiment=words.experiment(list(undecided), followed, span) if undecided else "",
        nothing_probability=found.last.nothing.probability,
        gap=pictures.gap(nominal, augmented),
        residual_white=p_value > _WHITE,
        white_p_value=p_value,
        wander_sd=past.scale * best.wander.sd * spread,
        wander_length=past.span * best.wander.length if best.wander.sd > 0.0 else 0.0,
        noise_factor=spread,
        outliers=tuple(augmented.past.time[~mask].tolist()),
        swapped=() if swap is None else tuple(augmented.past.time[swap.which].tolist()),
        ignored=tuple(
            c.name
            for c in augmented.past.covariates
            if c.name not in {f.name for f in past.covariates}
        ),
        picture=pictures.picture(nominal, augmented),
        nominal=nominal,
        augmented=augmented,
    )


def _effect(
    contest: Contest, augmented: SlowModel, place: int, subject: str, units: Units
) -> SlowEffect:
    """Tell one law: its numbers, its rivals, its words."""
    term = augmented.members[0].terms[place]
    covariates = augmented.readings.past.covariates
    followed = None if term.kind.covariate is None else covariates[term.kind.covariate]
    numbers = parameters(augmented.readings, augmented.members, place, units)
    own = (term.kind.name, term.kind.covariate)
    probability = sum(p for name, who, p, _ in contest.by_name() if (name, who) == own)
    rivals = [
        Alternative(name, None if who is None else covariates[who].name, p)
        for name, who, p, _ in contest.by_name()
        if (name, who) != own and p > 0.001
    ]
    return SlowEffect(
        term.kind.name,
        term.kind.family,
        None if followed is None else followed.name,
        numbers,
        probability,
        tuple(rivals),
        words.sentence(term.kind.name, subject, numbers, followed),
        pictures.curve(augmented, place),
    )


def _of_sensors(
    augmented: SlowModel,
    swap: Swap | None,
    gone: modes.Departure | None,
    units: Units,
) -> list[SlowEffect]:
    """Tell what is no law of the structure: another mode read for it, a mode gone astray."""
    found = []
    if swap is not None:
        size = units.factor * augmented.readings.past.scale
        offset = Measured(size * swap.offset, size * swap.sd)
        share = Measured(100.0 * float(swap.which.mean()), 0.0)
        numbers = (Parameter("offset", offset, units.value), Parameter("share", share, "%"))
        told = (
            f"{words.number(share, '%')} of the readings lie together at "
            f"{words.number(offset, units.value)} from the others: another mode is read in "
            "the place of this one"
        )
        found.append(SlowEffect("mode_swap", "sensor", None, numbers, 0.99, (), told, None))
    if gone is not None:
        at = Measured(gone.time, 0.0)
        offset = Measured(units.factor * gone.offset, 0.0)
        which = (
            Parameter("mode", Measured(float(gone.mode), 0.0), "1"),
            Parameter("change", offset, units.value),
            Parameter("time", at, units.time),
        )
        told = (
            f"mode {gone.mode} alone changes by {words.number(offset, units.value)} at "
            f"{words.number(at, units.time)}, the others do not: look at its sensor or tracking"
        )
        found.append(
            SlowEffect("sensor_change", "sensor", None, which, gone.probability, (), told, None)
        )
    return found


def _undecided(found: Found, count: int) -> tuple[str, ...]:
    """Names that cannot be told apart where no family is sure, or something may be missing."""
    for contest in found.contests[:count]:
        families: dict[tuple[str, int | None], float] = {}
        for name, who, probability, option in contest.by_name():
            family = option.kind.family if option.kind is not None else name
            families[family, who] = families.get((family, who), 0.0) + probability
        if max(families.values()) < _DECIDED:
            return tuple(dict.fromkeys(n for n, _, p, _ in contest.by_name() if p > _MENTIONED))
    if not count and found.last.nothing.probability < _POSSIBLE:
        near = [name for name, _, p, _ in found.last.by_name() if p > _MENTIONED]
        return ("nothing_missing", *dict.fromkeys(near))
    return ()


def _verdict(effects: tuple[SlowEffect, ...], undecided: tuple[str, ...]) -> Verdict:
    if undecided:
        return "undecided"
    if not effects:
        return "nothing_missing"
    if all(effect.family == "sensor" for effect in effects):
        return "sensor_fault"
    if any(effect.effect.endswith("_curved") for effect in effects):
        return "unknown_effect"
    return "missing_effect"


def _followed(contest: Contest, covariates: tuple[Filled, ...]) -> list[tuple[str, str]]:
    return [
        (name, covariates[who].name) for name, who, _, _ in contest.by_name() if who is not None
    ]


def _sentence(
    verdict: Verdict, effects: tuple[SlowEffect, ...], undecided: tuple[str, ...], subject: str
) -> str:
    told = "; ".join(effect.sentence for effect in effects)
    if verdict == "nothing_missing":
        return f"Nothing is missing: {subject} only wanders as the twin expects."
    if verdict == "undecided":
        names = " or ".join(name.replace("_", " ") for name in undecided)
        return f"It cannot be decided: {names}." + (f" The likeliest: {told}." if told else "")
    return f"{told[0].upper()}{told[1:]}."
