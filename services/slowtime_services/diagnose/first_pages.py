"""First pages of the reports of diagnoses: of a model by records, and of a history."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime.dynamics.description import Description
from slowtime.dynamics.elements import BASE
from slowtime_schemas.files.diagnosis import DiagnosisFile, FoundEffect, Where
from slowtime_services.reports import (
    Alternative,
    Confidence,
    FirstPage,
    Improvement,
    Sketch,
    Words,
    level_of,
    measured_on,
    subject_of,
)

from .constants import (
    absurd_changes,
    changes_in_words,
    changes_of,
    listed_changes,
)
from .labels import meaning_of, named, number, raised, thousands_apart

MOST_RIVALS, LEAST = 4, 0.01
"""Rivals that stand beside the answer [1], and the least probability of one [1]. Source: below
it a rival has lost by more than a factor of a hundred."""

ALIKE_NATS = 2.0
"""Difference of log likelihood [nat] up to which a force at one place explains as much as one
at another. Source: half the 3.84 of the likelihood ratio test of one parameter at 5 %."""

MORE_PATIENCE = 4.0
"""Times the budget [1] with which a search that it ended is to be repeated. Source: judgement;
twice is seldom another law, and eight times named no more in hidden cases (decision 0029)."""

MOST_POINTS = 40
"""Nodes of a model that is sketched [1]: more cannot be told apart at this size."""

MOST_NUMBERS = 3
"""Parameters of an effect that the answer names [1]; the table below has all."""


def diagnosis_page(
    diagnosis: Diagnosis, document: DiagnosisFile, words: Words, *, structure: str = ""
) -> FirstPage:
    """Give the first page of the diagnosis of a model.

    `structure` names it; the model's own name where empty.
    """
    places = [place_in(e.where, words) for e in document.effects]
    files = [*document.records, *document.holdout]
    name = subject_of(structure or document.model, files[0] if files else "–", words)
    measured = [(round(first * 1e9), last - first) for first, last in document.measured_s]
    gap, alike = document.gap, _alike_places(document, words)
    return FirstPage(
        kind="diagnosis",
        subject=name,
        question=words("diagnosis.question", name=name),
        answer=_answer(document, words),
        definition=changes_in_words(changes_of(diagnosis.nominal, diagnosis.augmented), words),
        confidence=_confidence(document, alike, words),
        measured=measured_on(measured, words),
        actions=list(dict.fromkeys(_actions(diagnosis, document, alike, words))),
        alternatives=[*_rivals(document, words), *alike],
        beside=_beside(document, alike, words),
        improvement=Improvement(
            given=100 * gap.nominal,
            refitted=100 * gap.refitted_nominal,
            final=100 * gap.augmented,
            floor=100 * gap.noise_floor,
            unit="%",
            meaning=words(f"diagnosis.meaning_{gap.on}"),
        ),
        facts=list(_facts(diagnosis, document, words)),
        sketch=sketch_of(
            diagnosis.nominal,
            diagnosis.augmented,
            [e.where.id for e in document.effects],
            words("ground"),
        ),
        place=", ".join(dict.fromkeys(places)),
    )


def effect_in(kind: str, words: Words) -> str:
    """Name an effect in the report's language; one of an owner by its own name."""
    return words.known(f"effect.{kind}") or named(kind)


def place_in(where: Where, words: Words) -> str:
    """Name a place in the report's language."""
    return words(f"place.{where.kind}", name=where.id)


def _effect(effect: FoundEffect, words: Words) -> str:
    place = place_in(effect.where, words)
    what = words("diagnosis.at", effect=effect_in(effect.effect, words), place=place)
    numbers = [
        f"{words.reason(meaning_of(effect.effect, name, n.unit))} "
        f"{words.phrase(raised(thousands_apart(number(n))))}"
        for name, n in effect.parameters.items()
        if n.sd > 0
    ][:MOST_NUMBERS]
    if not numbers:
        return what
    return words("diagnosis.with", what=what, numbers=", ".join(numbers))


