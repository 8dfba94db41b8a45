import csv
import itertools
import os
import pathlib

import numpy as np
import pytest
from scipy import integrate

from slowtime.evolution import Reason, mass_from_frequency, stiffness_from_frequency
from slowtime.evolution.stiffness_mass.bounded_posterior import (
    MassScale,
    StiffnessScale,
    posterior,
)

ROOT = pathlib.Path(__file__).parents[4]
DATA = pathlib.Path(os.environ.get("SLOWTIME_DATA", ROOT / "../shared/data"))

# r_hat, s, upper bound, unbiased, its sd, then mean and sd with a prior flat in r and in Dk;
# nominal damping 0.05, lower bound -0.9. By quadrature with 40 digits.
REFERENCE = [
    (1.00, 0.005, 0.0, 0.002475, 0.0099999374998, -0.00710558880205, 0.00555407969194,
     -0.00708999147817, 0.00554563073436),
    (1.05, 0.005, 0.0, 0.104975, 0.010499940476, -0.000956197596053, 0.000947319435494,
     -0.000955747124111, 0.000946880786737),
    (0.90, 0.025, 0.0, -0.188125, 0.044991318607, -0.186882750835, 0.0449924268263,
     -0.185633598472, 0.0450081297546),
    (1.00, 0.025, 1.0, 0.001875, 0.0499921868896, 0.003125, 0.0500078118897, 0.004375,
     0.0500234320094),
]  # fmt: skip


def check_row(r_hat, s, least, most, expected):
    ratio = np.array([r_hat])
    found = stiffness_from_frequency(ratio, s, damping_ratio_0=0.05)
    scale = StiffnessScale(1 - 0.05**2)
    got = [found.value[0], found.sd[0]]
    for flat_in in ("frequency", "change"):
        law = posterior(ratio, np.array([s]), scale, (least, most), flat_in=flat_in)
        got += [law.mean[0], law.sd[0]]
    # printed with 12 significant digits
    np.testing.assert_allclose(got, expected, rtol=6e-12)


@pytest.mark.parametrize("row", REFERENCE)
def test_unbiased_and_bounded_estimates_match_the_reference(row):
    r_hat, s, most, *expected = row
    check_row(r_hat, s, -0.9, most, expected)


@pytest.mark.data
def test_every_row_of_the_reference_table_is_reproduced_to_its_last_digit():
    table = DATA / "../maths/T7_posterior_delta_k.csv"
    if not table.exists():
        pytest.skip(f"no reference table {table.name} beside SLOWTIME_DATA={DATA}")
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    for row in rows:
        columns = [
            "unbiased", "unbiased_sd_hat", "post_mean_flat_r", "post_sd_flat_r",
            "post_mean_flat_Dk", "post_sd_flat_Dk",
        ]  # fmt: skip
        check_row(
            float(row["r_hat"]),
            float(row["s"]),
            float(row["Dk_lo"]),
            float(row["Dk_hi"]),
            [float(row[column]) for column in columns],
        )


@pytest.mark.parametrize("flat_in", ["frequency", "change"])
@pytest.mark.parametrize("scale", [StiffnessScale(1 - 0.05**2), MassScale(0.05)])
@pytest.mark.parametrize("r_hat", [0.8, 0.97, 1.0, 1.1, 1.3])
@pytest.mark.parametrize("s", [0.003, 0.03, 0.1])
def test_mean_and_interval_agree_with_adaptive_quadrature(scale, flat_in, r_hat, s):
    bounds = (-0.3, 0.1)
    law = posterior(np.array([r_hat]), np.array([s]), scale, bounds, flat_in=flat_in)
    low, high = np.sort(scale.ratio(np.array(bounds)))
    centre = np.clip(r_hat, low, high)

    def density(r):
        height = np.exp(-((r - r_hat) ** 2 - (centre - r_hat) ** 2) / (2 * s**2))
        return height * (scale.steepness(np.array([r]))[0] if flat_in == "change" else 1.0)

    def integral(function, start, end):
        cuts = np.clip(centre + s * np.array([-8, -3, -1, -0.1, 0, 0.1, 1, 3, 8]), start, end)
        edges = np.unique([start, *cuts, end])
        return sum(
            integrate.quad(function, a, b, epsabs=0, epsrel=1e-10)[0]
            for a, b in itertools.pairwise(edges)
        )

    total = integral(density, low, high)
    mean = integral(lambda r: density(r) * scale.change(np.array([r]))[0], low, high) / total
    assert law.mean[0] == pytest.approx(mean, rel=1e-7, abs=1e-10)
    ends = np.sort(scale.ratio(np.array([law.lo[0], law.hi[0]])))
    assert integral(density, *ends) / total == pytest.approx(0.95, abs=1e-6)
    inside = (ends > low + 1e-9) & (ends < high - 1e-9)
    if inside.all():
        assert ends[1] - centre == pytest.approx(centre - ends[0], rel=1e-6)


