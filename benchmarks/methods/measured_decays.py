"""Courses of measured decays beside piecewise fits by SciPy.

Run `python -m benchmarks.methods.measured_decays`. Of each decay that is in SLOWTIME_DATA,
frequency and damping along it (`decay_law`) are compared with stretches of 3 or 1.5 cycles: a
Butterworth band-pass of two octaves, forwards and backwards, then a damped cosine by least
squares, which knows neither laws nor windows of `decay_envelope`. Stretches below a tenth of
the largest amplitude are left out, because noise and the filter move SciPy's fit there.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.optimize
import scipy.signal

from slowtime.identification.free_decay.amplitude_law import decay_law
from slowtime.identification.free_decay.envelope import decay_envelope

ROOT = Path(__file__).parents[2]
SMALLEST = 0.1
"""Amplitude over the largest from which stretches are compared [1]."""


def _column(path: str, name: str, every: int = 1) -> Callable[[Path], np.ndarray]:
    return lambda data: np.genfromtxt(data / path, delimiter=",", names=True)[name][::every]


TORSION = "torsion_disc/free_{}.csv"
PENDULUM = "single_pendulum/swing_1kHz.csv"
BEAM = "../cases/reports/decay_by_amplitude/al_cut_128hz.csv"
SHORT = ("no_magnet_8", "no_magnet_9", "no_magnet_10", "magnet_2", "magnet_6", "magnet_10")
RECORDS: dict[str, tuple[Callable[[Path], np.ndarray], float, float, float, float]] = {
    "ship model": (_column("ship_roll/model_test_21337.csv", "phi"), 100.0, 0.39, 5.0, 3.0),
    "pendulum": (_column(PENDULUM, "angle_from_hanging_rad", 10), 100.0, 1.2, 0.0, 3.0),
    "aluminium beam": (_column(BEAM, "acc"), 128.0, 6.9, 0.0, 3.0),
    "swing": (_column("../cases/real/swing.csv", "angle"), 30.0, 1.0, 0.0, 3.0),
} | {
    f"torsion disc, {one}": (
        _column(TORSION.format(one), "disc_angle_rad"), 20.0, 0.71, 0.0, 1.5,
    )
    for one in SHORT
}  # fmt: skip
"""Reader, sampling rate [Hz], frequency about [Hz], time left out after the release [s], and
length of stretches [cycles]: shorter where dry friction ends a decay within ten cycles."""


def piecewise(
    series: np.ndarray, rate_hz: float, about_hz: float, cycles: float = 3.0
) -> np.ndarray:
    """Middle [s], damping, its standard deviation, and frequency [Hz] of stretches, in rows."""
    edges = [about_hz / 2, min(2 * about_hz, 0.45 * rate_hz)]
    band = scipy.signal.butter(2, edges, "band", fs=rate_hz, output="sos")
    filtered = scipy.signal.sosfiltfilt(band, series)
    length = int(cycles / about_hz * rate_hz)
    t = np.arange(length) / rate_hz

    def model(t: np.ndarray, a: float, b: float, fall: float, w: float) -> np.ndarray:
        return np.asarray(np.exp(-fall * t) * (a * np.cos(w * t) + b * np.sin(w * t)))

    found = []
    for first in range(2 * length, len(series) - 2 * length, length):
        piece = filtered[first : first + length]
        size = float(np.abs(piece).max())
        start = [size / 2, size / 2, 0.02 * about_hz, 2 * np.pi * about_hz]
        try:
            best, covariance = scipy.optimize.curve_fit(model, t, piece, start)
        except RuntimeError:
            continue
        # What the filter leaves of white noise is correlated over its bandwidth.
        sd = np.sqrt(np.diag(covariance) * rate_hz / 2 / (1.5 * about_hz))
        w = np.hypot(best[3], best[2])
        middle = (first + length / 2) / rate_hz
        found.append((middle, best[2] / w, sd[2] / w, best[3] / (2 * np.pi)))
    return np.array(found).reshape(-1, 4)


def compared(
    series: np.ndarray, rate_hz: float, about_hz: float, skip_s: float, cycles: float = 3.0
) -> dict[str, np.ndarray]:
    """Damping by both, the standard deviation of their difference, and ratios of frequency."""
    envelope = decay_envelope(series, rate_hz)
    law = decay_law(envelope)
    at, zeta, zeta_sd, hz = piecewise(series, rate_hz, about_hz, cycles).T
    times = envelope.times_s
    inside = (at > times[0] + skip_s) & (at < times[-1])
    inside &= np.interp(at, times, law.amplitude) > SMALLEST * law.amplitude[0]

    def along(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.interp(at, times, values)[inside])

    return {
        "damping": along(law.damping),
        "damping by SciPy": zeta[inside],
        "sd": np.hypot(zeta_sd[inside], along(law.damping_sd)),
        "ratio": along(law.frequency_hz) / hz[inside],
    }


def main() -> int:
    """Print a row for each decay that is there."""
    data = Path(os.environ.get("SLOWTIME_DATA", ROOT.parent / "shared/data"))
    print("| decay | stretches | damping | median apart | within 3 sd + 5 % | frequency |")
    print("|---|---|---|---|---|---|")
    for name, (read, *how) in RECORDS.items():
        try:
            of = compared(read(data), *how)
        except OSError:
            print(f"| {name} | not in {data} | | | | |")
            continue
        ours, theirs = of["damping"], of["damping by SciPy"]
        if not len(ours):
            print(f"| {name} | 0 | | | | |")
            continue
        apart = np.abs(ours - theirs)
        near = apart < 3 * of["sd"] + 0.05 * theirs
        print(
            f"| {name} | {len(ours)} | {100 * ours[0]:.2f} to {100 * ours[-1]:.2f} % | "
            f"{100 * np.median(apart / theirs):.1f} % | {near.sum()} of {len(near)} | "
            f"{100 * np.abs(of['ratio'] - 1).max():.2f} % |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
