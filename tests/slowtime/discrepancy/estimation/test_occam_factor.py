"""Parameters and tolerances cost a law no more evidence than the records narrowed them."""

import dataclasses

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, evidence
from slowtime.discrepancy.estimation.occam_factor import (
    MISSTATED_PROBABILITY,
    TOLERANCE_FACTOR,
    doubted,
    leniency,
)
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.acceptance import Criteria, accept
from slowtime.discrepancy.selection.probabilities import shares_of
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.rigs import ONE, PLACE, one_mass

KINDS = catalogue()
RATE = 64.0
TRUTH = Effect("saturating_stiffness", PLACE, {"ks_n_per_m": 500.0, "es_m": 0.1})
PULLS = st.lists(st.floats(-12.0, 12.0), min_size=1, max_size=4)


def seen(effect, size, of=ONE):
    """Give a model with an effect, and records of it; the noise is a share of their size."""
    rng = np.random.default_rng(3)
    plant = Plant.of(dataclasses.replace(of, effects=(effect.entry(),)))
    push = 60 * np.convolve(rng.standard_normal(1200), np.hanning(9) / 2, "same")[:, None]
    clean = plant.simulate(plant.values, push, RATE)
    noise = size * clean.std() * rng.standard_normal(clean.shape)
    return plant, (Trial(inputs=push, outputs=clean + noise, rate_hz=RATE),)


def named(effect, size):
    """Give it refitted."""
    plant, trials = seen(effect, size)
    fit = refit(plant, trials)
    return FittedCandidate(effect, plant.description, fit, evidence(fit, KINDS))


@given(PULLS)
def test_a_tolerance_is_taken_as_true_or_as_too_small(pulls):
    one = scipy.stats.norm.pdf(pulls)
    other = scipy.stats.norm.pdf(pulls, scale=TOLERANCE_FACTOR)
    told = np.log(
        ((1 - MISSTATED_PROBABILITY) * one + MISSTATED_PROBABILITY * other) / one
    ).sum()
    assert doubted(pulls) == pytest.approx(told, rel=1e-9, abs=1e-9)


@given(PULLS)
def test_no_more_evidence_is_given_back_than_the_pulls_have_cost(pulls):
    assert doubted(pulls) <= np.sum(np.square(pulls)) / 2 + 1e-12


def test_no_pull_gives_no_evidence_back():
    assert doubted([]) == 0.0


@pytest.mark.parametrize("size", [0.02, 4.0])
def test_parameters_cost_the_volume_that_was_narrowed(size):
    """By another road: the volume that is left of a prior as wide as the numbers are large.

    Never more than by Schwarz: nothing is taken away.
    """
    one = named(TRUTH, size)
    own = [i for i, name in enumerate(one.fit.prior.names) if name[0] == "effect"]
    size_of = np.abs(one.fit.free[own])
    inner = one.fit.covariance[np.ix_(own, own)] / np.outer(size_of, size_of)
    both = np.linalg.inv(np.linalg.inv(inner) + np.eye(2))
    cost = -np.log(np.linalg.det(both)) / 2
    back = leniency(one, KINDS)
    assert back == pytest.approx(max(np.log(one.fit.data) - cost, 0.0), abs=0.3)
    assert (back > 0) == (size > 0.1)


def test_records_that_tell_less_give_more_evidence_back():
    assert leniency(named(TRUTH, 4.0), KINDS) > leniency(named(TRUTH, 0.2), KINDS) + 1


def test_a_law_of_unknown_parameters_is_the_limit_of_a_simpler_one():
    one = named(TRUTH, 4.0)
    at = one.fit.prior.names.index(("effect", 0, "es_m"))
    covariance = one.fit.covariance.copy()
    covariance[at, at] = (0.6 * one.fit.free[at]) ** 2
    less = dataclasses.replace(one, fit=dataclasses.replace(one.fit, covariance=covariance))
    assert leniency(less, KINDS) == 0.0
    assert leniency(one, KINDS) > 1


