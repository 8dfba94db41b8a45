"""Distortion of static nonlinearities with known harmonics, of known noise, of Duffing."""

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.signal as sps
import scipy.stats
from scipy.integrate import solve_ivp

from slowtime.identification.nonlinear_distortion import (
    distortion_of,
    find_period,
    fit_resonance,
    realisation_of,
    sort_by_level,
)

DATA = Path(os.environ.get("SLOWTIME_DATA", Path(__file__).parents[5] / "shared/data"))
N, RATE = 1024, 512.0
ODD = np.arange(1, 300, 2)
ODD_RANDOM = np.array([line for i, line in enumerate(ODD) if i % 4 != 3])
"""Every fourth odd line is left out, to detect odd distortion."""


def multisine(lines, seed, rms=1.0, count=N):
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    spectrum[lines] = np.exp(1j * phases)
    wave = np.fft.irfft(spectrum, count)
    return rms * wave / wave.std()


def steady(wave, zeta=0.03, hertz=50.0):
    """Periodic response of an oscillator, exactly."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(wave), 1 / RATE)
    natural = 2 * np.pi * hertz
    gain = natural**2 / (natural**2 - omega**2 + 2j * zeta * natural * omega)
    return np.fft.irfft(np.fft.rfft(wave) * gain, len(wave))


def measured(lines, law, realisations=6, periods=4, noise=0.0, rms=1.0):
    rng = np.random.default_rng(99)
    found = []
    for seed in range(realisations):
        wave = multisine(lines, seed, rms)
        told = np.tile(law(wave), periods)
        told = told + noise * rng.standard_normal(len(told))
        found.append(realisation_of(np.tile(wave, periods), told, RATE, N))
    return found


@pytest.mark.parametrize(
    ("law", "symmetry"),
    [
        (steady, "none"),
        (lambda u: steady(u) + 0.02 * steady(u) ** 3, "odd"),
        (lambda u: steady(u) + 0.02 * u**2, "even"),
        (lambda u: steady(u) + 0.02 * u**2 + 0.02 * u**3, "odd and even"),
    ],
    ids=["linear", "cubic", "quadratic", "both"],
)
def test_symmetry_is_told_by_the_lines_that_were_left_out(law, symmetry):
    found = distortion_of(measured(ODD_RANDOM, law, noise=0.01))
    assert found.symmetry == symmetry
    assert found.odd is not None
    assert found.even is not None
    assert (found.odd.p_value < 1e-3) == ("odd" in symmetry)
    assert (found.even.p_value < 1e-3) == ("even" in symmetry)
    # Even distortion of an odd input falls on even lines, and leaves the others alone.
    assert (found.p_value < 1e-3) == ("odd" in symmetry)


def test_two_tones_through_a_square_are_read_at_their_sum_and_difference():
    """a (cos x + cos y)^2 = a (1 + cos(2x)/2 + cos(2y)/2 + cos(x+y) + cos(x-y))."""
    t = 2 * np.pi * np.arange(N) / N
    wave = np.cos(11 * t) + np.cos(31 * t)
    one = realisation_of(wave, wave + 0.1 * wave**2, RATE, N)
    size = 2 * np.abs(one.output[0])
    np.testing.assert_allclose(size[[20, 22, 42, 62]], [0.1, 0.05, 0.1, 0.05], atol=1e-12)
    found = distortion_of([one])
    assert found.even is not None
    power = 2 * 0.1**2 + 0.05**2  # those between the excited lines and up to the last
    assert found.even.amplitude**2 * found.even.lines == pytest.approx(0.1**2 + 0.05**2)
    assert power > found.even.amplitude**2


def test_the_gain_of_a_cube_is_three_times_the_variance_of_its_input():
    """Bussgang's theorem: the best linear approximation of a u^3 is 3 a var(u)."""
    found = distortion_of(measured(ODD, lambda u: u + 0.1 * u**3, realisations=200, periods=1))
    middle = float(np.mean(found.response.real))
    lines = len(ODD)
    # A multisine of many lines is Gaussian but for its own kurtosis, 3 - 1.5 / lines.
    assert middle == pytest.approx(1 + 0.3, abs=4 * 0.3 * 1.5 / lines + 3e-3)
    assert abs(np.mean(found.response.imag)) < 3e-3


def test_the_noise_is_the_known_one_within_its_chi2_interval():
    noise, realisations, periods = 0.05, 5, 6
    given = measured(ODD, steady, realisations, periods, noise)
    found = distortion_of(given)
    inputs = np.abs(given[0].input[0])[ODD]
    known = noise**2 / N / periods / realisations / inputs**2
    ratio = found.noise_sd**2 / known
    freedom = 2 * (periods - 1) * realisations * len(ODD)
    low, high = scipy.stats.chi2.ppf(np.array([0.0005, 0.9995]), freedom) / freedom
    assert low < ratio.mean() < high
    # Without distortion, realisations scatter as the noise of each says.
    share = (found.total_sd**2 / found.noise_sd**2).mean()
    freedom = 2 * (realisations - 1) * len(ODD)
    low, high = scipy.stats.chi2.ppf(np.array([0.0005, 0.9995]), freedom) / freedom
    assert 0.9 * low < share < 1.1 * high


def test_a_linear_structure_is_found_exactly():
    found = distortion_of(measured(ODD, steady))
    omega = 2 * np.pi * found.frequency_hz
    natural = 2 * np.pi * 50.0
    exact = natural**2 / (natural**2 - omega**2 + 2j * 0.03 * natural * omega)
    np.testing.assert_allclose(found.response, exact, atol=1e-10)
    mode = fit_resonance(found.frequency_hz, found.response)
    assert mode is not None
    assert mode.frequency_hz == pytest.approx(50.0, abs=1e-6)
    assert mode.damping == pytest.approx(0.03, abs=1e-7)


