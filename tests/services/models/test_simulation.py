import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slowtime.dynamics.builders import beam, chain
from slowtime.dynamics.description import Input, Sensor, assemble
from slowtime_services.models import ambient_model, run_model
from slowtime_services.models.simulation import base_motion
from tests.slowtime.dynamics.random_vibration import response_covariance

RATE = 50.0
T = np.arange(200) / RATE
PUSH = np.sin(5.0 * T) + 0.3 * np.cos(17.0 * T)


def listening(description, inputs, **sensors):
    heard = tuple(
        Sensor(channel=channel, quantity=quantity, node=node, frame=frame, unit=unit)
        for channel, (quantity, node, frame, unit) in sensors.items()
    )
    return dataclasses.replace(description, inputs=inputs, sensors=heard)


PAIR = chain([2.0, 1.0], [300.0, 200.0], dampings_n_s_per_m=[3.0, 0.5])
SHAKEN = listening(
    PAIR,
    (Input(channel="ab", kind="base_acceleration", unit="g"),),
    a2=("acceleration", "m2", "absolute", "g"),
    x1=("displacement", "m1", "relative_to_base", "mm"),
    y1=("displacement", "m1", "absolute", "m"),
    v2=("velocity", "m2", "absolute", "m/s"),
    ground=("acceleration", "base", "absolute", "m/s^2"),
    still=("displacement", "base", "relative_to_base", "m"),
)


def test_a_shaken_model_is_the_integral_of_its_equation_in_space():
    """Integrated with absolute coordinates and a base that moves: no relative ones anywhere."""
    g = 9.80665
    k = np.array([[500.0, -200.0], [-200.0, 200.0]])
    c = np.array([[3.5, -0.5], [-0.5, 0.5]])

    def motion(t, state):
        y, base, w, speed = state[:2], state[2], state[3:5], state[5]
        pull = np.array([300.0 * base + 3.0 * speed, 0.0]) - k @ y - c @ w
        return [*w, speed, *(pull / [2.0, 1.0]), g * np.interp(t, T, PUSH)]

    truth = solve_ivp(
        motion, (0, T[-1]), np.zeros(6), t_eval=T, rtol=1e-10, atol=1e-12, max_step=1 / RATE
    ).y
    found = run_model(SHAKEN, {"ab": PUSH}, RATE)
    np.testing.assert_allclose(found["y1"], truth[0], atol=1e-6)
    np.testing.assert_allclose(found["x1"], 1e3 * (truth[0] - truth[2]), atol=1e-3)
    np.testing.assert_allclose(found["v2"], truth[4], atol=1e-5)
    pull = -(k @ truth[:2] + c @ truth[3:5])[1]
    np.testing.assert_allclose(found["a2"], pull / g, atol=1e-5)
    np.testing.assert_allclose(found["ground"], g * PUSH)
    assert not found["still"].any()


def test_forces_on_two_nodes_add_up_in_their_own_units():
    def pushed(*inputs):
        return listening(PAIR, inputs, x2=("displacement", "m2", "absolute", "m"))

    one, two = (
        Input(channel="f", kind="force", node="m1", unit="N"),
        Input(channel="g", kind="force", node="m2", unit="kN"),
    )
    record = {"f": PUSH, "g": 2e-3 * PUSH[::-1], "unused": PUSH}
    both = run_model(pushed(one, two), record, RATE)["x2"]
    alone = [run_model(pushed(entry), record, RATE)["x2"] for entry in (one, two)]
    np.testing.assert_allclose(both, sum(alone), atol=1e-12)
    assert np.abs(alone[0]).max() > 1e-3


def test_a_pin_moves_with_the_base_and_takes_a_force_without_moving():
    description = listening(
        beam(1.0, 10.0, 1.0, elements=3, supports="simply supported", damping_s=1e-3),
        (
            Input(channel="ab", kind="base_acceleration", unit="m/s^2"),
            Input(channel="f", kind="force", node="n0", unit="N"),
        ),
        pin=("acceleration", "n0", "absolute", "m/s^2"),
        middle=("displacement", "n1", "relative_to_base", "m"),
    )
    found = run_model(description, {"ab": PUSH, "f": 0 * PUSH}, RATE)
    pushed = run_model(description, {"ab": PUSH, "f": 100 * PUSH}, RATE)
    np.testing.assert_allclose(found["pin"], PUSH)
    np.testing.assert_array_equal(found["middle"], pushed["middle"])