@pytest.mark.parametrize("flat_in", ["frequency", "change"])
def test_an_intact_structure_that_can_only_degrade_is_covered(flat_in):
    rng = np.random.default_rng(31)
    ratio = 1 + 0.02 * rng.standard_normal(20_000)
    found = stiffness_from_frequency(ratio, 0.02, bounds=(-0.9, 0.0), flat_in=flat_in)
    assert np.mean(found.hi >= -1e-12) == pytest.approx(0.95, abs=0.006)
    assert (found.value <= 1e-15).all()


def test_over_a_prior_the_interval_covers_as_often_as_it_says():
    rng = np.random.default_rng(32)
    truth = rng.uniform(0.9, 1.0, 100_000)
    ratio = truth + 0.03 * rng.standard_normal(truth.shape)
    found = stiffness_from_frequency(ratio, 0.03, bounds=(0.9**2 - 1, 0.0))
    change = truth**2 - 1
    assert np.mean((found.lo <= change) & (change <= found.hi)) == pytest.approx(
        0.95, abs=0.003
    )


@pytest.mark.parametrize("estimate", [stiffness_from_frequency, mass_from_frequency])
def test_bounds_far_away_change_nothing_but_the_correction_of_the_mean(estimate):
    ratio = np.linspace(0.85, 1.1, 11)
    free, bound = estimate(ratio, 0.002), estimate(ratio, 0.002, bounds=(-0.8, 2.0))
    np.testing.assert_allclose(bound.lo, free.lo, atol=1e-9)
    np.testing.assert_allclose(bound.hi, free.hi, atol=1e-9)
    np.testing.assert_allclose(bound.value, free.value, atol=3 * 0.002**2 * 2)


def test_exact_data_stay_exact_within_bounds_and_stop_at_them_outside():
    found = stiffness_from_frequency(np.array([0.9, 1.1]), 0.0, bounds=(-0.9, 0.0))
    np.testing.assert_allclose(found.value, [0.81 - 1, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.sd, 0.0, atol=1e-15)
    np.testing.assert_allclose(found.lo, found.value, atol=1e-15)


def test_a_reading_that_contradicts_the_bounds_is_not_valid():
    found = stiffness_from_frequency(np.array([1.02, 1.05]), 0.01, bounds=(-0.9, 0.0))
    np.testing.assert_array_equal(
        (found.reasons & int(Reason.OUTSIDE_BOUNDS)) != 0, [False, True]
    )


def test_far_outside_the_bounds_nothing_cancels():
    law = posterior(np.array([1.2]), np.array([1e-4]), StiffnessScale(1.0), (-0.9, 0.0))
    # Beyond 2,000 sd the law is exponential, of scale s^2 / gap = 5e-8 in the ratio.
    assert law.sd[0] == pytest.approx(2 * 5e-8, rel=1e-5)
    assert -law.lo[0] == pytest.approx(2 * 5e-8 * np.log(20), rel=1e-5)
    assert law.hi[0] == 0.0


def test_averaging_bounded_means_piles_up_bias_and_unbounded_does_not():
    rng = np.random.default_rng(33)
    ratio = 1 + 0.025 * rng.standard_normal(20_000)
    law = posterior(ratio, np.full_like(ratio, 0.025), StiffnessScale(1.0), (-0.9, 0.0))
    assert law.mean.mean() == pytest.approx(-0.044, abs=0.002)
    assert abs(stiffness_from_frequency(ratio, 0.025).value.mean()) < 0.0015