def _answer(document: DiagnosisFile, words: Words) -> str:
    effects = "; ".join(_effect(effect, words) for effect in document.effects)
    constants = ", ".join(words.reason(moved.name) for moved in document.moved)
    early = document.ended is not None and document.verdict == "unknown_effect"
    answer = words(
        f"diagnosis.{document.verdict}{'_early' if early else ''}",
        effects=effects or words("diagnosis.unnamed"),
        constants=constants or words("diagnosis.constants_unnamed"),
    )
    return f"{answer} {_search_end(document, words)}".rstrip()


def _search_end(document: DiagnosisFile, words: Words) -> str:
    """Write what ended the search, where more time may change the answer."""
    ended = document.ended
    if ended is None:
        return ""
    return words(f"diagnosis.ended_{ended.by}", used=words.number(ended.used_s, 3))


def _beside(document: DiagnosisFile, alike: Sequence[Alternative], words: Words) -> str:
    """Head what stands beside the answer; empty for explanations that are less probable."""
    if alike or document.verdict == "undecided":
        return words("diagnosis.beside_alike")
    return words("diagnosis.beside_tried") if document.verdict == "unknown_effect" else ""


def _confidence(
    document: DiagnosisFile, alike: Sequence[Alternative], words: Words
) -> Confidence:
    nothing = document.nothing_probability
    if document.verdict == "undecided":
        best = max((rival.probability for rival in document.undecided), default=0.0)
        told = words("diagnosis.confidence_undecided", p=words.probability(best))
        return _of_something(1.0 - nothing, words, told)
    if document.verdict == "unknown_effect":
        return _of_something(1.0 - nothing, words)
    if document.effects:
        least = min(effect.probability for effect in document.effects)
        told = words("diagnosis.confidence", p=words.probability(least))
        told = f"{told} {words('sd')}"
        if alike and level_of(min(least, 1.0 - nothing)) == "high":
            other = "; ".join(one.name for one in alike)
            return Confidence("medium", told, words("diagnosis.sure_but_kind", other=other))
        return Confidence(level_of(least), told)
    told = words("diagnosis.confidence_nothing", p=words.probability(nothing))
    return Confidence(level_of(nothing), told)


def _of_something(probability: float, words: Words, more: str = "") -> Confidence:
    """Tell how sure it is that something is missing, where it is not known what.

    Never high: the question is what is missing.
    """
    sure = level_of(probability)
    told = words("diagnosis.confidence_unknown", p=words.probability(probability))
    said = words(f"diagnosis.something_{sure}")
    return Confidence("low" if sure == "low" else "medium", f"{told} {more}".rstrip(), said)


def _rivals(document: DiagnosisFile, words: Words) -> Iterator[Alternative]:
    """Give what fits as well, else the best that was tried and by how much it is worse."""
    if document.verdict == "unknown_effect":
        left = words.number(document.chi2_per_datum, 3)
        measure = words("diagnosis.none_known_measure", n=left)
        yield Alternative(words("diagnosis.none_known"), measure)
    every = [rival for effect in document.effects for rival in effect.alternatives]
    every += document.undecided
    every.sort(key=lambda rival: -rival.probability)
    near = [one for one in every if one.probability >= LEAST][:MOST_RIVALS]
    for rival in near or every[:1]:
        place = place_in(rival.where, words)
        name = words("diagnosis.at", effect=effect_in(rival.effect, words), place=place)
        p = words.number(rival.probability, 2) if near else words.probability(rival.probability)
        key = "diagnosis.probability" if near else "diagnosis.best_rival"
        yield Alternative(name, words(key, p=p))
    if not every and document.verdict == "nothing_missing" and document.where:
        best = max(document.where, key=lambda one: one.score)
        place = place_in(Where(kind=best.kind, id=best.id), words)
        nats = words.number(best.score, 2)
        told = words("diagnosis.best_force", nats=nats, p=words.number(best.p_value, 2))
        yield Alternative(words("diagnosis.unknown_force", place=place), told)


