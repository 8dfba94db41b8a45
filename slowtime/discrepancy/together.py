"""Pairs of laws that one force is made of, in; an account that begins with both, out."""

import dataclasses
from collections.abc import Mapping, Sequence

from slowtime.dynamics.effects import Kind

from .accepting import accept
from .adding import carrying
from .answer import UNWHITE, Found
from .between import Hold
from .candidates import Candidate, Label, label_of
from .diagnosis import Rival
from .gap import whiteness
from .naming import Named, misfit, refitted
from .paired import pairs
from .records import Trial
from .refit import Fit
from .verdict import DECIDED, EXPLAINED, LEAST_SHARE, answer_of, shares_of
from .watch import Watch


def together(
    found: Found,
    before: Fit,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    stated: tuple[Hold, ...] | None,
    tell: Watch,
) -> Found | None:
    """Begin with two laws at once, where both leave nothing and the best of all leaves much.

    Parameters
    ----------
    found
        What was located, tried and refitted so far.
    before
        The fit that they are added to.
    stated
        What the model says of its inputs between samples; as it stands where not given.
    """
    best = found.named[0].fit if found.named else before
    if best.chi2_in_band < EXPLAINED or whiteness(best) > UNWHITE:
        return None
    if found.located is None or tell.hurries:
        return None
    good: list[tuple[Candidate, Named]] = []
    reached = {
        label_of(one.effect): misfit(one.fit, before.noise, trials) for one in found.named
    }
    for one, other in pairs(before, found.located, found.tried, reached, kinds):
        tell(f"refitting {one.effect.kind} and {other.effect.kind}", 0.35)
        known = carrying(before, one.effect, kinds)
        noise = good[0][1].fit.noise if good else None
        enough = EXPLAINED * before.data
        both = refitted(
            known, other.effect, trials, kinds, noise, enough,
            start=other.start, late=lambda: tell.hurries,
        )  # fmt: skip
        if both is not None and both.fit.chi2_in_band < EXPLAINED:
            good.append((one, both))
    good.sort(key=lambda pair: -pair[1].score)
    if not good:
        return None
    one, both = good[0]
    alone = refitted(before, one.effect, trials, kinds, both.fit.noise)
    if alone is None:
        return None
    branch = Found(
        [found.fits[0], alone.fit],
        found.trials,
        located=found.located,
        named=found.named,
        tried=found.tried,
    )
    branch.answers.append(answer_of([alone], [1.0], kinds))
    if not accept(branch, alone.fit, [both], trials, kinds, stated, pulled=False):
        return None
    _share(
        branch,
        kinds,
        [(label_of(first.effect), label_of(named.effect)) for first, named in good],
        [named for _, named in good],
    )
    return branch


def _share(
    found: Found,
    kinds: Mapping[str, Kind],
    pairs: Sequence[tuple[Label, Label]],
    named: Sequence[Named],
) -> None:
    """Give each of two laws the probability of all pairs that it is one of."""
    shares = shares_of(named, kinds)
    for number, answer in enumerate(found.answers):
        label = label_of(answer.effect)
        rivals = tuple(
            Rival(*other, share)
            for pair, share in zip(pairs, shares, strict=True)
            for other in pair
            if label not in pair and other not in pairs[0] and share > LEAST_SHARE
        )
        sure = sum(s for pair, s in zip(pairs, shares, strict=True) if label in pair)
        found.answers[number] = dataclasses.replace(answer, probability=sure, rivals=rivals)
        if sure < DECIDED and not found.undecided:
            found.undecided = (Rival(*label, sure), *rivals)
            found.pair = tuple(named[:2])
