"""What was found, in; the whole answer, with the gap that it closes, out."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind, Place, force_along

from .diagnosis import Diagnosis, Gap, Rival, Step, Surface, Suspect, Verdict, When
from .diagnosis import Named as Answer
from .experiment import propose
from .gap import Judged, floor_of, judge, judged, noise_on, spectra_of, traces_of, whiteness
from .locate import Located, character
from .naming import Named
from .records import Campaign, Trial
from .refit import Fit
from .screen import Finding, screen
from .values import with_values
from .verdict import FALSE_ALARM, fault_of, moved_of, verdict_of

UNWHITE = 1e-6
"""Chance of so large a chi squared below which a residual is not called noise."""
LEFT = 1e-3
"""Share of the first gain that is still to be had once an effect was wrongly named."""


NOT_HELD_OUT = (
    "No record was held out: the gap is that of the last third of each record, fitted "
    "with the rest. Hold one out to see how far the model can be trusted elsewhere."
)


@dataclasses.dataclass(slots=True, eq=False)
class Found:
    """What has been found so far, and the records by which."""

    fits: list[Fit]
    trials: tuple[Trial, ...]
    located: Located | None = None
    answers: list[Answer] = dataclasses.field(default_factory=list)
    undecided: tuple[Rival, ...] = ()
    pair: tuple[Named, Named] | None = None
    left: Located | None = None


def report(
    campaign: Campaign,
    trials: tuple[Trial, ...],
    findings: tuple[Finding, ...],
    found: Found,
    kinds: Mapping[str, Kind],
) -> Diagnosis:
    """Put an answer together: verdict, sentences, the gap on what was not fitted, pictures."""
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
        notes=(
            *((NOT_HELD_OUT,) if not campaign.holdout else ()),
            *((f"Nearest: {a.sentence}" for a in found.answers) if unknown else ()),
        ),
    )


def _unknown(found: Found) -> bool:
    """Whether what is left has structure that no effect was found for."""
    if found.left is None or found.left.p_value > FALSE_ALARM:
        return False
    if whiteness(found.fits[-1]) > UNWHITE:
        return False
    assert found.located is not None
    before = found.located.groups[0].score
    return not found.answers or found.left.groups[0].score > LEFT * before


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
    found: Found, answers: Sequence[Answer], first: Fit, kinds: Mapping[str, Kind]
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


def _unnamed(found: Found) -> str:
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


def _nothing(found: Found, located: Located) -> float:
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
    found: Found,
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
