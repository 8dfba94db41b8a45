import csv

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.response import (
    free_response,
    frequency_response,
    harmonic_response,
    impulse_response,
    step_response,
)
from slowtime.dynamics.sdof.simulation import simulate

TOLERANCE = 1e-9

# mass, natural frequency, damping ratio, start, load, time, displacement, velocity: from an
# adaptive integration to 1e-12; a few lines of the whole table, for machines without it.
KNOWN = [
    (2.0, 3.0, 0.01, 0.1, -0.2, "none", 5.0, -0.10213313421313881, -0.03625751338892747),
    (2.0, 3.0, 0.01, 0.1, -0.2, "cos2.5", 5.0, 0.19091554954220918, 0.33942791494477376),
    (2.0, 3.0, 0.01, 0.0, 0.0, "step", 5.0, 0.0915470671598844, 0.09337103331336456),
    (2.0, 3.0, 0.01, 0.0, 0.0, "pulse2", 5.0, -0.010051286466249235, 0.03053078679411317),
]

dampings = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 3.0))


def oscillator(mass: float, omega: float, zeta: float) -> Oscillator:
    return Oscillator(mass, 2 * zeta * omega * mass, omega**2 * mass)


def closed_form(osc: Oscillator, start, load: str, t: float) -> tuple[float, float]:
    when = np.array([t])
    if load == "none":
        q, v = free_response(osc, when, *start)
    elif load == "cos2.5":
        q, v = harmonic_response(osc, when, 2.5, *start)
    else:
        q, v = step_response(osc, when)
        if load == "pulse2" and t > 2.0:
            late = step_response(osc, when - 2.0)
            q, v = q - late[0], v - late[1]
    return q[0], v[0]


def stepped(osc: Oscillator, start, load: str, t: float) -> tuple[float, float]:
    """The same by exact stepping; a cosine is not piecewise constant, so it is left out."""
    rate, count = 10.0, round(t * 10.0) + 1
    force = np.zeros(count) if load == "none" else np.ones(count)
    if load == "pulse2":
        force[round(2.0 * rate) :] = 0.0
    q, v, _ = simulate(osc, force, rate, initial=start)
    return q[-1], v[-1]


def check_line(line) -> None:
    mass, omega, zeta, q0, v0, load, t, q, v = line
    osc = oscillator(mass, omega, zeta)
    assert closed_form(osc, (q0, v0), load, t) == pytest.approx((q, v), abs=TOLERANCE)
    if load != "cos2.5":
        assert stepped(osc, (q0, v0), load, t) == pytest.approx((q, v), abs=TOLERANCE)


@pytest.mark.parametrize("line", KNOWN)
def test_known_responses_come_out_of_closed_form_and_of_stepping(line):
    check_line(line)


@pytest.mark.data
def test_the_whole_reference_table_comes_out_to_1e_9(tables):
    with (tables / "T4_sdof_responses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 196
    numbers = ("m", "wn", "zeta", "q0", "v0")
    for row in rows:
        values = [float(row[name]) for name in numbers]
        check_line((*values, row["force"], *(float(row[n]) for n in ("t", "q_ode", "v_ode"))))


@given(zeta=dampings, omega=st.floats(0.1, 50.0), t=st.floats(0.0, 5.0))
def test_free_motion_is_the_matrix_exponential(zeta, omega, t):
    osc = oscillator(1.5, omega, zeta)
    matrix = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
    expected = scipy.linalg.expm(matrix * t) @ (0.3, -0.7)
    got = np.array(free_response(osc, np.array([t]), 0.3, -0.7))[:, 0]
    np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-9 * max(omega, 1.0))


@given(zeta=dampings, t=st.floats(0.01, 20.0))
def test_the_impulse_response_is_free_motion_after_a_unit_of_momentum(zeta, t):
    osc = oscillator(2.0, 3.0, zeta)
    expected = free_response(osc, np.array([t]), 0.0, 1.0 / osc.mass_kg)[0]
    np.testing.assert_allclose(impulse_response(osc, np.array([t])), expected, rtol=1e-12)


def test_nothing_moves_before_the_impulse():
    assert impulse_response(oscillator(1.0, 2.0, 0.1), np.array([-1.0, 0.0])).tolist() == [0, 0]


def test_strong_damping_over_a_long_time_does_not_overflow():
    q, v = free_response(oscillator(1.0, 10.0, 50.0), np.array([0.0, 1.0, 1e4]), 1.0, 0.0)
    assert np.isfinite(q).all()
    assert np.isfinite(v).all()
    assert (np.diff(q) < 0).all()


@settings(max_examples=30)  # of smooth laws of two numbers
@given(zeta=st.floats(0.01, 2.0), omega=st.floats(0.5, 20.0))
def test_the_frequency_response_is_the_transform_of_the_impulse_response(zeta, omega):
    osc = oscillator(1.0, 4.0, zeta)
    times = np.linspace(0.0, 60.0 / -osc.poles[0].real, 400_001)
    product = impulse_response(osc, times) * np.exp(-1j * omega * times)
    assert np.trapezoid(product, times) == pytest.approx(
        frequency_response(osc, np.array([omega]))[0], rel=1e-3, abs=1e-6
    )


def test_before_the_release_nothing_is_known():
    with pytest.raises(ValueError, match="before the release"):
        free_response(oscillator(1.0, 2.0, 0.1), np.array([-0.1]), 1.0, 0.0)


def test_an_undamped_resonance_has_no_steady_state():
    with pytest.raises(ValueError, match="no steady state"):
        harmonic_response(oscillator(1.0, 2.0, 0.0), np.array([1.0]), 2.0)