@pytest.mark.parametrize("left", [1.0, 1.5, 2.5])
def test_misfit_widens_the_errors_of_parameters(left):
    """By another road: the same label whose numbers are known as badly, and leaves nothing."""
    one = named(TRUTH, 1.0)
    none = dataclasses.replace(one.fit, chi2_in_band=1.0)
    louder = dataclasses.replace(one.fit, chi2_in_band=left)
    wider = louder.inflated_sd / none.sd
    known = dataclasses.replace(none, covariance=none.covariance * np.outer(wider, wider))
    told, same, least = (
        leniency(dataclasses.replace(one, fit=fit), KINDS) for fit in (louder, known, none)
    )
    assert told == pytest.approx(same)
    assert np.log(left) / 4 <= told - least <= np.log(left)


@pytest.mark.parametrize(("what", "told"), [("damping", True), ("stiffness", False)])
def test_only_dampings_are_doubted_and_only_where_the_law_pulls_them(what, told):
    bare = named(Effect("stiffness_loss", PLACE, {"dk_n_per_m": 40.0}), 0.02)
    values, prior = bare.fit.values.copy(), bare.fit.prior
    at = prior.names.index((what, "k1"))
    values[prior.index[at]] = prior.mean[at] + 4 * prior.sd[at]
    pulled = dataclasses.replace(bare, fit=dataclasses.replace(bare.fit, values=values))
    due = doubted([4.0]) if told else 0.0
    assert leniency(pulled, KINDS, bare.fit) == pytest.approx(due)
    assert leniency(pulled, KINDS, pulled.fit) == 0.0
    assert leniency(bare, KINDS, pulled.fit) == 0.0


def test_a_law_of_more_parameters_that_explains_as_much_has_its_share():
    """Schwarz alone gives two numbers, known to a third, one part in twelve."""
    one = named(TRUTH, 4.0)
    simpler = named(Effect("stiffness_loss", PLACE, {"dk_n_per_m": 40.0}), 4.0)
    simpler = dataclasses.replace(
        simpler, fit=dataclasses.replace(simpler.fit, cost=one.fit.cost, noise=one.fit.noise)
    )
    simpler = dataclasses.replace(simpler, score=evidence(simpler.fit, KINDS))
    shares = shares_of([simpler, one], KINDS)
    assert one.score < simpler.score
    assert shares[1] > 0.15


def test_a_constant_that_is_off_with_every_law_speaks_for_none():
    """A damping four tolerances off, whatever the label: neither is given more for it."""
    off = one_mass(1.6 * 1.6)
    _, trials = seen(TRUTH, 0.02, of=off)
    law = dataclasses.replace(ONE, effects=(TRUTH.entry(),))
    before, fit = refit(Plant.of(ONE), trials), refit(Plant.of(law), trials)
    one = FittedCandidate(TRUTH, fit.plant.description, fit, evidence(fit, KINDS))
    assert fit.pulls["damping", "k1"] > 3
    # As good, and its damping is where it was claimed to be.
    values, at = fit.values.copy(), fit.prior.names.index(("damping", "k1"))
    values[fit.prior.index[at]] = fit.prior.mean[at]
    other = dataclasses.replace(one, fit=dataclasses.replace(fit, values=values))
    terms = Criteria(stated=None, pulled=False)
    step = accept(Hypothesis((before,), trials), before, [one, other], trials, KINDS, terms)
    assert step.hypothesis.effects[0].probability == pytest.approx(0.5, abs=0.02)


def test_the_likeliest_law_is_accepted_though_another_has_fewer_parameters():
    one, (_, trials) = named(TRUTH, 4.0), seen(TRUTH, 4.0)
    simpler = Effect("stiffness_loss", PLACE, {"dk_n_per_m": 40.0})
    plant = Plant.of(dataclasses.replace(ONE, effects=(simpler.entry(),)))
    fit = refit(plant, trials, noise=one.fit.noise)
    less = FittedCandidate(simpler, plant.description, fit, one.score + 0.5)
    before = refit(Plant.of(ONE), trials)
    terms = Criteria(stated=None, pulled=True)
    found = accept(
        Hypothesis((before,), trials), before, [less, one], trials, KINDS, terms
    ).hypothesis
    assert [rival.effect for rival in found.undecided] == [TRUTH.kind, "stiffness_loss"]
    assert found.effects[0].effect.kind == TRUTH.kind
    assert found.last is one.fit
    assert found.pair == (one, less)
