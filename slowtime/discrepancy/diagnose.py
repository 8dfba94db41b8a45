"""A campaign in, its diagnosis out: screen, refit, locate, name, refit, judge."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place, catalogue, force_along
from slowtime.dynamics.plant import Plant

from .candidates import candidates
from .diagnosis import (
    Diagnosis,
    Gap,
    Rival,
    Step,
    Surface,
    Suspect,
    Verdict,
    When,
)
from .diagnosis import Named as Answer
from .experiment import propose
from .gap import (
    Judged,
    floor_of,
    judge,
    judged,
    noise_on,
    spectra_of,
    traces_of,
    whiteness,
)
from .locate import Located, character, locate
from .naming import KEPT, Named, carrying, chosen, refit_all
from .records import Campaign, Trial
from .refit import Fit, refit
from .screen import Finding, screen
from .undriven import diagnose_undriven
from .values import with_values
from .verdict import (
    DECIDED,
    FALSE_ALARM,
    LEAST_GAIN,
    answer_of,
    base_answer,
    fault_of,
    moved_of,
    probabilities,
    rivals_within,
    verdict_of,
)

UNWHITE = 1e-6
"""Chance of so large a chi squared below which a residual is not called noise."""
SILENT = 0.01
"""The same, above which nothing more is looked for once something was named."""
LEFT = 0.01
"""Share of the first gain that is still to be had once an effect was wrongly named."""
MOST = 3
"""Effects that are looked for, one after the other."""

Progress = Callable[[str, float], None]


@runtime_checkable
class Stop(Protocol):
    """What tells that somebody wants it to end, such as `threading.Event`."""

    def is_set(self) -> bool:
        """Whether to end."""
        ...


class Cancelled(Exception):
    """Somebody asked the diagnosis to stop."""


@dataclasses.dataclass(slots=True, eq=False)
class _Watch:
    """Tells how far it has come, and stops where asked to."""

    progress: Progress | None
    stop: Stop | None

    def __call__(self, stage: str, share: float) -> None:
        if self.stop is not None and self.stop.is_set():
            raise Cancelled(f"The diagnosis was stopped: {stage}.")
        if self.progress is not None:
            self.progress(stage, share)


@dataclasses.dataclass(slots=True, eq=False)
class _Found:
    """What has been found so far."""

    fits: list[Fit]
    located: Located | None = None
    answers: list[Answer] = dataclasses.field(default_factory=list)
    undecided: tuple[Rival, ...] = ()
    pair: tuple[Named, Named] | None = None
    left: Located | None = None


def diagnose(
    campaign: Campaign,
    *,
    kinds: Mapping[str, Kind] | None = None,
    quick: bool = False,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> Diagnosis:
    """Say what a model lacks, where, how much, and how sure that is.

    Parameters
    ----------
    campaign
        Model and records.
    kinds
        Effects that may be named; the catalogue where not given.
    quick
        Fewer rivals are refitted, and one effect is looked for.
    progress
        Told the stage in words and the share done.
    stop
        Once set, `Cancelled` is raised.
    """
    tell = _Watch(progress, stop)
    known = catalogue() if kinds is None else kinds
    tell("screening channels", 0.0)
    screened = [screen(trial, campaign.channels) for trial in campaign.trials]
    trials = tuple(one.trial for one in screened)
    findings = tuple(finding for one in screened for finding in one.findings)
    if campaign.ambient:
        tell("comparing spectra", 0.1)
        return diagnose_undriven(campaign, trials, findings, known)
    tell("refitting the model within its tolerances", 0.05)
    found = _Found([refit(Plant.of(campaign.description, kinds=known), trials)])
    for number in range(1 if quick else MOST):
        if not _next(found, trials, known, 3 if quick else KEPT, number, tell):
            break
    else:
        tell("looking at what is left", 0.9)
        found.left = locate(found.fits[-1], trials)
    tell("judging by what was not fitted", 0.92)
    return _report(campaign, trials, findings, found, known)


def _next(
    found: _Found,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    most: int,
    number: int,
    tell: _Watch,
) -> bool:
    """Look for one more effect; False where there is none."""
    share = 0.1 + 0.27 * number
    before = found.fits[-1]
    if found.answers and whiteness(before) > SILENT:
        return False
    tell("locating what is left", share)
    located = locate(before, trials)
    found.located, found.left = found.located or located, located
    pulled = number == 0 and bool(moved_of(before))
    if located.p_value > FALSE_ALARM and not pulled:
        return False
    tell("trying effects", share + 0.05)
    tried = candidates(before, located, kinds)
    shaken = base_answer(located, tried, kinds)
    if shaken is not None:
        found.answers.append(shaken)
        found.fits.append(carrying(before, shaken.effect, kinds))
        found.left = None
        return False
    labels = chosen(tried, most)

    def tick(effect: Effect, i: int) -> None:
        tell(f"refitting {effect.kind} at {effect.place}", share + 0.08 + 0.18 * i / most)

    named = refit_all(before, labels, trials, kinds, tick)
    if not named:
        return False
    best = named[0]
    bar = refit(
        before.plant, trials, noise=best.fit.noise, values=before.values,
        states=before.states, horizons=(1.0,),
    )  # fmt: skip
    numbers = sum(name[0] == "effect" for name in bar.prior.names)
    nothing = -bar.cost / 2 - numbers / 2 * np.log(bar.data)
    if best.score - nothing < LEAST_GAIN:
        return False
    if number == 0 and _retuned(bar) > best.score:
        return False
    found.fits.append(best.fit)
    found.answers.append(answer_of(named, kinds))
    shares = probabilities([n.score for n in named], best.fit.chi2_in_band)
    if shares[0] < DECIDED and not found.undecided:
        found.undecided = rivals_within(named, shares)
        found.pair = named[0], named[1]
    return True


def _unknown(found: _Found) -> bool:
    """Whether what is left has structure that no effect was found for."""
    if found.left is None or found.left.p_value > FALSE_ALARM:
        return False
    if whiteness(found.fits[-1]) > UNWHITE:
        return False
    assert found.located is not None
    before = found.located.groups[0].score
    return not found.answers or found.left.groups[0].score > LEFT * before


def _retuned(fit: Fit) -> float:
    """Log evidence of constants whose tolerance was stated five times too small."""
    pulls = np.array([p for name, p in fit.pulls.items() if name[0] != "effect"])
    wide = 5.0
    relief = pulls**2 / 2 * (1 - wide**-2) - np.log(wide)
    return float(-fit.cost / 2 + relief.sum())


def _report(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    found: _Found,
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    first, last = found.fits[0], found.fits[-1]
    tests = judged(trials, tuple(screen(t).trial for t in campaign.holdout))
    nominal = judge(campaign.description, dataclasses.replace(
        first, values=first.plant.values
    ), tests)  # fmt: skip
    steps = [judge(_described(fit), fit, tests) for fit in found.fits]
    heard = noise_on(last, tests, steps[-1].runs)
    floor = floor_of(tests, heard)
    faults = [a for f in findings if (a := fault_of(f, kinds)) is not None]
    unknown = not found.undecided and _unknown(found)
    answers = _once([*(() if unknown else found.answers), *faults])
    verdict, sentence = _word(found, answers, first, kinds)
    if unknown:
        verdict, sentence = "unknown_effect", _unnamed(found)
    located = found.located
    assert located is not None
    experiment = propose(*found.pair, trials, kinds) if found.pair is not None else None
    if experiment is not None:
        sentence += f" What would decide: {experiment.sentence}"
    return Diagnosis(
        verdict=verdict,
        sentence=sentence + _closing(steps, nominal, floor),
        effects=tuple(answers),
        undecided=found.undecided if verdict == "undecided" else (),
        experiment=experiment,
        nothing_probability=_nothing(found, located),
        moved=moved_of(last),
        where=_suspects(located),
        when=_when(located) if found.answers else When((), (), ""),
        findings=findings,
        gap=_gap(campaign, found, nominal, steps, floor),
        chi2_per_datum=last.chi2_per_datum,
        residual_white=whiteness(last) > 1e-3,
        white_p_value=whiteness(last),
        nominal=campaign.description,
        refitted=_described(first),
        augmented=_described(last),
        traces=traces_of(tests, nominal.runs, steps[0].runs, steps[-1].runs),
        spectra=spectra_of(tests, steps[0].runs, steps[-1].runs, heard),
        surface=(
            _surface(located, () if unknown else found.answers, kinds)
            if found.answers or unknown
            else None
        ),
        notes=tuple(f"Nearest: {a.sentence}" for a in found.answers) if unknown else (),
    )


def _once(answers: Sequence[Answer]) -> list[Answer]:
    """Keep the first answer for each kind and place."""
    kept: dict[tuple[str, Place], Answer] = {}
    for answer in answers:
        kept.setdefault((answer.effect.kind, answer.effect.place), answer)
    return list(kept.values())


def _described(fit: Fit) -> Description:
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    return with_values(fit.plant.description, values)


def _word(
    found: _Found, answers: Sequence[Answer], first: Fit, kinds: Mapping[str, Kind]
) -> tuple[Verdict, str]:
    if found.undecided:
        names = " or ".join(f"{r.effect} at {r.place}" for r in found.undecided)
        return "undecided", f"These records cannot tell apart: {names}."
    if answers:
        return verdict_of(answers, kinds), " ".join(a.sentence for a in answers)
    moved = moved_of(first)
    if moved:
        told = ", ".join(f"{name} = {n.value:.4g} {n.unit}" for name, n in moved.items())
        return "parameters_only", f"Nothing is missing; constants left their tolerance: {told}."
    return "nothing_missing", "Nothing is missing beyond the stated tolerances."


def _unnamed(found: _Found) -> str:
    assert found.left is not None
    return (
        f"Something is missing at {found.left.best} that is none of the effects known here; "
        "its force is drawn as it was recovered."
    )


def _closing(steps: Sequence[Judged], nominal: Judged, floor: float) -> str:
    return (
        f" The error of the free run falls from {nominal.error.mean():.1%} to "
        f"{steps[-1].error.mean():.1%}; the noise alone is {floor:.1%}."
    )


def _nothing(found: _Found, located: Located) -> float:
    if found.answers:
        return float(np.exp(-max(located.groups[0].score, 0.0)))
    return 1.0 - min(0.5, max(0.0, 1e-3 - located.p_value))


def _suspects(located: Located) -> tuple[Suspect, ...]:
    return tuple(
        Suspect(place, g.score, g.p_value, g.share)
        for g in located.groups
        for place in g.places
    )


def _when(located: Located) -> When:
    seen = character(located, located.best)
    return When(
        seen.times_s, seen.bands_hz, seen.amplitude, linear=seen.linear, steady=seen.steady
    )


def _gap(
    campaign: Campaign,
    found: _Found,
    nominal: Judged,
    steps: Sequence[Judged],
    floor: float,
) -> Gap:
    return Gap(
        nominal=float(nominal.error.mean()),
        refitted_nominal=float(steps[0].error.mean()),
        steps=tuple(
            Step(answer.effect.kind, answer.effect.place, float(step.error.mean()))
            for answer, step in zip(found.answers, steps[1:], strict=False)
        ),
        augmented=float(steps[-1].error.mean()),
        noise_floor=floor,
        on="holdout" if campaign.holdout else "tail",
        worst=float(steps[-1].error.max()),
    )


def _surface(
    located: Located, answers: Sequence[Answer], kinds: Mapping[str, Kind]
) -> Surface | None:
    """Force at the place of the first effect, or of none, as recovered before any was in."""
    place = answers[0].effect.place if answers else located.best
    if place.kind not in ("element", "node"):
        return None
    latents = [located.latent(place, i) for i in range(len(located.trials))]
    law = None
    if answers:
        kind, parameters = kinds[answers[0].effect.kind], answers[0].effect.parameters
        law = np.concatenate([force_along(kind, parameters, x.motion) for x in latents])
    stride = max(sum(len(x.force) for x in latents) // 5000, 1)
    return Surface(
        place=place,
        e=np.concatenate([x.motion.e for x in latents])[::stride],
        v=np.concatenate([x.motion.v for x in latents])[::stride],
        force=np.concatenate([x.force for x in latents])[::stride],
        law=None if law is None else law[::stride],
    )