def _alike_places(document: DiagnosisFile, words: Words) -> list[Alternative]:
    """Give the places where a force explains as much as at that of an effect that was found."""
    every = []
    scores = {Where(kind=one.kind, id=one.id): one.score for one in document.where}
    for place in dict.fromkeys(effect.where for effect in document.effects):
        own = scores.get(place)
        alike = [
            place_in(other, words)
            for other, score in scores.items()
            if own is not None and other != place and abs(score - own) <= ALIKE_NATS
        ]
        if alike:
            found = words("diagnosis.unknown_force", place=", ".join(alike))
            told = words("diagnosis.alike_places", place=place_in(place, words))
            every.append(Alternative(found, told))
    return every


def _actions(
    diagnosis: Diagnosis, document: DiagnosisFile, alike: Sequence[Alternative], words: Words
) -> Iterator[str]:
    joined = {element.id for element in diagnosis.nominal.elements}
    ended = document.ended
    absurd = absurd_changes(changes_of(diagnosis.nominal, diagnosis.augmented))
    if absurd and document.verdict == "unknown_effect":
        yield words("diagnosis.do_not_use", listed=listed_changes(absurd[:1], words))
    if ended is not None and document.verdict in ("unknown_effect", "undecided"):
        if ended.budget_s is None:
            yield words("diagnosis.do_again")
        else:
            more = words.number(MORE_PATIENCE * ended.budget_s, 3)
            yield words("diagnosis.do_patience", more=more)
    if document.experiment:
        yield words("diagnosis.do_experiment", what=words.reason(document.experiment))
    for finding in document.findings:
        yield words(
            "diagnosis.do_channel",
            name=finding.channel,
            fault=words.reason(named(finding.fault)),
        )
    for moved in document.moved:
        value, sd = words.measured(moved.value, moved.sd)
        yield words(
            "diagnosis.do_constant",
            name=words.reason(moved.name),
            value=value,
            sd=sd,
            unit=moved.unit,
        )
    if document.verdict == "missing_effect":
        if alike:
            other = "; ".join(one.name for one in alike)
            yield words("diagnosis.do_rule_out", other=other)
        for effect in document.effects:
            place = place_in(effect.where, words)
            if effect.where.kind in ("sensor", "input"):
                fault = effect_in(effect.effect, words)
                yield words("diagnosis.do_sensor", place=place, effect=fault)
                continue
            stated = effect.where.kind != "element" or effect.where.id in joined
            key = "diagnosis.do_inspect" if stated else "diagnosis.do_join"
            yield words(key, place=place)
        yield words("diagnosis.do_use_then" if alike else "diagnosis.do_use")
    elif document.verdict == "parameters_only":
        yield words("diagnosis.do_refit")
    elif document.verdict == "nothing_missing":
        yield words("diagnosis.do_keep_refitted")
    elif document.verdict in ("sensor_fault", "input_fault"):
        for effect in document.effects:
            place = place_in(effect.where, words)
            yield words(
                "diagnosis.do_sensor", place=place, effect=effect_in(effect.effect, words)
            )
    elif not document.experiment:
        yield words("diagnosis.do_more")


def _facts(
    diagnosis: Diagnosis, document: DiagnosisFile, words: Words
) -> Iterator[tuple[str, str]]:
    if document.records:
        yield words("facts.data"), ", ".join(document.records)
    if document.holdout:
        yield words("facts.holdout"), ", ".join(document.holdout)
    channels = ", ".join(sensor.channel for sensor in diagnosis.nominal.sensors)
    yield words("facts.channels"), channels
    if diagnosis.traces:
        steps = np.diff(diagnosis.traces[0].times_s)
        rate_hz = 1.0 / float(np.median(steps))
        yield words("facts.rate"), f"{words.number(rate_hz, 5)} Hz"
        total = sum(float(t.times_s[-1] - t.times_s[0]) for t in diagnosis.traces)
        yield words("facts.duration"), f"{words.number(total, 4)} s"


