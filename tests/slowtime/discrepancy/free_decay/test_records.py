"""Free decays are told from driven motion, and end where they come to rest."""

import numpy as np
import pytest
import scipy.signal
from scipy.integrate import solve_ivp

from slowtime.discrepancy.free_decay.records import (
    is_free_decay,
    without_standstill,
    without_tones,
)
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import catalogue

RATE = 50.0


def record(series, inputs=0):
    return Trial(
        inputs=np.zeros((len(series), inputs)), outputs=np.asarray(series)[:, None],
        rate_hz=RATE,
    )  # fmt: skip


def decay(force, seconds=20.0, noise=0.0, seed=0):
    """Solve for the decay of a unit oscillator of 1 Hz under a force of its velocity."""
    stiffness = (2 * np.pi) ** 2
    t = np.arange(int(seconds * RATE)) / RATE
    found = solve_ivp(
        lambda _, x: [x[1], -stiffness * x[0] - force(x[1])], (0, t[-1]), [1.0, 0.0],
        t_eval=t, rtol=1e-8, max_step=0.01,
    ).y[0]  # fmt: skip
    return found + noise * np.random.default_rng(seed).standard_normal(len(t))


@pytest.mark.parametrize(
    "force",
    [
        lambda v: 0.05 * v,
        lambda v: 0.1 * v,
        lambda v: 0.02 * np.abs(v) * v,
        lambda v: 0.5 * np.tanh(v / 0.02),
    ],
    ids=["light viscous", "viscous", "drag", "dry friction"],
)
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_decay_under_any_damping_is_one(force, noise):
    assert is_free_decay([record(decay(force, noise=noise))])


@pytest.mark.parametrize("phase", [0.0, 0.7, 1.4])
def test_a_light_decay_of_few_samples_a_cycle_that_sways_a_little_is_one(phase):
    """A telephone on a spring: 18 samples a cycle, 9 cycles, and a slow swing beside."""
    t = np.arange(160) / 40.5
    bounce = np.exp(-0.0037 * 2 * np.pi * 2.27 * t) * np.cos(2 * np.pi * 2.27 * t + phase)
    sway = 0.02 * np.cos(2 * np.pi * 0.55 * t) + 0.008 * np.random.default_rng(7).normal(
        size=len(t)
    )
    one = Trial(inputs=np.zeros((len(t), 0)), outputs=(bounce + sway)[:, None], rate_hz=40.5)
    assert is_free_decay([one])


def test_random_response_is_no_decay():
    """Whatever its bandwidth: two hundred records of a mode under white forces."""
    taken = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        damping = 10 ** rng.uniform(-2.5, -1)
        pole = np.exp((-damping + 1j) * 2 * np.pi / RATE)
        a = [1.0, -2 * pole.real, abs(pole) ** 2]
        series = scipy.signal.lfilter([1.0], a, rng.standard_normal(3000))[1000:]
        taken += is_free_decay([record(series)])
    assert taken <= 1


def test_what_is_driven_is_no_decay():
    one = record(decay(lambda v: 0.1 * v), inputs=1)
    assert is_free_decay([one])
    driven = Trial(inputs=one.inputs + 1.0, outputs=one.outputs, rate_hz=RATE)
    assert not is_free_decay([driven])
    assert not is_free_decay([one, driven])
    assert not is_free_decay([])


def test_a_standstill_at_the_end_is_cut_off_and_nothing_else():
    moving = np.round(decay(lambda v: 0.5 * np.tanh(v / 0.02), 12.0), 3)
    still = np.concatenate([moving, np.full(400, moving[-1])])
    cut = without_standstill(record(still))
    kept = len(cut.outputs)
    np.testing.assert_array_equal(cut.outputs[:, 0], still[:kept])
    assert (still[kept - 1 :] == still[-1]).all()
    assert kept <= len(moving) + 1
    whole = record(decay(lambda v: 0.1 * v))
    assert without_standstill(whole) is whole


def test_tones_have_no_part_in_a_decay():
    kinds = catalogue()
    left = without_tones(kinds)
    assert {"harmonic_force", "parametric"} == set(kinds) - set(left)


@pytest.mark.parametrize("offset", [0.0, 0.15])
@pytest.mark.parametrize("seconds", [2.2, 3.1, 8.0])
def test_a_short_piece_of_a_light_decay_is_one_wherever_the_sensor_reads_zero(seconds, offset):
    piece = decay(lambda v: 0.05 * v, seconds, noise=0.002)
    assert is_free_decay([record(piece + offset)])


def test_few_cycles_of_a_random_response_are_seldom_a_decay():
    """Two to four cycles of a mode of 5 % damping under white forces."""
    taken = 0
    pole = np.exp((-0.05 + 1j) * 2 * np.pi / RATE)
    a = [1.0, -2 * pole.real, abs(pole) ** 2]
    for seed in range(200):
        rng = np.random.default_rng(seed)
        series = scipy.signal.lfilter([1.0], a, rng.standard_normal(3000))[1000:]
        taken += is_free_decay([record(series[: int(rng.uniform(2, 4) * RATE)])])
    assert taken <= 20


@pytest.mark.parametrize("seed", range(5))
def test_a_decay_of_beating_modes_down_to_noise_is_one(seed):
    """Accelerations of three modes after a release, of which two are close."""
    rng = np.random.default_rng(seed)
    t = np.arange(600) / RATE
    series = 1e-3 * rng.standard_normal(len(t))
    for f, zeta in ((2.0, 0.03), (2.2, 0.03), (7.0, 0.02)):
        w = 2 * np.pi * f
        series += (
            rng.uniform(0.5, 1) * np.exp(-zeta * w * t) * np.cos(w * t + rng.uniform(0, 6))
        )
    assert is_free_decay([record(series)])


def test_a_random_response_with_one_loud_beginning_is_seldom_a_decay():
    taken = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        zeta = 10 ** rng.uniform(-2.3, -1)
        pole = np.exp((-zeta + 1j) * 2 * np.pi / RATE)
        a = [1.0, -2 * pole.real, abs(pole) ** 2]
        series = scipy.signal.lfilter([1.0], a, rng.standard_normal(3000))[1000:1800]
        taken += is_free_decay([record(series)])
    assert taken <= 3


def test_a_decay_that_falls_by_less_than_its_noise_is_one():
    rng = np.random.default_rng(8)
    t = np.arange(4000) / RATE
    turned = 2 * np.pi * 11.3 * t
    falling = np.exp(-0.002 * t) * np.cos(turned) + 0.05 * rng.standard_normal(len(t))
    tone = np.cos(turned) + 0.05 * rng.standard_normal(len(t))
    assert is_free_decay([record(falling)])
    assert not is_free_decay([record(tone)])
    # The same mode under random force is driven anew within its memory.
    pole = np.exp((-0.002 + 2j * np.pi * 11.3) / RATE)
    force = rng.standard_normal(len(t)) + 1j * rng.standard_normal(len(t))
    force[0] /= np.sqrt(1 - abs(pole) ** 2)
    driven = scipy.signal.lfilter([1.0], [1.0, -pole], force).real
    assert not is_free_decay([record(driven)])
