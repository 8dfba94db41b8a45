"""Laws that every step which refines a hypothesis obeys."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.refinement.campaign_span import span_campaign
from slowtime.discrepancy.refinement.convergence import converge, converge_stick_slip
from slowtime.discrepancy.refinement.elimination import eliminate_needless
from slowtime.discrepancy.refinement.force_relearning import relearn_force
from slowtime.discrepancy.refinement.harmful_effects import drop_harmful_effects
from slowtime.discrepancy.refinement.horizon_continuation import (
    refit_friction_with_growing_horizon,
    refit_with_growing_horizon,
)
from slowtime.discrepancy.refinement.initial_states import restart_initial_states
from slowtime.discrepancy.refinement.relocation import relocate
from slowtime.discrepancy.refinement.substitution import substitute
from slowtime.dynamics.effects import catalogue
from tests.slowtime.discrepancy.protocol import fit_at, fitted_chain, scaled
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, DRAG, TWO, records_of

KINDS = {
    name: catalogue()[name] for name in ("cubic_hardening", "quadratic_damping", "coulomb")
}


def relearnt(found):
    held = refit_within_tolerances(found.last, found.trials)
    located = locate(held, found.trials)
    return relearn_force(found, held, located, KINDS, Monitor())


BETTERING = {
    "restart_initial_states": lambda found: restart_initial_states(found, KINDS),
    "refit_with_growing_horizon": lambda found: refit_with_growing_horizon(found, KINDS),
    "refit_friction_with_growing_horizon": lambda found: refit_friction_with_growing_horizon(
        found, KINDS
    ),
    "relocate": lambda found: relocate(found, KINDS, Monitor()),
    "substitute": lambda found: substitute(found, KINDS, None, Monitor()),
    "relearn_force": relearnt,
    "drop_harmful_effects": lambda found: drop_harmful_effects(found, campaign_of(found)),
    "converge_stick_slip": lambda found: converge_stick_slip(found, 0, KINDS, Monitor()),
}
"""Those that give the hypothesis itself where nothing is to be gained."""
REFINERS = BETTERING | {
    "converge": lambda found: converge(found, 0, KINDS),
    "eliminate_needless": lambda found: eliminate_needless(found, found.trials, KINDS),
    "span_campaign": lambda found: span_campaign(found, 0, campaign_of(found), KINDS),
}


def campaign_of(found):
    return Campaign(description=TWO, trials=found.trials)


@pytest.fixture(scope="module")
def right():
    """Both laws that are missing, each where it belongs and with its own parameters."""
    return fitted_chain(TWO, records_of((CUBIC, DRAG), samples=300), KINDS, CUBIC, DRAG)


@pytest.fixture(scope="module")
def off(right):
    """The same with parameters that are off."""
    values = scaled(right.last, k3_n_per_m3=0.7, c2_n_s2_per_m2=1.5)
    last = fit_at(right.last, right.trials, values)
    return dataclasses.replace(right, fits=(*right.fits[:-1], last))


def snapshot(found):
    return (
        [
            (fit.values.copy(), fit.cost, [one.copy() for one in fit.residual])
            for fit in found.fits
        ],
        [dict(named.effect.parameters) for named in found.effects],
        {field.name: getattr(found, field.name) for field in dataclasses.fields(found)},
    )


@pytest.mark.parametrize("name", BETTERING)
def test_where_nothing_is_to_be_gained_the_hypothesis_itself_is_given(name, right):
    assert REFINERS[name](right) is right


@pytest.mark.parametrize("name", REFINERS)
def test_a_refined_hypothesis_is_another_one_that_leaves_no_more(name, off):
    fits, parameters, fields = snapshot(off)
    found = REFINERS[name](off)
    for fit, (values, cost, residual) in zip(off.fits, fits, strict=True):
        np.testing.assert_array_equal(fit.values, values)
        assert fit.cost == cost
        for one, other in zip(fit.residual, residual, strict=True):
            np.testing.assert_array_equal(one, other)
    assert [dict(named.effect.parameters) for named in off.effects] == parameters
    assert all(getattr(off, field) is value for field, value in fields.items())
    # What does harm elsewhere is dropped, whatever it explains here.
    less = unexplained_by(found.last) <= unexplained_by(off.last) + 1e-9
    assert found is off or less or name == "drop_harmful_effects"
    assert len(found.fits) == 1 + len(found.effects)
    for named, effect in zip(found.effects, found.last.plant.effects, strict=True):
        assert (named.effect.kind, named.effect.place) == (effect.kind, effect.place)


@pytest.mark.parametrize("name", REFINERS)
def test_refined_twice_is_refined_once(name, right):
    once = REFINERS[name](right)
    twice = REFINERS[name](once)
    assert [one.effect.kind for one in twice.effects] == [
        one.effect.kind for one in once.effects
    ]
    assert np.abs(twice.last.free - once.last.free) == pytest.approx(
        0.0, abs=0.05 * float(once.last.sd.max())
    )
