"""Decays of many laws, simulated and measured, against piecewise fits by SciPy."""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from scipy.integrate import solve_ivp

from benchmarks.methods.measured_decays import RECORDS, compared
from slowtime.identification.estimates import Identified, Measured
from slowtime.identification.free_decay.along_decay import DEPENDS, along_decay
from slowtime.identification.free_decay.amplitude_law import decay_law
from slowtime.identification.free_decay.envelope import decay_envelope

DATA = Path(os.environ.get("SLOWTIME_DATA", Path(__file__).parents[5] / "shared/data"))
RATE, HZ = 60.0, 1.3
OMEGA = 2 * np.pi * HZ


def integrated(force, seconds=45.0, start=0.5):
    """Free decay of a unit mass by SciPy, under a force of displacement and velocity."""
    t = np.arange(0, seconds, 1 / RATE)
    return solve_ivp(
        lambda _, x: [x[1], -(OMEGA**2) * x[0] - force(x[0], x[1])], (0, t[-1]), [start, 0.0],
        t_eval=t, rtol=1e-8, atol=1e-10, method="LSODA",
    ).y[0]  # fmt: skip


SOFT = 2e-3
LAWS = {
    "viscous": (lambda x, v: 0.16 * v, ("viscous",), "constant"),
    "weak viscous": (lambda x, v: 0.01 * v, ("viscous",), "constant"),
    "strong viscous": (lambda x, v: 1.2 * v, ("viscous",), "constant"),
    "friction": (lambda x, v: 0.3 * np.tanh(v / SOFT), ("dry friction",), "constant"),
    "drag": (lambda x, v: 0.2 * abs(v) * v, ("quadratic",), "constant"),
    "viscous and friction": (
        lambda x, v: 0.12 * v + 0.2 * np.tanh(v / SOFT), ("dry friction", "viscous"),
        "constant",
    ),
    "viscous and drag": (
        lambda x, v: 0.05 * v + 0.1 * abs(v) * v, ("viscous", "quadratic"), "constant",
    ),
    "hardening": (lambda x, v: 0.1 * v + 25 * x**3, ("viscous",), "hardening"),
    "softening": (lambda x, v: 0.1 * v - 25 * x**3, ("viscous",), "softening"),
    "pendulum": (lambda x, v: 0.1 * v + OMEGA**2 * (np.sin(x) - x), ("viscous",), "softening"),
    "hardening and drag": (
        lambda x, v: 0.05 * v + 0.1 * abs(v) * v + 25 * x**3, ("viscous", "quadratic"),
        "hardening",
    ),
    "softening and friction": (
        lambda x, v: 0.05 * v + 0.25 * np.tanh(v / SOFT) - 20 * x**3, ("dry friction",),
        "softening",
    ),
}  # fmt: skip


def compare(series, rate, hz, skip=0.0, cycles=3.0, *, least_share=0.9):
    """Compare the course of damping and frequency with the piecewise fit."""
    of = compared(series, rate, hz, skip, cycles)
    zeta = of["damping by SciPy"]
    assert len(zeta) >= 3
    near = np.abs(of["damping"] - zeta) < 3 * of["sd"] + 0.05 * zeta
    assert near.mean() >= least_share
    assert np.abs(of["ratio"] - 1).max() < (0.01 if cycles > 2 else 0.02)
    return decay_law(decay_envelope(series, rate))


@pytest.mark.parametrize("name", LAWS)
def test_the_course_of_a_law_is_that_of_piecewise_fits(name):
    force, terms, stiffness = LAWS[name]
    series = integrated(force)
    series = series + 1e-3 * np.random.default_rng(2).standard_normal(len(series))
    if name == "strong viscous":  # over within three cycles, before a filter is settled
        law = decay_law(decay_envelope(series, RATE))
        assert law.damping[0] == pytest.approx(1.2 / (2 * OMEGA), rel=5e-3)
    else:
        law = compare(series, RATE, HZ)
    assert set(terms) <= set(law.terms)
    assert law.stiffness == stiffness
    assert law.one_number == (terms == ("viscous",) and stiffness == "constant")


