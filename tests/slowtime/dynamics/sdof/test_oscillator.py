import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from slowtime.dynamics.sdof.oscillator import (
    Oscillator,
    logarithmic_decrement,
    resonance,
)
from slowtime.dynamics.sdof.response import free_response, frequency_response


def magnitude(zeta: float, ratio: float, order: int = 0) -> float:
    osc = Oscillator(1.0, 2 * zeta, 1.0)
    response = frequency_response(osc, np.array([ratio]))[0]
    return float(ratio**order * abs(response))


@given(zeta=st.floats(0.0, 3.0), frequency=st.floats(0.01, 1e4), mass=st.floats(1e-3, 1e6))
def test_modal_and_physical_constants_say_the_same(zeta, frequency, mass):
    osc = Oscillator.from_modal(frequency, zeta, mass)
    assert osc.frequency_hz == pytest.approx(frequency, rel=1e-12)
    assert osc.damping_ratio == pytest.approx(zeta, rel=1e-12, abs=1e-15)
    assert osc.critical_damping * zeta == pytest.approx(osc.damping_n_s_per_m, rel=1e-12)


@given(zeta=st.floats(0.0, 3.0))
def test_the_poles_are_the_roots_of_the_characteristic_polynomial(zeta):
    osc = Oscillator(2.0, 4 * zeta * 3.0, 18.0)
    for pole in osc.poles:
        residue = osc.mass_kg * pole**2 + osc.damping_n_s_per_m * pole + osc.stiffness_n_per_m
        assert abs(residue) < 1e-9


def test_the_decrement_is_what_successive_peaks_show():
    osc = Oscillator.from_modal(1.0, 0.07)
    after = 2 * math.pi / osc.damped_frequency
    now, later = free_response(osc, np.array([0.0, after]), 1.0, -osc.decay_rate)[0]
    assert math.log(now / later) == pytest.approx(logarithmic_decrement(0.07), rel=1e-9)


@pytest.mark.parametrize(
    ("quantity", "order"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)]
)
@pytest.mark.parametrize("zeta", [0.01, 0.1, 0.4])
def test_each_quantity_peaks_where_it_says(quantity, order, zeta):
    found = minimize_scalar(
        lambda ratio: -magnitude(zeta, ratio, order),
        bounds=(0.3, 2.0),
        method="bounded",
        options={"xatol": 1e-10},
    )
    assert found.x == pytest.approx(resonance(zeta, quantity), abs=1e-5)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Oscillator(0.0, 1.0, 1.0), "no oscillator"),
        (lambda: Oscillator(1.0, -1.0, 1.0), "no oscillator"),
        (lambda: Oscillator(1.0, 0.0, math.nan), "no oscillator"),
        (lambda: logarithmic_decrement(2.0), "not a percentage"),
        (lambda: resonance(0.8), "no resonance peak"),
        (lambda: resonance(0.1, "jerk"), "Allowed: displacement"),
    ],
)
def test_what_cannot_be_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
