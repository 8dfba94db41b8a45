"""Laws of damping of decays that are integrated, and of measured ones."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.identification.free_decay.amplitude_law import decay_law
from slowtime.identification.free_decay.envelope import decay_envelope

DATA = Path(os.environ.get("SLOWTIME_DATA", Path(__file__).parents[5] / "shared/data"))
RATE, OMEGA = 50.0, 2 * np.pi * 1.1
T = np.arange(0, 40, 1 / RATE)


def decay(viscous=0.0, friction=0.0, drag=0.0, start=0.5, noise=1e-3, seed=0):
    """Free decay by scipy; friction is smooth over a thousandth of the first speed."""
    soft = 1e-3 * start * OMEGA

    def rates(t, x):
        slow = friction * np.tanh(x[1] / soft) + drag * abs(x[1]) * x[1]
        return [x[1], -(OMEGA**2) * x[0] - 2 * viscous * OMEGA * x[1] - slow]

    told = solve_ivp(
        rates, (0, T[-1]), [start, 0], t_eval=T, rtol=1e-8, atol=1e-10, method="LSODA"
    )
    return told.y[0] + noise * np.random.default_rng(seed).standard_normal(len(T))


@pytest.mark.parametrize(
    ("given", "terms", "coefficient", "value"),
    [
        ({"viscous": 0.01}, ("viscous",), 1, np.pi * 0.01),
        ({"friction": 0.25}, ("dry friction",), 0, 2 * 0.25 / OMEGA**2),
        ({"viscous": 0.004, "drag": 0.1}, ("viscous", "quadratic"), 2, 4 * 0.1 / 3),
        ({"viscous": 0.01, "friction": 0.2}, ("dry friction", "viscous"), 0, 0.4 / OMEGA**2),
    ],
    ids=["viscous", "friction", "viscous and drag", "friction and viscous"],
)
def test_the_law_of_a_decay_is_told_with_its_size(given, terms, coefficient, value):
    found = decay_law(decay_envelope(decay(**given), RATE))
    assert found.terms == terms
    sd = found.coefficients_sd[coefficient]
    assert found.coefficients[coefficient] == pytest.approx(
        value, abs=max(4 * sd, 0.03 * value)
    )
    middle = len(found.frequency_hz) // 2
    assert found.frequency_hz[middle] == pytest.approx(1.1, rel=5e-3)


def test_dry_friction_makes_the_damping_ratio_rise_as_one_over_the_amplitude():
    found = decay_law(decay_envelope(decay(friction=0.25), RATE))
    fall = found.damping / np.sqrt(1 - found.damping**2)  # of the logarithm, over pi
    product = fall * found.amplitude
    np.testing.assert_allclose(product, product[0], rtol=1e-12)
    assert found.trend == "falls with amplitude"


@pytest.mark.long
def test_errors_of_a_coefficient_are_as_told():
    off = []
    for seed in range(25):
        found = decay_law(decay_envelope(decay(viscous=0.01, noise=5e-3, seed=seed), RATE))
        off.append((found.coefficients[1] - np.pi * 0.01) / found.coefficients_sd[1])
    assert 0.5 < np.std(off) < 1.6
    assert abs(np.mean(off)) < 1.0


def test_what_came_before_the_release_does_not_count():
    before = np.concatenate([np.linspace(0, 0.5, 200), np.full(100, 0.5)])
    whole = np.concatenate([before, decay(viscous=0.01)])
    found = decay_law(decay_envelope(whole, RATE))
    assert found.terms == ("viscous",)
    assert found.coefficients[1] == pytest.approx(np.pi * 0.01, rel=0.02)


def test_too_short_a_decay_is_refused():
    with pytest.raises(ValueError, match="fewer than 6: too few"):
        decay_envelope(decay(viscous=0.01)[:100], RATE)


def column(path, name):
    if not path.is_file():
        pytest.skip(f"no measurements at {path}; set SLOWTIME_DATA")
    return np.genfromtxt(path, delimiter=",", names=True)[name]


@pytest.mark.data
def test_damping_of_a_rolling_ship_grows_over_a_linear_floor():
    roll = np.degrees(column(DATA / "ship_roll/model_test_21337.csv", "phi"))
    found = decay_law(decay_envelope(roll, 100.0))
    assert "quadratic" in found.terms
    assert found.trend == "grows with amplitude"
    for amplitude, zeta in ((8.5, 0.0080), (5.0, 0.0049), (3.9, 0.0044)):
        near = float(np.interp(-amplitude, -found.amplitude, found.damping))
        assert near == pytest.approx(zeta, abs=7e-4)


@pytest.mark.data
@pytest.mark.parametrize("number", [2, 5, 8, 9, 10])
def test_a_disc_without_magnet_is_stopped_by_dry_friction(number):
    folder = DATA / "torsion_disc"
    angle = column(folder / f"free_no_magnet_{number}.csv", "disc_angle_rad")
    found = decay_law(decay_envelope(angle, 20.0))
    assert found.terms[0] == "dry friction"
    assert found.trend == "falls with amplitude"
    assert found.coefficients[0] == pytest.approx(0.213, abs=0.045)
    sd = found.frequency_sd_hz[0]
    assert found.frequency_hz[0] == pytest.approx(0.714, abs=0.012 + 2 * sd)
