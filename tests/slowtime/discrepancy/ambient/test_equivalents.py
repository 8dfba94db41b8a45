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