@pytest.mark.long
def test_viscous_decays_have_one_number_that_is_right():
    alone, off = [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        zeta = 10 ** rng.uniform(np.log10(6e-5), np.log10(0.3))
        rate = HZ * rng.uniform(8, 40)
        cycles = min(max(3 / (2 * np.pi * zeta), 8), 400) * rng.uniform(0.7, 1.5)
        t = np.arange(int(cycles / HZ * rate)) / rate
        moved = np.exp(-zeta * OMEGA * t) * np.cos(OMEGA * np.sqrt(1 - zeta**2) * t)
        samples = moved[:, None] * rng.uniform(-1, 1, rng.integers(1, 4))
        noise = 0.3 * 10 ** rng.uniform(-3, -1.5) * np.abs(samples).max()
        samples = samples + noise * rng.standard_normal(samples.shape)
        law = decay_law(decay_envelope(samples, rate))
        middle = len(law.damping) // 2
        alone.append(law.one_number)
        off.append((law.damping[middle] - zeta) / law.damping_sd[middle])
    assert np.mean(alone) >= 0.95
    assert np.mean(np.abs(off) < 1.96) >= 0.9


@pytest.mark.long
def test_viscous_decays_with_a_second_mode_are_hardly_ever_taken_for_another_law():
    taken = told = 0
    for seed in range(150):
        rng = np.random.default_rng([seed, 1])
        zeta, other = 10 ** rng.uniform(np.log10([6e-5, 6e-5]), np.log10([0.3, 0.1]))
        rate = HZ * rng.uniform(8, 40)
        cycles = min(max(3 / (2 * np.pi * zeta), 8), 400) * rng.uniform(0.7, 1.5)
        t = np.arange(int(cycles / HZ * rate)) / rate
        samples = np.zeros((len(t), rng.integers(1, 4)))
        beside = OMEGA * rng.choice([1.02, 1.05, 1.1, 1.3, 1.7, 2.6, 0.6])
        for w, z, size in ((OMEGA, zeta, 1.0), (beside, other, rng.uniform(0.05, 0.8))):
            moved = size * np.exp(-z * w * t) * np.cos(w * t + rng.uniform(0, 6))
            samples += moved[:, None] * rng.uniform(-1, 1, samples.shape[1])
        samples += 0.01 * np.abs(samples).max() * rng.standard_normal(samples.shape)
        try:
            law = decay_law(decay_envelope(samples, rate))
        except ValueError:
            continue
        told += 1
        taken += not (law.one_number or law.beats)
    assert told > 100
    assert taken <= 0.05 * told


def test_several_channels_tell_a_second_mode_apart():
    rng = np.random.default_rng(1)
    t = np.arange(3000) / 100.0
    first = np.exp(-0.01 * 8 * t) * np.cos(8 * t)
    second = np.exp(-0.02 * 27 * t) * np.cos(27 * t)
    samples = np.outer(first, [1.0, -0.5]) + np.outer(second, [0.4, 0.8])
    samples += 0.002 * rng.standard_normal(samples.shape)
    for omega, zeta in ((8.0, 0.01), (27.0, 0.02)):
        envelope = decay_envelope(samples, 100.0, near_hz=omega / (2 * np.pi))
        law = decay_law(envelope)
        assert law.one_number
        assert law.damping[0] == pytest.approx(zeta, abs=max(4 * law.damping_sd[0], 1e-4))


def test_a_beat_is_undecided():
    t = np.arange(4000) / 50.0
    beating = np.exp(-0.02 * t) * (np.cos(8.0 * t) + 0.4 * np.cos(8.17 * t))
    law = decay_law(decay_envelope(beating + 1e-3 * np.sin(1e4 * t), 50.0))
    assert not law.one_number


def test_two_viscous_modes_in_one_channel_are_no_law_of_damping():
    t = np.arange(1200) / 50.0
    near = np.exp(-0.1 * t) * np.cos(8.0 * t) + 0.5 * np.exp(-0.02 * t) * np.cos(8.25 * t)
    noise = 5e-3 * np.random.default_rng(6).standard_normal(len(t))
    law = decay_law(decay_envelope(near + noise, 50.0))
    assert law.beats
    assert "undecided" in law.sentence


@pytest.mark.parametrize("seed", range(3))
def test_channels_whose_ratios_change_along_a_decay_have_no_one_number(seed):
    """Two modes 2 % apart, too strongly damped for two lines: one number would be wrong."""
    rng = np.random.default_rng([seed, 1])
    t = np.arange(600) / 50.0
    one = np.exp(-0.04 * 8.0 * t) * np.cos(8.0 * t)
    other = 0.6 * np.exp(-0.003 * 8.16 * t) * np.cos(8.16 * t + 1.0)
    samples = np.outer(one, [0.9, -0.5]) + np.outer(other, [0.4, 0.3])
    samples = samples + 0.005 * rng.standard_normal(samples.shape)
    law = decay_law(decay_envelope(samples, 50.0))
    assert law.beats
    assert not law.one_number


def test_a_beat_is_no_drive_that_stops():
    """The last beat of a weakly damped decay was taken for its release."""
    rng = np.random.default_rng(3)
    t = np.arange(7200) / 25.0
    beating = np.exp(-4e-4 * 8.0 * t) * np.cos(8.0 * t)
    beating = beating + 0.55 * np.exp(-4e-4 * 8.4 * t) * np.cos(8.4 * t + 1.0)
    beating = beating + 0.01 * rng.standard_normal(len(t))
    for near_hz in (None, 8.0 / (2 * np.pi)):
        envelope = decay_envelope(beating, 25.0, near_hz=near_hz)
        assert envelope.times_s[0] < 50.0
        damping = decay_law(envelope).damping
        assert damping[len(damping) // 2] == pytest.approx(4e-4, rel=0.2)


def test_a_late_beat_is_said_to_leave_too_little():
    t = np.arange(880) / 25.0
    beating = np.cos(8.0 * t) + 0.6 * np.cos(8.16 * t + 0.85)
    for near_hz in (1.0, 1.3):
        with pytest.raises(ValueError, match=r"(has .* s, fewer than 3 cycles|windows of)"):
            decay_envelope(beating, 25.0, near_hz=near_hz)


def test_a_decay_of_few_windows_says_why_they_are_long():
    t = np.arange(700) / 25.0
    beating = np.exp(-0.04 * t) * (np.cos(8.0 * t) + 0.5 * np.cos(9.6 * t))
    beating = beating + 0.02 * np.random.default_rng(4).standard_normal(len(t))
    said = r"windows of .* cycles \(so long as to tell the mode from that at 1\.5.* Hz\)"
    with pytest.raises(ValueError, match=said):
        decay_envelope(beating, 25.0, near_hz=8.0 / (2 * np.pi))


def test_of_several_releases_the_largest_is_followed_to_the_next():
    t = np.arange(1500) / 50.0
    one = np.exp(-0.02 * 8 * t) * np.cos(8 * t)
    record = np.concatenate([0.4 * one, one, 0.5 * one])
    record = record + 1e-3 * np.random.default_rng(3).standard_normal(len(record))
    envelope = decay_envelope(record, 50.0)
    law = decay_law(envelope)
    assert 29.9 < envelope.times_s[0] < envelope.times_s[-1] < 60.5
    assert law.one_number
    assert law.damping[0] == pytest.approx(0.02, rel=5e-3)


def mode(value, zeta):
    return Identified(
        frequency_hz=Measured(value, 1e-4), damping_ratio=Measured(zeta, 1e-4), correlation=0.0,
        snr_db=None, amplitude=1.0, method="free_decay", span_s=(0.0, 1.0),
    )  # fmt: skip


def test_a_mode_is_stated_with_its_range_where_no_number_holds():
    series = integrated(LAWS["viscous and drag"][0])[:, None]
    series = series + 1e-3 * np.random.default_rng(2).standard_normal(series.shape)
    changed, law = along_decay(mode(HZ, 0.02), series, RATE)
    assert law is not None
    assert DEPENDS in changed.flags
    strong = law.damping[law.amplitude > 0.1 * law.amplitude[0]]
    told = changed.damping_ratio
    assert told.value - told.sd <= strong.min() + 1e-9
    assert told.value + told.sd >= strong.max() - 1e-9
    assert "grows with amplitude" in law.sentence
    steady, law = along_decay(
        mode(HZ, 0.16 / (2 * OMEGA)), integrated(LAWS["viscous"][0])[:, None], RATE
    )
    assert law is not None
    assert law.one_number
    assert steady.flags == ()


@pytest.mark.data
@pytest.mark.parametrize("name", RECORDS)
def test_measured_decays_are_those_of_piecewise_fits(name):
    read, *how = RECORDS[name]
    try:
        series = read(DATA)
    except OSError as error:
        pytest.skip(f"{error}; set SLOWTIME_DATA")
    law = compare(series, *how, least_share=0.75)
    if name == "aluminium beam":
        assert not law.one_number
        assert law.stiffness == "softening"
        assert law.trend == "grows with amplitude"


def driven(force, seed=1, seconds=120.0, zeta=0.01):
    """Displacement of a unit mass under a force of time, by SciPy; samples of two channels."""
    t = np.arange(0, seconds, 1 / RATE)
    loads = np.array([force(s) for s in t])
    a = np.array([[0.0, 1.0], [-(OMEGA**2), -2 * zeta * OMEGA]])
    system = (a, np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    motion = scipy.signal.lsim(system, loads, t)[1]
    both = np.outer(motion / motion.std(), [1.0, -0.5])
    return both + 0.01 * np.random.default_rng(seed).standard_normal(both.shape)


NOISE = np.random.default_rng(4).standard_normal(10_000)
EXCITED = {
    "a drive beside resonance stops": lambda t: np.cos(1.15 * OMEGA * t) * (t < 50),
    "a drive at resonance stops": lambda t: np.cos(OMEGA * t) * (t < 50),
    "random forces stop": lambda t: NOISE[int(t * RATE)] * (t < 60),
    "three blows": lambda t: 20.0 * any(at < t < at + 0.05 for at in (5, 45, 85)),
}


@pytest.mark.parametrize("name", list(EXCITED))
def test_a_decay_begins_where_its_excitation_ends(name):
    samples = driven(EXCITED[name])
    law = decay_law(decay_envelope(samples, RATE, near_hz=HZ))
    assert law.one_number
    middle = len(law.damping) // 4
    assert law.damping[middle] == pytest.approx(0.01, abs=4 * law.damping_sd[middle] + 5e-5)
    assert law.frequency_hz[middle] == pytest.approx(HZ, rel=1e-3)