@pytest.mark.parametrize(("hold", "end"), [("zero", 0.5), ("first", 0.5)])
def test_a_base_that_accelerates_evenly_moves_by_half_its_square(hold, end):
    displacement, velocity, _ = base_motion(np.ones(51), RATE, hold)
    np.testing.assert_allclose(displacement, 0.5 * (np.arange(51) / RATE) ** 2, atol=1e-14)
    np.testing.assert_allclose(velocity, np.arange(51) / RATE, atol=1e-14)
    assert displacement[-1] == pytest.approx(end)


def test_a_base_that_ramps_moves_by_a_sixth_of_its_cube():
    t = np.arange(51) / RATE
    displacement, velocity, _ = base_motion(6 * t, RATE)
    np.testing.assert_allclose(displacement, t**3, atol=1e-13)
    np.testing.assert_allclose(velocity, 3 * t**2, atol=1e-13)


def test_an_ambient_model_hears_one_set_of_forces_in_every_way():
    description = listening(
        PAIR,
        (),
        x2=("displacement", "m2", "absolute", "mm"),
        v2=("velocity", "m2", "absolute", "m/s"),
        a2=("acceleration", "m2", "absolute", "m/s^2"),
    )
    found = ambient_model(description, 40_000, 40.0, seed=3, force_psd=4.0)
    truth = response_covariance(assemble(PAIR), 4.0)
    assert np.var(1e-3 * found["x2"]) == pytest.approx(truth.displacement[1, 1], rel=0.12)
    assert np.var(found["v2"]) == pytest.approx(truth.velocity[1, 1], rel=0.12)
    # Differentiated over the record, each is the next.
    rate = np.gradient(1e-3 * found["x2"], 1 / 40.0)
    assert np.corrcoef(rate, found["v2"])[0, 1] > 0.99
    again = ambient_model(description, 40_000, 40.0, seed=3, force_psd=4.0)
    np.testing.assert_array_equal(found["a2"], again["a2"])


def test_what_cannot_be_run_is_refused():
    with pytest.raises(ValueError, match=r"no channel called ab; it has u\. Name"):
        run_model(SHAKEN, {"u": PUSH}, RATE)
    with pytest.raises(ValueError, match="under unmeasured ambient forces"):
        run_model(dataclasses.replace(SHAKEN, inputs=()), {"ab": PUSH}, RATE)
    shaking = dataclasses.replace(
        SHAKEN, effects=({"effect": "base_motion", "rms_m_per_s2": 0.1},)
    )
    with pytest.raises(
        ValueError, match=r"unmeasured motion of the base, which is random\. Give a seed"
    ):
        run_model(shaking, {"ab": PUSH}, RATE)
    singing = {"effect": "viscous_damping", "element": "k1", "dc_n_s_per_m": -900.0}
    with pytest.raises(ValueError, match=r"grows beyond bounds after .* s: the model is"):
        run_model(dataclasses.replace(SHAKEN, effects=(singing,)), {"ab": PUSH}, RATE)


def test_motion_of_the_base_that_nobody_measured_has_its_size_and_its_seed():
    shaking = dataclasses.replace(
        SHAKEN, effects=({"effect": "base_motion", "rms_m_per_s2": 0.1 * 9.80665},)
    )
    still = {"ab": np.zeros(4000)}
    once, again, other = (
        run_model(shaking, still, RATE, rng=np.random.default_rng(seed))["ground"]
        for seed in (1, 1, 2)
    )
    assert np.std(once) == pytest.approx(0.980665, rel=0.05)
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other)


def test_an_ambient_model_with_an_effect_is_stationary_and_that_of_its_linear_twin():
    """Stiffness lost as an effect, run in time; and taken from the element, made of lines."""
    heard = listening(PAIR, (), x2=("displacement", "m2", "absolute", "m"))
    lost = {"effect": "stiffness_loss", "element": "k2", "dk_n_per_m": 50.0}
    effected = dataclasses.replace(heard, effects=(lost,))
    found = ambient_model(effected, 20_000, 40.0, seed=3, force_psd=4.0)["x2"]
    softer = chain([2.0, 1.0], [300.0, 150.0], dampings_n_s_per_m=[3.0, 0.5])
    truth = response_covariance(assemble(softer), 4.0).displacement[1, 1]
    assert np.var(found) == pytest.approx(truth, rel=0.15)
    assert np.var(found[:10_000]) == pytest.approx(truth, rel=0.3)
    again = ambient_model(effected, 20_000, 40.0, seed=3, force_psd=4.0)["x2"]
    np.testing.assert_array_equal(found, again)