def test_the_errors_of_a_resonance_are_as_told():
    """Standardised errors over many draws have unit variance."""
    off = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        frequency = np.arange(40.0, 60.0, 0.25)
        natural, omega = 2 * np.pi * 50.0, 2 * np.pi * frequency
        response = natural**2 / (natural**2 - omega**2 + 2j * 0.03 * natural * omega)
        noise = rng.standard_normal((2, len(omega)))
        mode = fit_resonance(
            frequency, response + 0.3 * (noise[0] + 1j * noise[1]) / np.sqrt(2),
            np.full(len(omega), 0.3),
        )  # fmt: skip
        assert mode is not None
        off.append(
            [
                (mode.frequency_hz - 50.0) / mode.frequency_sd_hz,
                (mode.damping - 0.03) / mode.damping_sd,
            ]
        )
    spread = np.std(off, axis=0)
    assert (0.7 < spread).all()
    assert (spread < 1.4).all()


@pytest.mark.long
def test_a_duffing_oscillator_stiffens_with_level_and_is_odd():
    """Integrated by scipy, from rest through six periods; the last two are analysed.

    Driven twice as hard, two of the three realisations settle on motions that are not symmetric
    though the spring is, and have even lines.
    """
    rate, count = 64.0, 512
    lines = np.array([k for k in range(9, 61, 2) if k % 8 != 1])
    natural, zeta = 2 * np.pi * 3.0, 0.05

    def run(seed, rms):
        wave = multisine(lines, seed, rms, count)
        fine = np.fft.rfft(wave) / count
        turn = 2 * np.pi * np.arange(len(fine)) * rate / count

        def push(t):
            return 2 * float(np.sum(np.abs(fine) * np.cos(turn * t + np.angle(fine))))

        def rates(t, x):
            restoring = natural**2 * x[0] * (1 + 40.0 * x[0] ** 2)
            return [x[1], push(t) - restoring - 2 * zeta * natural * x[1]]

        times = np.arange(8 * count) / rate
        told = solve_ivp(rates, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-7, atol=1e-9)
        noise = 1e-3 * told.y[0].std() * np.random.default_rng(seed).standard_normal(8 * count)
        return realisation_of(np.tile(wave, 8), told.y[0] + noise, rate, count, 6 * count)

    given = [run(seed, rms) for rms in (1.0, 6.0) for seed in (0, 1, 2)]
    weak, strong = (distortion_of(group) for group in sort_by_level(given))
    low = fit_resonance(weak.frequency_hz, weak.response, weak.total_sd)
    high = fit_resonance(strong.frequency_hz, strong.response, strong.total_sd)
    assert low is not None
    assert high is not None
    assert low.frequency_hz == pytest.approx(3.0, rel=0.01)
    # Statistical linearisation: the square of the frequency grows by 40 E[x^4] / E[x^2].
    moved = np.array([np.fft.irfft(r.output.mean(axis=0)) * count for r in given[3:]])
    ratio = np.mean(moved**4) / np.mean(moved**2)
    assert high.frequency_hz == pytest.approx(3.0 * np.sqrt(1 + 40 * ratio), rel=0.03)
    assert strong.symmetry == "odd"


def test_a_period_is_found_in_noise():
    wave = np.tile(multisine(ODD, 1), 5)[300:]
    noisy = wave + 0.05 * np.random.default_rng(0).standard_normal(len(wave))
    assert find_period(noisy) == N


def test_what_does_not_repeat_is_refused():
    with pytest.raises(ValueError, match=r"repeats with a correlation of .* `period`"):
        find_period(np.random.default_rng(0).standard_normal(4000))


def test_a_record_without_a_whole_period_is_refused():
    with pytest.raises(ValueError, match=r"not one period of 1024.*--setting transient"):
        realisation_of(np.zeros(1100), np.zeros(1100), RATE, N, 100)


def test_periods_of_different_lengths_are_refused():
    one = realisation_of(multisine(ODD, 1), multisine(ODD, 1), RATE, N)
    other = realisation_of(multisine(ODD, 1), multisine(ODD, 1), RATE, N // 2)
    with pytest.raises(ValueError, match="different lengths"):
        distortion_of([one, other])


@pytest.mark.data
def test_the_silverbox_has_an_odd_nonlinearity():
    path = DATA / "silverbox/SNLS80mV.csv"
    if not path.is_file():
        pytest.skip(f"no measurements at {path}; set SLOWTIME_DATA")
    table = np.genfromtxt(path, delimiter=",", skip_header=1)[:, :2]
    ends = 49177 + 8692 * np.arange(9)
    given = [
        realisation_of(table[end - 8192 : end, 0], table[end - 8192 : end, 1], 610.35, 8192)
        for end in ends
    ]
    found = distortion_of(given)
    assert found.symmetry == "odd"
    mode = fit_resonance(found.frequency_hz, found.response, found.total_sd)
    assert mode is not None
    # 68.3 Hz and 4.9 % at small motion; the cube stiffens it.
    assert 68.3 < mode.frequency_hz < 70.5
    assert mode.damping == pytest.approx(0.049, abs=0.002)


def test_filtered_noise_is_no_distortion():
    sos = sps.butter(2, 100.0, fs=RATE, output="sos")
    given = []
    rng = np.random.default_rng(4)
    for seed in range(4):
        wave = np.tile(multisine(ODD_RANDOM, seed), 6)
        told = np.tile(steady(wave[:N]), 6)
        told += 0.1 * sps.sosfilt(sos, rng.standard_normal(len(told)))
        given.append(realisation_of(wave, told, RATE, N))
    assert distortion_of(given).symmetry == "none"
