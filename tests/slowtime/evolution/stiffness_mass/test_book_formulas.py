import csv
import os
import pathlib

import numpy as np
import pytest
from scipy import special

from slowtime.dynamics.evolution_functions import mass_change, stiffness_change
from slowtime.evolution import stiffness_from_frequency
from slowtime.evolution.stiffness_mass import book_formulas, forward_model

ROOT = pathlib.Path(__file__).parents[4]
DATA = pathlib.Path(os.environ.get("SLOWTIME_DATA", ROOT / "../shared/data"))
ZETA = 0.05

# t/T0; Delta_k, Delta_m (5.12, 5.13); damped frequency over w0, distance and damping ratio
# for stiffness, for mass, then for both: frequency, decay rate, d_I, d_R, damping ratio.
REFERENCE = [
    (1, -0.0004094396940982756, 0.01193662073189215, 0.9985442205059833, 0.0002049972659256834,
     0.05001023913669151, 0.9928558871856816, 0.005893330586227364, 0.04970422973651245,
     0.9926521055745034, 0.04941020907400016, 0.006097112197405536, -0.000589790925999836,
     0.04971440830456081),
    (2, -0.0008377397843757202, 0.0238732414637843, 0.9983297352155871, 0.0004194825563218308,
     0.05002095666270157, 0.9870656640570558, 0.0116835537148531, 0.04941364693398128,
     0.9866511129159922, 0.04883417006632316, 0.01209810485591672, -0.00116582993367684,
     0.04943435783661428),
]  # fmt: skip


def check_row(row):
    """Compare each column, forward and back, with what was printed in 16 digits."""
    ts, k, m, r_k, d_1, z_k, r_m, d_2, z_m, r_b, decay, d_i, d_r, z_b = (
        np.array([float(v)]) for v in row
    )
    same(stiffness_change(ts), k)
    # at 1000 periods the argument of the sawtooth is itself rounded, by 3e-14
    same(mass_change(ts), m, atol=5e-15)
    none = np.zeros(1)
    for stiffness, mass, ratio, zeta in [
        (k, none, r_k, z_k),
        (none, m, r_m, z_m),
        (k, m, r_b, z_b),
    ]:
        found = forward_model.damped_frequency_ratio(stiffness, mass, damping_ratio_0=ZETA)
        same(found, ratio)
        same(forward_model.damping_ratio(stiffness, mass, damping_ratio_0=ZETA), zeta)
    natural = forward_model.natural_frequency_ratio(k, m)
    same(natural * z_b, decay)
    same(decay - ZETA, d_r)
    for ratio, signed in [(r_k, d_1), (r_m, d_2), (r_b, d_i)]:
        same(book_formulas.distance(ratio, ZETA), signed)
    same(book_formulas.stiffness(d_1, ZETA), k)
    # the distances are printed with an error of 1e-16, which these multiply
    same(book_formulas.mass(d_2, ZETA), m, atol=5e-15)
    both = book_formulas.stiffness_and_mass(d_r, d_i, ZETA)
    same(both[0], k, atol=2e-14)
    same(both[1], m, atol=2e-14)
    again = book_formulas.stiffness_and_mass_from_ratios(natural, z_b, ZETA)
    same(again[0], k, atol=2e-15)
    same(again[1], m, atol=2e-15)


def same(found, expected, atol=6e-16):
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=atol)


@pytest.mark.parametrize("row", REFERENCE)
def test_the_twin_series_is_reproduced(row):
    check_row(row)


@pytest.mark.data
def test_every_row_of_the_reference_table_is_reproduced_to_its_last_digit():
    table = DATA / "../maths/T1_twin_series.csv"
    if not table.exists():
        pytest.skip(f"no reference table {table.name} beside SLOWTIME_DATA={DATA}")
    with table.open() as file:
        rows = list(csv.reader(file))[1:]
    assert len(rows) == 1001
    for row in rows:
        check_row(row)


def test_without_damping_the_stiffness_is_off_by_the_distance_times_its_square():
    d = np.linspace(-0.5, 0.8, 14)
    off = book_formulas.stiffness_light_damping(d) - book_formulas.stiffness(d, ZETA)
    exact = -d * (2 - 2 * np.sqrt(1 - ZETA**2))
    np.testing.assert_allclose(off, exact, atol=1e-15)
    np.testing.assert_allclose(off, -d * ZETA**2, rtol=1e-3)


