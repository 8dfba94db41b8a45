"""Search repeated where what was found shows that a hold of the inputs was mistaken."""

import dataclasses
from collections.abc import Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.estimation.input_hold import (
    Hold,
    describe_holds,
    found_holds,
    held_better,
    held_otherwise,
    with_holds,
)
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.quoting import requote_all
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.discrepancy.refinement.constant_offsets import refit_with_offsets
from slowtime.discrepancy.refinement.constant_release import refit_from_other_stiffnesses
from slowtime.discrepancy.thresholds import LIMITS

from .loop import search
from .settings import SearchSettings


def search_with_holds(
    campaign: Campaign, trials: tuple[Trial, ...], how: SearchSettings
) -> tuple[Campaign, Hypothesis]:
    """Search, and once more under each hold of the inputs that what was found suggests.

    The campaign is returned with what its inputs do between samples.
    """
    kinds, monitor = how.kinds, how.monitor
    stated = how.stated
    assert stated is not None
    first = _fit_as_given(campaign, trials, how)
    if how.decays:  # nothing acts between samples either
        return campaign, search(first, trials, dataclasses.replace(how, stated=None))
    monitor("looking at what inputs do between samples", 0.08)
    holds = found_holds(first, trials, kinds)
    if holds is not None:
        campaign = _held(campaign, holds)
        first = _fit_as_given(campaign, trials, how)
    asked: tuple[tuple[Hold, ...] | None, ...] = (holds,)
    kept: tuple[Campaign, Hypothesis] | None = None
    while True:
        found = search(first, trials, dataclasses.replace(how, asked=asked))
        if found.holds is not None:
            return _held(campaign, found.holds), found
        if kept is not None and found.exhausted and not leaves_less(found, kept[1]):
            return kept  # there was no budget to come as far under this hold
        suggested = found.suggested_holds
        if found.final or not (found.effects or suggested) or monitor.is_over:
            return campaign, found
        monitor("looking at what inputs do between samples", 0.88)
        holds = suggested or held_otherwise(found.last, found.trials, kinds, stated)
        if holds is None or holds in asked:
            return campaign, found
        asked = (*asked, holds)
        kept = campaign, found
        campaign = _held(campaign, holds)
        first = _fit_as_given(campaign, trials, how)
        if suggested is not None:
            kept = campaign, _under(found, holds, how)


def with_best_holds(
    campaign: Campaign, found: Hypothesis, stated: Sequence[Hold], how: SearchSettings
) -> tuple[Campaign, Hypothesis]:
    """Take the hold that does best with all effects in, though another would pass, too."""
    # What is left is noise under either hold; parameters are not the same.
    settled = how.decays or found.final or found.holds is not None or not found.effects
    if settled or not found.fits_whole_records:
        return campaign, found
    holds = held_better(found.last, found.trials, how.kinds, stated)
    if holds is None:
        return campaign, found
    fits = [with_holds(fit, holds, found.trials, how.kinds) for fit in found.fits]
    effects = requote_all(found.effects, fits[-1], how.kinds)
    return _held(campaign, holds), found.with_effects(fits, effects)


def _fit_as_given(campaign: Campaign, trials: tuple[Trial, ...], how: SearchSettings) -> Fit:
    fit = refit_with_offsets(campaign.description, trials, how.kinds, decays=how.decays)
    return fit if how.options.quick else refit_from_other_stiffnesses(fit, trials)


def _held(campaign: Campaign, holds: Sequence[Hold]) -> Campaign:
    return dataclasses.replace(
        campaign, description=describe_holds(campaign.description, holds)
    )


def _under(found: Hypothesis, holds: tuple[Hold, ...], how: SearchSettings) -> Hypothesis:
    """Give what was found its fits under another hold."""
    fits = [with_holds(fit, holds, found.trials, how.kinds) for fit in found.fits]
    return dataclasses.replace(
        found, fits=tuple(fits), holds=holds, rest=locate(fits[-1], found.trials),
        exhausted=True,
    )  # fmt: skip


def leaves_less(found: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a hypothesis explains all, or leaves less than another."""
    if found.last.chi2_in_band < LIMITS.explained_chi2:
        return True
    # One that is judged by segments of records explains these; whole records would not tell.
    if len(found.trials) != len(other.trials):
        return len(found.trials) > len(other.trials)
    return unexplained_by(found.last) < unexplained_by(other.last)
