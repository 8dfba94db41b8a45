"""A frame simulated by other means than the estimator's: Newmark's method, four times finer.

``python -m tests.slowtime.estimation.virtual.simulated SEEDS`` prints coverage of the 95 %
intervals by load, each seed with a model of its own within the tolerance.
"""

import sys

import numpy as np
import scipy.signal as sps

from slowtime.dynamics.description import Description, Node, Sensor, Spring, Tolerance, assemble
from slowtime.estimation.virtual import VirtualSensor, drift, element_force
from slowtime.estimation.virtual.tolerances import drawn_member

RATE_HZ, FINER = 100, 4
FLOORS = 5
HEARD = (1, 3, 5)
OUTPUTS = (
    element_force("k1").scaled(2e-5, "MPa", sd=0.03, name="storey1.stress"),
    drift("base", "f1"),
    drift("f1", "f2"),
    drift("f3", "f4"),
)


def frame(tolerance=(0.05, 0.3, 0.02), noise_sd=None, heard=HEARD, floors=FLOORS):
    """Shear frame of 2 Hz; Rayleigh damping about 1.5 % in the first mode."""
    mass, stiffness = 2e4, 4e7
    springs = [
        Spring(
            id=f"k{i}",
            between=("base" if i == 1 else f"f{i - 1}", f"f{i}"),
            stiffness_n_per_m=stiffness,
            damping_n_s_per_m=1.5e-3 * stiffness,
        )
        for i in range(1, floors + 1)
    ]
    air = [
        Spring(id=f"c{i}", between=("base", f"f{i}"), damping_n_s_per_m=0.15 * mass)
        for i in range(1, floors + 1)
    ]
    return Description(
        name="frame",
        nodes=tuple(Node(id=f"f{i}", mass_kg=mass) for i in range(1, floors + 1)),
        elements=(*springs, *air),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"f{i}", unit="m/s^2",
                   noise_sd=noise_sd)
            for i in heard
        ),
        tolerance=Tolerance(
            stiffness=tolerance[0], damping=tolerance[1], mass=tolerance[2]
        ),
    )  # fmt: skip


def white(rng, count, floors, rate_hz):
    return 3e3 * rng.standard_normal((count, floors))


def wind(rng, count, floors, rate_hz):
    """Coloured (-6 dB an octave from 1 Hz), in common and apart, growing with height."""
    drawn = rng.standard_normal((count, floors)) + 2 * rng.standard_normal((count, 1))
    slow = sps.lfilter(*sps.butter(1, 1.0, fs=rate_hz), drawn, axis=0)
    return 2e4 * slow * np.linspace(0.3, 1.0, floors)


def top(rng, count, floors, rate_hz):
    force = np.zeros((count, floors))
    force[:, -1] = 3e3 * rng.standard_normal(count)
    return force


def bursts(rng, count, floors, rate_hz):
    """A blow somewhere every 8 s on average, and a little noise."""
    force = 1e3 * rng.standard_normal((count, floors))
    length = int(0.1 * rate_hz)
    for start in rng.integers(0, count - length, count // int(8 * rate_hz)):
        blow = 2e5 * rng.standard_normal() * np.hanning(length)
        force[start : start + length, rng.integers(floors)] += blow
    return force


LOADS = {load.__name__: load for load in (white, wind, top, bursts)}


def newmark(structure, force, step):
    """Displacements and accelerations by the average-acceleration method."""
    mass, damping, stiffness = structure.mass, structure.damping, structure.stiffness
    solve = np.linalg.inv(mass + step / 2 * damping + step**2 / 4 * stiffness)
    moved, speed = np.zeros((2, len(mass)))
    gained = np.linalg.solve(mass, force[0])
    places, accelerations = np.empty((2, *force.shape))
    for i, push in enumerate(force):
        moved = moved + step * speed + step**2 / 4 * gained
        speed = speed + step / 2 * gained
        gained = solve @ (push - damping @ speed - stiffness @ moved)
        moved = moved + step**2 / 4 * gained
        speed = speed + step / 2 * gained
        places[i], accelerations[i] = moved, gained
    return places, accelerations


def truth(description, load, seed, seconds, noise=3e-3):
    """Measured accelerations, and outputs of a structure within the tolerance."""
    rng = np.random.default_rng(seed)
    true = drawn_member(description, rng)
    structure, fine = assemble(true), RATE_HZ * FINER
    force = LOADS[load](rng, seconds * fine, structure.dofs, fine)
    places, accelerations = newmark(structure, force, 1 / fine)
    # The factor from force to stress is wrong by its own deviation.
    factors = [o.factor * (1 + o.factor_sd * rng.standard_normal()) for o in OUTPUTS]
    rows = [f * o.row(true) for f, o in zip(factors, OUTPUTS, strict=True)]
    seen = [structure.dof(sensor.node) for sensor in description.sensors]
    # Sensors have an anti-aliasing filter.
    samples = sps.decimate(accelerations[:, seen], FINER, ftype="fir", axis=0)
    samples = samples + noise * rng.standard_normal(samples.shape)
    return samples, places @ np.stack(rows, axis=1)


def estimated(description, samples, settings=None):
    channels = [sensor.channel for sensor in description.sensors]
    sensor = VirtualSensor(description, channels, OUTPUTS, float(RATE_HZ), settings)
    state, windows = sensor.step(sensor.start(), samples)
    _, last = sensor.finish(state)
    return sensor, (*windows, *last)


def held(load, seed, seconds=90, description=None, settings=None):
    """Whether each settled value is within its 95 % interval; relative error and deviation."""
    description = description or frame()
    samples, whole = truth(description, load, seed, seconds)
    sensor, windows = estimated(description, samples, settings)
    high = sps.butter(2, sensor.lowest_hz, "high", fs=RATE_HZ * FINER, output="sos")
    wanted = sps.sosfilt(high, whole, axis=0)[::FINER]
    values = np.concatenate([window.values for window in windows])
    sd = np.concatenate([window.sd for window in windows])
    settled = np.concatenate([window.settled for window in windows])
    error = (values - wanted[: len(values)])[settled]
    size = wanted[: len(values)][settled].std(axis=0)
    inside = np.abs(error) < 1.96 * sd[settled]
    return (
        inside.mean(axis=0),
        np.sqrt((error**2).mean(axis=0)) / size,
        sd[settled].mean(axis=0) / size,
    )


def main(seeds: int) -> None:
    names = [output.name for output in OUTPUTS]
    print(f"{'load':8} {'':24}" + "".join(f"{name:>18}" for name in names))
    every = []
    for load in LOADS:
        found = np.array([held(load, seed) for seed in range(seeds)])
        every.append(found[:, 0])
        for what, row in zip(("held [%]", "rms error / rms [%]", "sd / rms [%]"),
                             found.mean(axis=0), strict=True):  # fmt: skip
            print(f"{load:8} {what:24}" + "".join(f"{100 * x:18.1f}" for x in row), flush=True)
    pooled = np.concatenate(every).mean(axis=0)
    print(f"{'all':8} {'held [%]':24}" + "".join(f"{100 * x:18.1f}" for x in pooled))


if __name__ == "__main__":
    main(int(sys.argv[1]))