@pytest.mark.parametrize(("zeta", "expected"), [(0.05, -9.9e-4), (0.3, -3.6e-2)])
def test_the_mass_called_exact_is_off_by_the_square_of_the_damping(zeta, expected):
    truth = 0.25
    ratio = forward_model.damped_frequency_ratio(np.zeros(1), truth, damping_ratio_0=zeta)
    d = book_formulas.distance(ratio, zeta)
    assert book_formulas.mass(d, zeta)[0] == pytest.approx(truth, abs=1e-12)
    off = book_formulas.mass_light_damping(d)[0] - truth
    assert off == pytest.approx(expected, rel=0.02)
    assert off == pytest.approx(zeta**2 * (1 - (1 + truth) ** 1.5), rel=0.1)


def test_the_mass_exists_only_up_to_half_the_inverse_damping():
    d = book_formulas.distance(np.array([1 / 0.8 - 1e-6, 1 / 0.8 + 1e-6, -0.1]), 0.4)
    np.testing.assert_array_equal(np.isnan(book_formulas.mass(d, 0.4)), [False, True, True])


def test_beyond_the_nominal_frequency_the_root_is_spurious():
    change = book_formulas.stiffness(np.array([1.5]), ZETA)
    assert change[0] == pytest.approx(-0.746, abs=5e-4)
    again = forward_model.damped_frequency_ratio(change, damping_ratio_0=ZETA)
    assert again[0] == pytest.approx(0.501, abs=5e-4)
    assert np.sqrt(1 - ZETA**2) - 1.5 == pytest.approx(-0.501, abs=5e-4)


def test_the_distance_is_positive_when_the_frequency_falls():
    ratio = forward_model.damped_frequency_ratio(np.array([-0.2]), damping_ratio_0=ZETA)
    assert book_formulas.distance(ratio, ZETA)[0] == pytest.approx(0.1057, abs=5e-5)


def test_with_the_error_known_the_corrected_form_returns_the_truth_and_the_print_does_not():
    truth, theta = np.array([-0.2]), np.array([0.03])
    noisy = forward_model.damped_frequency_ratio(truth, damping_ratio_0=ZETA) + theta
    d = book_formulas.distance(noisy, ZETA)
    np.testing.assert_allclose(
        book_formulas.stiffness_error_known(d, theta, ZETA), truth, atol=1e-15
    )
    r0 = np.sqrt(1 - ZETA**2)
    printed = -(d + theta) * (2 * r0 - d + theta)
    np.testing.assert_allclose(printed - truth, -2 * theta * (d + theta), atol=1e-15)


def test_with_the_error_known_mass_and_the_pair_return_the_truth_too():
    k, m, theta, eta = (np.array([v]) for v in (-0.2, 0.25, 0.03, 0.004))
    ratio = forward_model.natural_frequency_ratio(np.zeros(1), m)
    d = 1 - (ratio + theta)
    np.testing.assert_allclose(book_formulas.mass_error_known(d, theta), m, atol=1e-14)
    decay = forward_model.natural_frequency_ratio(k, m) * forward_model.damping_ratio(
        k, m, damping_ratio_0=ZETA
    )
    damped = forward_model.damped_frequency_ratio(k, m, damping_ratio_0=ZETA)
    # the real part of the pole is minus the decay rate
    d_r, d_i = decay - eta - ZETA, book_formulas.distance(damped + theta, ZETA)
    found = book_formulas.stiffness_and_mass_error_known(d_r, d_i, eta, theta, ZETA)
    np.testing.assert_allclose(found, (k, m), atol=1e-13)


@pytest.mark.parametrize(("truth", "imaginary"), [(0.0, 0.68), (-0.05, 0.47), (-0.10, 0.14)])
def test_the_root_of_5_30_is_imaginary_this_often(truth, imaginary):
    rng = np.random.default_rng(51)
    s = 0.025
    r = forward_model.damped_frequency_ratio(np.array([truth]), damping_ratio_0=ZETA)[0]
    d = book_formulas.distance(r + s * rng.standard_normal(200_000), ZETA)
    assert np.mean(np.abs(d) < s) == pytest.approx(imaginary, abs=0.01)
    lost = book_formulas.stiffness_error_size_known(d, s, ZETA) == 0
    np.testing.assert_array_equal(lost, np.abs(d) <= s)


