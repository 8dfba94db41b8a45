"""Spectral rates against rainflow counts of simulated stress, over twenty spectra.

``python -m tests.slowtime.fatigue.test_spectral_against_counts`` prints the table.
"""

import numpy as np
import pytest

from slowtime.fatigue.counter import Count, Counter
from slowtime.fatigue.curves import SNCurve
from slowtime.fatigue.spectral import METHODS, SpectralMoments, damage_rate

RATE_HZ = 64.0
LENGTH = 2**17
FREQUENCY = np.fft.rfftfreq(LENGTH, 1 / RATE_HZ)


def peak(centre, damping, level=1.0):
    ratio = FREQUENCY / centre
    return level / ((1 - ratio**2) ** 2 + (2 * damping * ratio) ** 2) * (FREQUENCY < 5 * centre)


def block(low, high, level=1.0):
    return level * ((low <= FREQUENCY) & (high >= FREQUENCY))


SPECTRA = {
    "one mode, 0.5 %": peak(1.0, 0.005),
    "one mode, 1 %": peak(1.0, 0.01),
    "one mode, 2 %": peak(1.0, 0.02),
    "one mode, 5 %": peak(0.8, 0.05),
    "block 0.9-1.1 Hz": block(0.9, 1.1),
    "block 0.5-1.5 Hz": block(0.5, 1.5),
    "block 0.2-2 Hz": block(0.2, 2.0),
    "block 0.1-4 Hz": block(0.1, 4.0),
    "block 1-4 Hz": block(1.0, 4.0),
    "two modes 1 : 2": peak(0.8, 0.01) + peak(1.6, 0.01, 0.5),
    "two modes 1 : 3": peak(0.7, 0.02) + peak(2.1, 0.02, 0.3),
    "two modes 1 : 4, second strong": peak(0.6, 0.02) + peak(2.4, 0.02),
    "three modes of a frame": peak(0.5, 0.02) + peak(1.4, 0.02, 0.3) + peak(2.3, 0.02, 0.1),
    "three modes, falling": peak(0.6, 0.01) + peak(1.7, 0.01, 0.05) + peak(2.8, 0.01, 0.01),
    "triangle": block(0.2, 3.0) * FREQUENCY,
    "falling triangle": block(0.2, 3.0) * (3.2 - FREQUENCY),
    "pink": block(0.2, 3.0) / np.maximum(FREQUENCY, 0.1),
    "waves (Pierson-Moskowitz)": np.where(
        (FREQUENCY > 0.3) & (FREQUENCY < 4),
        np.maximum(FREQUENCY, 0.1) ** -5.0
        * np.exp(-1.25 * (0.7 / np.maximum(FREQUENCY, 0.1)) ** 4),
        0.0,
    ),
    "mode on a block": peak(1.0, 0.01, 0.02) + block(0.2, 3.0),
    "block with a gap": block(0.4, 0.9) + block(1.6, 2.4, 0.5),
}  # fmt: skip


HARDER = ("three modes, falling", "pink")
"""Spectra on which Dirlik's formula is more than 10 % too low at a slope of 5."""


def simulated(density, cycles, seed):
    """Pieces of Gaussian stress of unit variance until it has risen through 0 so often."""
    rng = np.random.default_rng(seed)
    spacing = FREQUENCY[1]
    amplitude = np.sqrt(density / (density.sum() * spacing) * spacing / 2) * LENGTH
    seen = 0
    while seen < cycles:
        white = rng.standard_normal((2, len(FREQUENCY)))
        series = np.fft.irfft(amplitude * (white[0] + 1j * white[1]) / np.sqrt(2), LENGTH)
        seen += int(((series[1:] > 0) & (series[:-1] <= 0)).sum())
        yield series


def ratios(density, cycles, seed):
    """Spectral over counted damage rate: by slope and method; and the cycles counted."""
    moments = SpectralMoments.of(FREQUENCY, density / np.trapezoid(density, FREQUENCY))
    counters = {m: Counter(curve=SNCurve(constant=1e6, slope=m)) for m in (3.0, 5.0)}
    counts = dict.fromkeys(counters, Count())
    for series in simulated(density, cycles, seed):
        for slope, counter in counters.items():
            counts[slope] = counter.step(counts[slope], series)
    found = {}
    for slope, counter in counters.items():
        counted = counter.miner(counts[slope]).median / (counts[slope].samples / RATE_HZ)
        for method in METHODS:
            found[slope, method] = damage_rate(moments, counter.curve, method) / counted
    return found, counters[3.0].total(counts[3.0]).counts.sum()


@pytest.mark.parametrize("name", ["one mode, 2 %", "block 0.5-1.5 Hz", "two modes 1 : 2"])
def test_dirlik_is_within_ten_percent_of_counting(name):
    found, cycles = ratios(SPECTRA[name], 20_000, seed=1)
    assert cycles > 20_000
    for slope in (3.0, 5.0):
        assert abs(found[slope, "dirlik"] - 1) < 0.1
        assert found[slope, "narrow_band"] > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECTRA)
def test_dirlik_is_within_its_bound_of_a_million_cycles(name):
    found, cycles = ratios(SPECTRA[name], 1_000_000, seed=7)
    assert cycles > 1_000_000
    for slope in (3.0, 5.0):
        assert abs(found[slope, "dirlik"] - 1) < (0.15 if name in HARDER else 0.1)


def main() -> None:
    print(
        f"{'spectrum':32}{'cycles':>10}  "
        + "  ".join(f"{m[:7]:>8}3 {m[:7]:>8}5" for m in METHODS)
    )
    for name, density in SPECTRA.items():
        found, cycles = ratios(density, 1_000_000, seed=7)
        cells = (f"{found[3.0, m]:9.3f} {found[5.0, m]:9.3f}" for m in METHODS)
        print(f"{name:32}{cycles:10.0f}  " + "  ".join(cells), flush=True)


if __name__ == "__main__":
    main()
