"""Records of one mode under white force, made independently of the package."""

import numpy as np
import scipy.signal as sps

OVERSAMPLED = 8
"""Steps of the exact discretisation for each sample of the record."""


def record(
    rng,
    *,
    f,
    z,
    rate,
    seconds,
    noise,
    channels=1,
    motion="acceleration",
    filtered="chebyshev",
):
    """One channel, or several that move together, behind an anti-aliasing filter.

    The force is constant over a step of the exact discretisation at 8 times the rate; noise is
    a share of the standard deviation of each channel.
    """
    omega, step = 2 * np.pi * f, 1 / (OVERSAMPLED * rate)
    before = int(6 / (z * omega) * rate) + 200
    count = round(seconds * rate)
    free = np.array([[0.0, 1.0], [-omega * omega, -2 * z * omega]])
    seen = {
        "displacement": ([omega * omega, 0.0], 0.0),
        "velocity": ([0.0, omega], 0.0),
        "acceleration": ([-omega * omega, -2 * z * omega], 1.0),
    }[motion]
    system = (free, np.array([[0.0], [1.0]]), np.array([seen[0]]), np.array([[seen[1]]]))
    above, below = sps.ss2tf(*sps.cont2discrete(system, step, method="zoh")[:4])
    force = rng.standard_normal((before + count) * OVERSAMPLED)
    response = sps.lfilter(above[0], below, force)
    edge = 0.8 / OVERSAMPLED
    if filtered == "chebyshev":
        sections = sps.cheby1(8, 0.05, edge, output="sos")
    else:
        sections = sps.butter(4, edge, output="sos")
    series = sps.sosfilt(sections, response)[::OVERSAMPLED][before : before + count]
    shape = np.append(1.0, rng.uniform(-1, 1, channels - 1))
    clean = series[:, None] * shape
    return clean + noise * clean.std(axis=0) * rng.standard_normal(clean.shape)


def drawn(rng, longest):
    """Frequency, damping, rate, seconds and noise of one record, below `longest` samples."""
    while True:
        f, z = np.exp(rng.uniform(np.log([1, 0.005]), np.log([20, 0.05])))
        seconds, rate = np.exp(rng.uniform(np.log([60, 50]), np.log([1200, 1000])))
        if f < 0.35 * rate and seconds * rate < longest:
            noise = float(np.exp(rng.uniform(np.log(0.01), np.log(0.2))))
            return {"f": f, "z": z, "rate": rate, "seconds": seconds, "noise": noise}
