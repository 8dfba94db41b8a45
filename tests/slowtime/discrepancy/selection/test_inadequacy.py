"""A law is certain where it leaves hardly any of the gap, however exact the sensor."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.selection.inadequacy import (
    MAX_AMPLITUDE_LEFT,
    amplitude_left,
    law_probability,
)
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, KINDS, TWO, records_of


@pytest.fixture(scope="module")
def found():
    """Give a function: mean squares over the noise of two fits -> their hypothesis."""
    fit = refit(Plant.of(TWO, kinds=KINDS), records_of((CUBIC,)))

    def of(first, last):
        fits = (
            dataclasses.replace(fit, chi2_in_band=c, in_band_sd=0.01) for c in (first, last)
        )
        return Hypothesis(tuple(fits), ())

    return of


@pytest.fixture(scope="module")
def left_of(found):
    return lambda share, first=1e8: found(first, 1 + share**2 * (first - 1))


@pytest.mark.parametrize("share", [0.5, 0.02, 1e-3])
def test_the_amplitude_left_is_a_share_of_that_of_the_gap(left_of, share):
    assert amplitude_left(left_of(share)) == pytest.approx(share)


def test_what_leaves_hardly_any_of_the_gap_is_certain(left_of):
    assert law_probability(left_of(0.9 * MAX_AMPLITUDE_LEFT)) == 1.0
    assert law_probability(left_of(1.1 * MAX_AMPLITUDE_LEFT)) < 0.8


def test_what_leaves_near_the_noise_is_certain_and_what_leaves_all_is_not(found):
    assert law_probability(found(50.0, 2.0)) == 1.0
    assert law_probability(found(50.0, 50.0)) == 0.0
