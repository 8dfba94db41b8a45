"""Laws that contain simple ones: their differential equations, and what they become."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.dynamics.effects import Motion, catalogue, force_along, general_kinds

RATE = 2000.0
T = np.arange(8000) / RATE


def place(t):
    return 2e-3 * np.sin(7.0 * t) + 1e-3 * np.sin(19.0 * t)


def speed(t):
    return 14e-3 * np.cos(7.0 * t) + 19e-3 * np.cos(19.0 * t)


SEEN = Motion(
    e=place(T), v=speed(T), a=-98e-3 * np.sin(7.0 * T) - 361e-3 * np.sin(19.0 * T), times=T
)
KINDS = catalogue()


def force(name, **parameters):
    return force_along(KINDS[name], parameters, SEEN)


def memory(rate, states=1):
    """Integrate internal states by a solver of another kind, with steps of its own."""
    return solve_ivp(
        rate, (0, T[-1]), np.zeros(states), t_eval=T, rtol=1e-8, atol=1e-12, max_step=2e-4
    ).y


def close(found, truth, share):
    return float(np.abs(found - truth).max()) < share * float(np.abs(truth).max())


@pytest.mark.parametrize(("beta", "gamma"), [(800.0, -1100.0), (500.0, 300.0), (-200.0, 900.0)])
def test_general_hysteresis_takes_shape_factors_of_either_sign(beta, gamma):
    found = force(
        "bouc_wen_general", kh_n_per_m=5e4, beta_per_mn=beta, gamma_per_mn=gamma, n=1.0
    )
    (z,) = memory(
        lambda t, z: speed(t) - beta * np.abs(speed(t)) * z - gamma * speed(t) * np.abs(z)
    )
    assert close(found, 5e4 * (z - SEEN.e), 2e-3)


def test_hysteresis_of_one_sign_is_the_general_one_with_equal_factors():
    simple = force("bouc_wen", kh_n_per_m=900.0, zy_m=1e-3, n=1.0)
    general = force(
        "bouc_wen_general", kh_n_per_m=900.0, beta_per_mn=500.0, gamma_per_mn=500.0, n=1.0
    )
    assert close(general, simple, 1e-6)


def test_a_link_that_yields_is_hysteresis_with_the_line_that_the_model_lacks():
    known = {"kh_n_per_m": 900.0, "zy_m": 1e-3, "n": 2.0}
    whole = force("bouc_wen", **known) + 900.0 * SEEN.e
    assert close(force("yielding_link", **known), whole, 1e-9)
    assert (KINDS["yielding_link"].joins, KINDS["bouc_wen"].joins) == (True, False)


def test_hysteresis_that_does_not_wear_and_is_not_slack_is_the_simple_one():
    simple = force("bouc_wen", kh_n_per_m=900.0, zy_m=1e-3, n=2.0)
    known = {"kh_n_per_m": 900.0, "zy_m": 1e-3, "n": 2.0}
    assert close(force("bouc_wen_degrading", **known, wear=0.0), simple, 1e-9)
    assert close(force("bouc_wen_pinching", **known, slackness=0.0, width=0.5), simple, 1e-9)


def test_wear_follows_the_energy_that_was_dissipated():
    found = force("bouc_wen_degrading", kh_n_per_m=900.0, zy_m=1e-3, n=1.0, wear=0.05)

    def rate(t, state):
        z, path = state
        v = speed(t)
        yielding = v * (1 - abs(z / 1e-3) * (1 + np.sign(v * z)) / 2)
        return [yielding / (1 + 0.05 * path), max(z * v, 0.0) / 1e-6]

    z, path = memory(rate, 2)
    assert path[-1] > 10
    assert close(found, 900.0 * (z - SEEN.e), 5e-3)


@pytest.mark.parametrize(
    ("name", "path"), [("dahl", 3e-5), ("friction_in_series_with_spring", 1e-4)]
)
def test_friction_over_a_short_path_is_dry_friction(name, path):
    """Of the slider in series, that is six samples of the motion: it takes no finer steps."""
    found = force(name, friction_n=4.0, presliding_m=path)
    assert np.mean(np.abs(found - 4.0 * np.sign(SEEN.v)) < 0.1) > 0.7


def test_dahl_friction_follows_its_differential_equation():
    found = force("dahl", friction_n=4.0, presliding_m=5e-4)
    (w,) = memory(lambda t, w: (speed(t) - np.abs(speed(t)) * w) / 5e-4)
    assert close(found, 4.0 * w, 1e-3)


def test_a_slider_in_series_with_a_spring_is_carried_until_it_slides():
    found = force("friction_in_series_with_spring", friction_n=4.0, presliding_m=5e-4)
    z = 0.0
    truth = [0.0]
    for step in np.diff(SEEN.e):  # elastic, perfectly plastic, by the increments of the motion
        z = min(max(z + step, -5e-4), 5e-4)
        truth.append(4.0 * z / 5e-4)
    assert np.abs(found - np.array(truth)).max() < 0.1


def test_play_leaves_friction_out_until_it_is_crossed():
    found = force("friction_with_play", friction_n=4.0, play_m=3e-4, presliding_m=2e-4)
    z = 0.0
    truth = [0.0]
    for step in np.diff(SEEN.e):
        z = min(max(z + step, -5e-4), 5e-4)
        truth.append(4.0 * np.sign(z) * max(abs(z) - 3e-4, 0.0) / 2e-4)
    assert np.abs(found - np.array(truth)).max() < 0.2
    assert np.mean(found == 0) > 0.01
    none = force("friction_with_play", friction_n=4.0, play_m=0.0, presliding_m=5e-4)
    series = force("friction_in_series_with_spring", friction_n=4.0, presliding_m=5e-4)
    assert close(none, series, 1e-3)


def test_lugre_friction_slides_as_stribeck_does():
    found = force(
        "lugre", friction_n=4.0, static_n=6.0, vs_m_per_s=0.01, presliding_m=3e-5,
        bristle_damping_n_s_per_m=0.0,
    )  # fmt: skip
    truth = force("stribeck", friction_n=4.0, static_n=6.0, vs_m_per_s=0.01)
    assert np.mean(np.abs(found - truth) < 0.3) > 0.7


def test_bristles_are_damped_by_the_rate_of_their_deflection():
    found = force(
        "lugre", friction_n=4.0, static_n=4.0, vs_m_per_s=0.01, presliding_m=5e-4,
        bristle_damping_n_s_per_m=30.0,
    )  # fmt: skip
    (w,) = memory(lambda t, w: (speed(t) - np.abs(speed(t)) * w) / 5e-4)
    assert close(found, 4.0 * w + 30.0 * (SEEN.v - np.abs(SEEN.v) * w), 1e-3)


def test_friction_with_drag_is_the_sum_of_both():
    found = force("friction_with_drag", friction_n=4.0, c2_n_s2_per_m2=900.0)
    truth = force("coulomb", friction_n=4.0) + force("quadratic_damping", c2_n_s2_per_m2=900.0)
    np.testing.assert_allclose(found, truth, rtol=1e-12)


@pytest.mark.parametrize(
    ("power", "simple", "parameters"),
    [
        (1.0, "viscous_damping", {"dc_n_s_per_m": 100.0}),
        (2.0, "quadratic_damping", {"c2_n_s2_per_m2": 5e3}),
        (3.0, "cubic_damping", {"c3_n_s3_per_m3": 2.5e5}),
    ],
)
def test_a_power_of_speed_is_the_damping_of_that_power(power, simple, parameters):
    found = force("power_law_damping", force_n=2.0, v0_m_per_s=0.02, power=power)
    np.testing.assert_allclose(found, force(simple, **parameters), rtol=1e-9, atol=1e-12)


def test_damping_by_elongation_and_by_speed():
    e, v = SEEN.e, SEEN.v
    np.testing.assert_allclose(force("positional_damping", c2_n_s_per_m3=3e6), 3e6 * e**2 * v)
    np.testing.assert_allclose(
        force("rayleigh_damping", cn_n_s_per_m=3.0, v0_m_per_s=0.01),
        3.0 * ((v / 0.01) ** 2 - 1) * v,
    )


def test_stiffness_of_two_degrees_and_of_two_knees():
    e = SEEN.e
    found = force("quintic_stiffness", k3_n=3.0, k5_n=-1.0, e0_m=2e-3)
    np.testing.assert_allclose(found, 3.0 * (e / 2e-3) ** 3 - (e / 2e-3) ** 5, atol=1e-12)
    knees = {"kg_n_per_m": 800.0, "gap_m": 1e-3, "gap2_m": 5e-4}
    found = force("stiffness_two_knees", **knees, kg2_n_per_m=0.0)
    np.testing.assert_allclose(found, force("gap_symmetric", kg_n_per_m=800.0, gap_m=1e-3))
    second = force("stiffness_two_knees", **knees, kg2_n_per_m=400.0) - found
    np.testing.assert_allclose(
        second, force("gap_symmetric", kg_n_per_m=400.0, gap_m=1.5e-3), atol=1e-12
    )


def test_an_impact_loses_energy_and_never_pulls():
    known = {"kc_n_per_m15": 1e5, "gap_m": 1e-3, "side": 1.0}
    elastic = force("impact", **known, damping_s_per_m=0.0)
    np.testing.assert_allclose(elastic, 1e5 * np.maximum(SEEN.e - 1e-3, 0) ** 1.5, atol=1e-9)
    damped = force("impact", **known, damping_s_per_m=20.0)
    assert damped.min() >= 0
    assert np.trapezoid(damped * SEEN.v, T) > 0.01 * np.trapezoid(damped * np.abs(SEEN.v), T)


def test_a_spring_in_series_with_a_damper_relaxes():
    found = force("maxwell", km_n_per_m=900.0, relaxation_s=0.05)
    (z,) = memory(lambda t, z: speed(t) - z / 0.05)
    assert close(found, 900.0 * z, 1e-4)


@pytest.mark.parametrize("order", [0.3, 0.5, 0.7])
def test_damping_of_fractional_order_rises_with_that_power_of_frequency(order):
    """By the frequency response of the branches, in the decade about the centre."""
    sizes = []
    for hertz in (0.5, 5.0):
        turn = 2 * np.pi * hertz
        t = np.arange(int(20 * RATE / hertz)) / RATE
        seen = Motion(
            e=np.sin(turn * t), v=turn * np.cos(turn * t), a=-(turn**2) * np.sin(turn * t),
            times=t,
        )  # fmt: skip
        whole = force_along(
            KINDS["fractional_damping"],
            {"kf_n_per_m": 1.0, "order": order, "centre_hz": 1.58},
            seen,
        )
        last = t > t[-1] / 2
        both = np.stack([np.sin(turn * t[last]), np.cos(turn * t[last])], axis=1)
        sizes.append(np.hypot(*np.linalg.lstsq(both, whole[last], rcond=None)[0]))
    assert np.log10(sizes[1] / sizes[0]) == pytest.approx(order, abs=0.12)


def test_every_general_law_names_laws_that_exist_and_share_its_place():
    for kind in general_kinds(KINDS):
        for name in kind.simpler:
            assert KINDS[name].where == kind.where
        assert kind.name not in kind.simpler
        assert not set(kind.contains) & set(kind.similar)
        assert kind.source