@pytest.mark.parametrize(("truth", "bias"), [(-0.05, 0.016), (-0.10, 0.015)])
def test_fed_with_single_readings_5_30_shrinks_and_the_unbiased_estimate_does_not(truth, bias):
    rng = np.random.default_rng(52)
    s = 0.025
    r = forward_model.damped_frequency_ratio(np.array([truth]), damping_ratio_0=ZETA)[0]
    ratio = r + s * rng.standard_normal(400_000)
    book_s = book_formulas.stiffness_error_size_known(
        book_formulas.distance(ratio, ZETA), s, ZETA
    )
    ours = stiffness_from_frequency(ratio, s, damping_ratio_0=ZETA).value
    assert np.mean(book_s) - truth == pytest.approx(bias, abs=0.0015)
    assert abs(np.mean(ours) - truth) < 3e-4
    if truth == -0.10:
        assert np.sqrt(np.mean((book_s - truth) ** 2)) == pytest.approx(0.0555, abs=5e-4)
        assert np.sqrt(np.mean((ours - truth) ** 2)) == pytest.approx(0.0473, abs=5e-4)


def test_fed_with_the_exact_distance_5_30_is_off_by_the_variance_over_the_distance():
    s, truth = 0.025, -0.05
    r = forward_model.damped_frequency_ratio(np.array([truth]), damping_ratio_0=ZETA)
    d = book_formulas.distance(r, ZETA)
    off = book_formulas.stiffness_error_size_known(d, s, ZETA) - truth
    assert off[0] + truth == pytest.approx(-0.0084, abs=2e-4)


def test_fed_with_the_mean_square_5_30_is_right_but_no_better_than_the_mean():
    rng = np.random.default_rng(53)
    s, truth, n = 0.025, -0.1, 400
    r = forward_model.damped_frequency_ratio(np.array([truth]), damping_ratio_0=ZETA)[0]
    d = np.sqrt(1 - ZETA**2) - r - s * rng.standard_normal((2_000, n))
    root_mean_square = np.sqrt(np.mean(d**2, axis=1))
    by_square = book_formulas.stiffness_error_size_known(root_mean_square, s, ZETA)
    by_mean = book_formulas.stiffness(d.mean(axis=1), ZETA)
    assert by_square.mean() == pytest.approx(truth, abs=5e-4)
    assert by_mean.std() < by_square.std()


def test_the_mass_of_5_47_fails_in_the_same_way_and_so_does_the_pair():
    d = np.array([-0.02, 0.01, 0.2])
    np.testing.assert_array_equal(book_formulas.mass_error_size_known(d, 0.025)[:2], 0.0)
    k, m = book_formulas.stiffness_and_mass_error_size_known(d, d, 0.025, 0.025, ZETA)
    np.testing.assert_array_equal(k[:2], 0.0)
    np.testing.assert_array_equal(m[:2], 0.0)


def test_frequency_with_damped_frequency_cannot_tell_the_damping():
    rng = np.random.default_rng(54)
    e = 0.001 * rng.standard_normal((2, 200_000))
    squared = 1 - ((1 + e[0]) * np.sqrt(1 - ZETA**2) / (1 + e[1])) ** 2
    assert squared.std() == pytest.approx(2.8e-3, rel=0.03)
    assert np.mean(squared < 0) == pytest.approx(0.19, abs=0.01)


def test_the_chance_that_the_measured_decay_rate_is_negative():
    assert special.ndtr(-0.05 / 0.025) == pytest.approx(0.023, abs=5e-4)
    assert special.ndtr(-0.01 / 0.025) == pytest.approx(0.34, abs=5e-3)


def test_a_percentage_is_refused_as_a_ratio():
    with pytest.raises(ValueError, match="not a percentage"):
        book_formulas.distance(np.ones(1), 5.0)
