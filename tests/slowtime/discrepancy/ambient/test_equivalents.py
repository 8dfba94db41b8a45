"""Equivalents of laws under normal motion, against their closed forms."""

import numpy as np
import pytest

from slowtime.discrepancy.ambient.equivalents import ElementMotion
from slowtime.dynamics.effects import Motion, catalogue

SIZE, HZ = 2e-3, 3.0


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(3)
    rate, count = 200.0, 2**16
    hz = np.fft.rfftfreq(count, 1 / rate)
    drawn = rng.standard_normal((2, len(hz)))
    lines = np.exp(-(((hz - HZ) / 0.5) ** 2)) * (drawn[0] + 1j * drawn[1])
    e = np.fft.irfft(lines, count)
    lines *= SIZE / e.std()
    s = 2j * np.pi * hz
    e, v, a = (np.fft.irfft(lines * s**n, count) for n in range(3))
    return Motion(e=e, v=v, a=a, times=np.arange(count) / rate)


@pytest.mark.parametrize(
    ("kind", "parameter", "stiffness", "damping"),
    [
        ("cubic_hardening", {"k3_n_per_m3": 1e6}, lambda e, v: 3e6 * e**2, lambda e, v: 0.0),
        ("coulomb", {"friction_n": 0.2}, lambda e, v: 0.0,
         lambda e, v: 0.2 * np.sqrt(2 / np.pi) / v),
        ("quadratic_damping", {"c2_n_s2_per_m2": 50.0}, lambda e, v: 0.0,
         lambda e, v: 50 * np.sqrt(8 / np.pi) * v),
        ("stiffness_loss", {"dk_n_per_m": 30.0}, lambda e, v: -30.0, lambda e, v: 0.0),
    ],
)  # fmt: skip
def test_equivalents_are_those_of_statistical_linearisation(
    motion, kind, parameter, stiffness, damping
):
    e, v = motion.e.std(), motion.v.std()
    k, c = ElementMotion(motion, 0.0).equivalents(catalogue()[kind], parameter)
    # Averages over some 600 independent periods.
    assert k == pytest.approx(stiffness(e, v), rel=0.05, abs=0.02 * max(abs(k), abs(c) * v / e))
    assert c == pytest.approx(damping(e, v), rel=0.05, abs=0.02 * max(abs(c), abs(k) * e / v))


def test_a_law_that_is_not_odd_is_linearised_about_its_mean_elongation(motion):
    kind = catalogue()["quadratic_stiffness"]
    e = motion.e.std()
    k2, compliance = 1e4, 0.02
    k, _ = ElementMotion(motion, compliance).equivalents(kind, {"k2_n_per_m2": k2})
    # Equilibrium: m + h k2 (e^2 + m^2) = 0; equivalent stiffness 2 k2 m.
    m = (-1 + np.sqrt(1 - 4 * (compliance * k2) ** 2 * e**2)) / (2 * compliance * k2)
    assert k == pytest.approx(2 * k2 * m, rel=0.2)
    assert k < 0


@pytest.mark.parametrize(
    ("kind", "parameters", "share"),
    [
        ("stiffness_loss", {"dk_n_per_m": 30.0}, 0.0),
        ("cubic_hardening", {"k3_n_per_m3": 1e6}, np.sqrt((15 - 9) / 9)),
        ("quadratic_damping", {"c2_n_s2_per_m2": 50.0}, np.sqrt(3 * np.pi / 8 - 1)),
    ],
)
def test_what_is_not_linear_in_a_force_is_that_of_a_normal_motion(
    motion, kind, parameters, share
):
    found, varied = ElementMotion(motion, 0.0).nonlinear(catalogue()[kind], parameters)
    assert found == pytest.approx(share, rel=0.05, abs=1e-9)
    assert (max(varied) < 1e-20) == (share == 0.0)


def test_a_gap_that_is_seldom_met_has_another_stiffness_in_each_record(motion):
    """As it has over 32 parts of a long motion, each a record of its own."""
    kind, count = catalogue()["gap_symmetric"], 32
    parameters = {"kg_n_per_m": 1e4, "gap_m": 2.0 * SIZE}
    long = ElementMotion(motion, 0.0, records=float(count))
    _, (varied, _) = long.nonlinear(kind, parameters)
    force = 1e4 * np.sign(motion.e) * np.maximum(np.abs(motion.e) - 2.0 * SIZE, 0.0)
    parts = np.split(force * motion.e, count), np.split(motion.e**2, count)
    each = [f.sum() / s.sum() for f, s in zip(*parts, strict=True)]
    assert np.sqrt(varied) == pytest.approx(np.std(each), rel=0.4)
    assert np.std(each) > 0.3 * np.mean(each)
