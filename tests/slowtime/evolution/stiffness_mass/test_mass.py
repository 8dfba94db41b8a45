import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slowtime.evolution import Reason, mass_from_frequency
from slowtime.evolution.stiffness_mass.bounded_posterior import MassScale
from slowtime.evolution.stiffness_mass.forward_model import damped_frequency_ratio

RUNS = 200_000


@given(st.floats(-0.8, 3.0), st.floats(0.0, 0.3))
def test_an_exact_frequency_gives_the_exact_mass(change, zeta):
    if 1 + change <= 2.01 * zeta**2:
        return
    companion = np.array([[0.0, 1.0], [-1 / (1 + change), -2 * zeta / (1 + change)]])
    ratio = np.array([np.abs(np.linalg.eigvals(companion).imag).max()])
    found = mass_from_frequency(ratio, 0.0, damping_ratio_0=zeta)
    assert found.value[0] == pytest.approx(change, abs=1e-8 * (1 + change) ** 2)
    assert found.sd[0] == 0.0


@pytest.mark.parametrize("truth", [-0.2, 0.0, 0.25, 0.6])
@pytest.mark.parametrize("s", [0.001, 0.025])
@pytest.mark.parametrize("zeta", [0.0, 0.05])
def test_the_bias_is_gone_the_sd_is_right_and_the_interval_covers(truth, s, zeta):
    rng = np.random.default_rng(21)
    r = damped_frequency_ratio(np.zeros(1), truth, damping_ratio_0=zeta)[0]
    ratio = r + s * rng.standard_normal(RUNS)
    found = mass_from_frequency(ratio, s, damping_ratio_0=zeta)
    noise = found.value.std() / np.sqrt(RUNS)
    assert abs(found.value.mean() - truth) < 4 * noise + 30 * s**4 * (1 + truth) ** 3
    assert np.sqrt(np.mean(found.sd**2)) == pytest.approx(found.value.std(), rel=0.05)
    covered = np.mean((found.lo <= truth) & (truth <= found.hi))
    assert covered == pytest.approx(0.95, abs=0.002)


def test_without_the_correction_the_bias_would_be_of_second_order():
    rng = np.random.default_rng(22)
    s, truth = 0.025, 0.25
    ratio = 1 / np.sqrt(1 + truth) + s * rng.standard_normal(1_000_000)
    naive = np.mean(ratio**-2.0 - 1) - truth
    ours = mass_from_frequency(ratio, s).value.mean() - truth
    assert naive == pytest.approx(3 * s**2 * (1 + truth) ** 2, rel=0.15)
    assert abs(ours) < 0.1 * naive


@pytest.mark.parametrize("nominal", [0.002, 0.03])
def test_an_uncertain_nominal_frequency_widens_everything_and_biases_nothing(nominal):
    rng = np.random.default_rng(23)
    truth, s = 0.2, 0.01
    f0_learnt = 1 + nominal * rng.standard_normal(RUNS)
    measured = 1 / np.sqrt(1 + truth) + s * rng.standard_normal(RUNS)
    found = mass_from_frequency(
        measured / f0_learnt, s / f0_learnt, nominal_relative_sd=nominal
    )
    assert found.value.mean() == pytest.approx(truth, abs=5e-4)
    assert np.mean(found.sd) == pytest.approx(found.value.std(), rel=0.05)
    covered = np.mean((found.lo <= truth) & (truth <= found.hi))
    assert covered == pytest.approx(0.95, abs=0.003)


@given(st.floats(0.1, 0.6), st.floats(1.001, 1.5), st.floats(0.0, 0.1), st.floats(0.0, 0.4))
def test_a_higher_frequency_means_less_mass(ratio, higher, s, zeta):
    found = mass_from_frequency(np.array([ratio, ratio * higher]), s, damping_ratio_0=zeta)
    assert found.lo[0] >= found.lo[1]
    assert found.hi[0] >= found.hi[1]


@given(st.floats(0.01, 3.0), st.floats(0.0, 1.0), st.floats(0.0, 0.5))
def test_the_value_lies_within_its_interval_or_no_mass_exists(ratio, s, zeta):
    found = mass_from_frequency(np.array([ratio]), s, damping_ratio_0=zeta)
    if found.reasons[0] & Reason.NO_SUCH_MASS:
        assert np.isnan(found.value[0])
    else:
        assert found.lo[0] <= found.value[0] <= found.hi[0]


def test_a_frequency_no_mass_can_give_is_refused_with_a_reason():
    found = mass_from_frequency(np.array([1.2, 1.3]), 0.0, damping_ratio_0=0.4)
    np.testing.assert_array_equal(
        (found.reasons & int(Reason.NO_SUCH_MASS)) != 0, [False, True]
    )
    assert np.isfinite(found.value[0])
    assert np.isnan(found.value[1])


def test_a_frequency_that_may_be_zero_leaves_the_mass_unbounded_and_not_valid():
    found = mass_from_frequency(np.array([0.9]), 0.5)
    assert found.hi[0] == np.inf
    assert not found.valid[0]


@pytest.mark.parametrize("zeta", [0.0, 0.05, 0.3])
def test_the_derivatives_of_the_mass_are_those_of_finite_differences(zeta):
    scale, r, h = MassScale(zeta), np.linspace(0.5, 1.3, 9), 1e-4
    mass, slope, curvature = scale.mass_and_derivatives(r)
    up, down = scale.change(r + h), scale.change(r - h)
    np.testing.assert_allclose(mass, 1 + scale.change(r), rtol=1e-14)
    np.testing.assert_allclose(slope, (up - down) / (2 * h), rtol=1e-5)
    np.testing.assert_allclose(curvature, (up - 2 * mass + 2 + down) / h**2, rtol=1e-4)
    np.testing.assert_allclose(scale.ratio(scale.change(r)), r, rtol=1e-12)
