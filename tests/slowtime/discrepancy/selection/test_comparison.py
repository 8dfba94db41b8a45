"""The likelier of two hypotheses about the same records is kept."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.selection.comparison import better, explains_all
from slowtime.discrepancy.selection.doubts import (
    DOUBTED_PROBABILITY,
    MAX_CORRECTION_SHARE,
    doubt,
    doubt_laws,
    doubt_pieces,
)
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import (
    fitted_chain,
    named_effect,
    with_effects_as_given,
    with_last,
)
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    KINDS,
    SECOND,
    TWO,
    records_of,
)


@pytest.fixture(scope="module")
def hardened():
    """The hypothesis of a spring that hardens, by records of one that does."""
    return fitted_chain(TWO, records_of((CUBIC,)), KINDS, CUBIC)


def bare(found):
    return Hypothesis((found.first,), found.trials, fitted=found.fitted)


def test_a_hypothesis_that_explains_more_is_better_than_one_without_its_effect(hardened):
    none = bare(hardened)
    kept = better(none, hardened, KINDS)
    assert [one.effect for one in kept.effects] == [one.effect for one in hardened.effects]
    assert 0.99 < kept.effects[0].probability <= hardened.effects[0].probability
    assert better(hardened, none, KINDS) is hardened
    assert better(none, bare(hardened), KINDS) is none


def test_a_hypothesis_without_a_sensor_is_never_the_better(hardened):
    """It leaves less because there is less to leave."""
    none = bare(hardened)
    deaf = dataclasses.replace(hardened, without_sensor=True)
    assert better(none, deaf, KINDS) is none
    assert better(deaf, hardened, KINDS) is deaf
    held = dataclasses.replace(deaf, suggested_holds=("zero",))
    assert better(none, held, KINDS) is held


def test_a_hypothesis_about_segments_is_better_if_it_explains_them(hardened):
    none = bare(hardened)
    half = dataclasses.replace(hardened, trials=hardened.trials * 2)
    assert better(none, half, KINDS) is half
    given = dataclasses.replace(half.first, chi2_in_band=100.0)
    far = with_last(dataclasses.replace(half, fits=(given, half.last)), chi2_in_band=9.0)
    assert better(none, far, KINDS) is none


@pytest.fixture(scope="module")
def two(hardened):
    return with_effects_as_given(TWO, hardened.trials, KINDS, CUBIC, DRAG)


@pytest.mark.parametrize(("share", "count"), [(1e-4, 1), (4e-4, 2)])
def test_more_effects_have_to_explain_more_than_next_to_nothing_of_what_was_missing(
    two, share, count
):
    found, first = two, two.first

    def leaving(fit, rest):
        """Leave a share of what the model as given left."""
        left = tuple(np.sqrt(rest) * one for one in first.residual)
        made = dataclasses.replace(fit, residual=left, noise=first.noise)
        return dataclasses.replace(made, cost=misfit(made, first.noise, found.trials))

    one, two = leaving(found.fits[1], 0.02), leaving(found.fits[2], 0.02 - share)
    assert (one.cost - two.cost) / 2 > 0
    fewer = found.with_effects((first, one), found.effects[:1])
    more = found.with_effects((first, one, two), found.effects)
    assert len(better(fewer, more, KINDS, -1e9).effects) == count


def test_nothing_is_worth_another_search_once_noise_or_hardly_more_is_left(hardened):
    assert explains_all(hardened)
    assert not explains_all(bare(hardened))
    assert explains_all(dataclasses.replace(bare(hardened), final=True))
    left = with_last(hardened, chi2_in_band=2.0)
    for first, enough in ((1e2, False), (1e4, True)):
        given = dataclasses.replace(left.first, chi2_in_band=first)
        assert explains_all(dataclasses.replace(left, fits=(given, left.last))) is enough


ALL = catalogue()
LEVEL = Effect("saturating_stiffness", SECOND, {"ks_n_per_m": 100.0, "es_m": 0.01})
SKEW = Effect("quadratic_damping", SECOND, {"c2_n_s2_per_m2": 3.0})


@pytest.fixture(scope="module")
def fit():
    return refit(Plant.of(TWO), records_of(()))


def told(fit, chi2, *effects):
    fits = tuple(dataclasses.replace(fit, chi2_in_band=one) for one in chi2)
    return Hypothesis(fits, (), effects=tuple(named_effect(one, ALL) for one in effects))


def test_a_law_that_is_doubted_is_as_likely_as_one_that_is_not_known(fit):
    found = told(fit, (9.0, 1.0), CUBIC)
    doubted = doubt(found, 0)
    assert doubted.effects[0].probability == DOUBTED_PROBABILITY
    assert [(one.effect, one.probability) for one in doubted.undecided] == [
        (CUBIC.kind, DOUBTED_PROBABILITY)
    ]
    assert doubted.near_unknown
    assert (found.effects[0].probability, found.undecided) == (1.0, ())


def test_laws_are_doubted_and_faults_of_sensors_are_not(fit):
    gain = Effect("sensor_gain", Place("sensor", "x_m1"), {"gain": 1.1})
    doubted = doubt_laws(told(fit, (9.0, 4.0, 1.0), CUBIC, gain), ALL)
    assert [one.probability for one in doubted.effects] == [DOUBTED_PROBABILITY, 1.0]


@pytest.mark.parametrize(
    ("second", "share", "doubted"),
    [
        (LEVEL, 2 * MAX_CORRECTION_SHARE, True),
        (LEVEL, MAX_CORRECTION_SHARE / 2, False),
        (SKEW, 0.5, False),
    ],
    ids=["halves", "a correction", "of another variable"],
)
def test_two_curves_at_one_place_may_be_one_that_is_not_known(fit, second, share, doubted):
    found = told(fit, (101.0, 1 + 100 * share, 1.0), CUBIC, second)
    after = doubt_pieces(found, ALL)
    assert after.near_unknown is doubted
    assert [rival.effect for rival in after.undecided] == (
        ["cubic_hardening", "saturating_stiffness"] if doubted else []
    )
    assert all(named.probability < 1 for named in after.effects) is doubted