def sketch_of(
    model: Description, augmented: Description, marked: Sequence[str], ground: str
) -> Sketch | None:
    """Sketch a model: each node as far to the right as joints lie between it and the base.

    Elements that a diagnosis has added are drawn as well, and do not move the nodes.

    Returns
    -------
    Points and lines; None of a model of very many nodes.
    """
    names = [node.id for node in model.nodes]
    if len(names) > MOST_POINTS:
        return None
    joints, every = (
        [(e.id, e.between[0], e.between[1]) for e in one.elements if len(e.between) == 2]
        for one in (model, augmented)
    )
    depth = {BASE: 0}
    found = [BASE] if any(BASE in joint for joint in joints) else []
    if not found and names:
        depth, found = {names[0]: 0}, [names[0]]
    for name in found:
        for _, first, last in joints:
            for here, there in ((first, last), (last, first)):
                if here == name and there not in depth:
                    depth[there] = depth[name] + 1
                    found.append(there)
    for name in names:
        depth.setdefault(name, max(depth.values()) + 1)
    row: dict[int, int] = {}
    points = []
    for name in dict.fromkeys([*found, *names]):
        level = row[depth[name]] = row.get(depth[name], -1) + 1
        points.append((ground if name == BASE else name, float(depth[name]), 0.6 * level))
    shown = {BASE: ground}
    lines = [(e, shown.get(a, a), shown.get(b, b)) for e, a, b in every]
    return Sketch(points, lines, tuple(ground if m == BASE else m for m in marked))


def history_page(
    document: Mapping[str, Any], words: Words, *, structure: str = ""
) -> FirstPage:
    """Give the first page of the diagnosis of a history.

    `structure` names it; otherwise the twin or table whose history it is.
    """
    name, unit = structure or document["of"], document["slow_time_unit"]
    dated = document["since"] * 1e9 if unit == "s" else None
    long_s = document["until"] - document["since"]
    effects, gap = document["effects"], document["gap"]

    def told(effect: Mapping[str, Any]) -> str:
        if not effect["covariate"]:
            return effect_in(effect["effect"], words)
        return words(
            "diagnosis.follows",
            effect=effect_in(effect["effect"], words),
            place=effect["covariate"],
        )

    least = min((effect["probability"] for effect in effects), default=None)
    if least is None:
        confidence = _history_confidence(document, words)
    else:
        number_ = words.number(least, 3)
        confidence = Confidence(level_of(least), words("diagnosis.confidence", p=number_))
    rivals = [
        Alternative(told(rival), words("diagnosis.probability", p=words.number(p, 2)))
        for effect in effects
        for rival in effect["alternatives"]
        if (p := rival["probability"]) >= LEAST
    ]
    key = f"diagnosis.{document['verdict']}"
    return FirstPage(
        kind="diagnosis",
        subject=name,
        question=words("diagnosis.question_history", name=name),
        answer=words(
            key,
            effects="; ".join(told(effect) for effect in effects) or words("diagnosis.unnamed"),
            constants=words("diagnosis.constants_unnamed"),
        ),
        confidence=confidence,
        actions=list(_history_actions(document, words)),
        alternatives=rivals[:MOST_RIVALS],
        measured=measured_on([(None if dated is None else round(dated), long_s)], words),
        improvement=Improvement(
            given=100 * gap["nominal"],
            refitted=None,
            final=100 * gap["augmented"],
            floor=100 * gap["noise_floor"],
            unit="%",
            meaning=words("diagnosis.meaning_history"),
        ),
        facts=list(_history_facts(document, words)),
    )


def _history_confidence(document: Mapping[str, Any], words: Words) -> Confidence:
    """Tell how sure it is that nothing drives a history, or that something unnamed does."""
    nothing = document["nothing_probability"]
    if document["verdict"] == "nothing_missing":
        told = words("diagnosis.confidence_nothing_history", p=words.probability(nothing))
        return Confidence(level_of(nothing), told)
    return _of_something(1.0 - nothing, words)


def _history_facts(document: Mapping[str, Any], words: Words) -> Iterator[tuple[str, str]]:
    unit = document["slow_time_unit"]
    yield words("facts.data"), document["of"]
    yield words("facts.epochs"), str(document["readings"])
    yield words("facts.from"), f"{words.number(document['since'], 6)} {unit}"
    yield words("facts.until"), f"{words.number(document['until'], 6)} {unit}"


def _history_actions(document: Mapping[str, Any], words: Words) -> Iterator[str]:
    if document["experiment"]:
        yield words("diagnosis.do_experiment", what=words.reason(document["experiment"]))
    if document["effects"]:
        yield words("diagnosis.do_watch")
    else:
        yield words("diagnosis.do_keep")
