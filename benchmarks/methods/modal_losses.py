"""Samples that are not there: what their loss costs, beside the Cramér-Rao bounds.

Run `python -m benchmarks.methods.modal_losses [--runs 30] [--out FILE]`; with a file it resumes
where it was stopped. Two modes (1.5 and 4.2 Hz, 1 %) are
heard by three channels at 20 Hz for ten minutes, 20 dB over the noise. Of each record samples
are lost in six ways, and modes of the complete record and of the one with gaps are compared
with the truth. Efficiency is the variance on complete records over that on records with gaps,
over the same ratio of the bounds: the Gaussian likelihood of one channel, by its covariance
matrix, in frequency and damping of both modes, their strengths and the noise.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.methods import by_method
from slowtime.identification.modes import Mode
from slowtime_services.files import Gap, Record
from slowtime_services.modal.losses import completed, wider

RATE_HZ, SECONDS = 20.0, 600.0
NATURAL_HZ, DAMPING, NOISE = (1.5, 4.2), 0.01, 0.1
SHAPES = np.array([[1.0, 0.8, 0.3], [0.7, -0.5, -0.9]])
BOUND_ROWS = 1000
"""Rows whose covariance matrix tells the ratio of the bounds [1]: 75 cycles."""
STEP = 1e-4
"""Relative step of the derivatives of the covariance [1]."""

Losses = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def _runs(share: float, shortest: int, longest: int) -> Losses:
    """Return losses of runs at any place."""

    def lose(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        there = np.ones(len(samples), dtype=bool)
        while (~there).mean() < share:
            length = int(rng.integers(shortest, longest + 1))
            at = int(rng.integers(1, len(samples) - length - 1))
            there[at : at + length] = False
        return there

    return lose


def _periodic(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    there = np.arange(len(samples)) % 100 >= 10
    there[[0, -1]] = True
    return there


def _loud(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lose what a buffer drops while the level is high."""
    level = np.convolve(np.sum(samples**2, axis=1), np.ones(20) / 20, "same")
    there = level < np.quantile(level, 0.95)
    there[[0, -1]] = True
    return np.asarray(there)


KINDS: dict[str, Losses] = {
    "single samples, 20 %": _runs(0.2, 1, 1),
    "gaps of 1 to 40, 5 %": _runs(0.05, 1, 40),
    "gaps of 1 to 40, 20 %": _runs(0.2, 1, 40),
    "10 of each 100": _periodic,
    "gaps of 100 to 400, 20 %": _runs(0.2, 100, 400),
    "where the level is high, 5 %": _loud,
}


def heard(rng: np.random.Generator) -> np.ndarray:
    """Return a complete record."""
    count = round(SECONDS * RATE_HZ)
    samples = NOISE * rng.standard_normal((count, 3))
    for hz, shape in zip(NATURAL_HZ, SHAPES, strict=True):
        ringing = ambient_acceleration(Oscillator.from_modal(hz, DAMPING), count, RATE_HZ, rng)
        samples = samples + np.outer(ringing / ringing.std(), shape)
    return samples


def modes_of(samples: np.ndarray, there: np.ndarray) -> tuple[list[Mode], tuple[str, ...]]:
    """Modes by `identify`, and flags of the losses."""
    rows = np.flatnonzero(there)
    jumps = np.diff(rows) - 1
    gaps = tuple(Gap(int(k) + 1, int(jumps[k])) for k in np.flatnonzero(jumps))
    given = Record(
        samples=samples[there], rate_hz=RATE_HZ, channels=("a", "b", "c"),
        units=("m/s^2",) * 3, gaps=gaps,
    )  # fmt: skip
    whole = completed(given, "use")
    part = np.asarray(whole.record.samples)
    found = by_method(part, RATE_HZ, method="modes").structural
    factor = whole.inflation(0, len(part))
    return [wider(mode, factor, whole.flags) for mode in found], whole.flags


def estimates(modes: Sequence[Mode]) -> np.ndarray:
    """Errors, relative to the truth, and standard deviations, of both modes [mode, 2, 2]."""
    told = np.full((2, 2, 2), np.nan)
    for k, hz in enumerate(NATURAL_HZ):
        near = [m for m in modes if abs(m.frequency_hz.value / hz - 1) < 0.03]
        if near:
            f, z = near[0].frequency_hz, near[0].damping_ratio
            told[k, 0] = f.value / hz - 1, z.value / DAMPING - 1
            told[k, 1] = f.sd / hz, z.sd / DAMPING
    return told


def covariance(parameters: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Autocovariance of one channel; parameters are ln f, ln zeta, ln power, then ln noise."""
    found = np.where(lags == 0, np.exp(parameters[-1]), 0.0)
    for ln_f, ln_z, ln_p in parameters[:-1].reshape(-1, 3):
        omega, zeta = 2 * np.pi * np.exp(ln_f), np.exp(ln_z)
        damped, t = omega * np.sqrt(1 - zeta**2), np.abs(lags) / RATE_HZ
        wave = np.cos(damped * t) - zeta / np.sqrt(1 - zeta**2) * np.sin(damped * t)
        found = found + np.exp(ln_p - zeta * omega * t) * wave
    return np.asarray(found)


def bound_ratio(there: np.ndarray) -> np.ndarray:
    """Bounds on complete rows over those on the rows that are there [mode, frequency/damping].

    The covariance is that of velocities, whose resonances are those of accelerations.
    """
    truth = np.log([v for hz in NATURAL_HZ for v in (hz, DAMPING, 1.0)] + [NOISE**2])
    place = np.arange(len(there))
    lags = place[:, None] - place
    own = covariance(truth, lags)
    slopes = []
    for k in range(len(truth)):
        step = np.zeros(len(truth))
        step[k] = STEP
        change = covariance(truth + step, lags) - covariance(truth - step, lags)
        slopes.append(change / (2 * STEP))
    bounds = []
    for rows in (place, place[there]):
        root = scipy.linalg.cho_factor(own[np.ix_(rows, rows)])
        turned = [scipy.linalg.cho_solve(root, slope[np.ix_(rows, rows)]) for slope in slopes]
        information = [[0.5 * np.sum(a * b.T) for b in turned] for a in turned]
        bounds.append(np.diag(np.linalg.inv(information)))
    ratio = bounds[0] / bounds[1]
    return np.asarray(ratio[:-1].reshape(-1, 3)[:, :2])


def measure(seed: int) -> dict[str, Any]:
    """Estimates of one record, complete and with each kind of losses, and which are flagged."""
    samples = heard(np.random.default_rng(seed))
    whole = np.ones(len(samples), dtype=bool)
    found: dict[str, Any] = {"complete": estimates(modes_of(samples, whole)[0]).tolist()}
    flagged = []
    for number, (kind, lose) in enumerate(KINDS.items()):
        modes, flags = modes_of(samples, lose(samples, np.random.default_rng([seed, number])))
        found[kind] = estimates(modes).tolist()
        flagged += [kind] if flags else []
    return {**found, "flagged": flagged}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 where an efficiency is below 0.9 beyond chance."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--out", type=Path, help="one line of JSON for each record")
    given = parser.parse_args(arguments)
    lines: list[dict[str, Any]] = []
    if given.out is not None and given.out.exists():
        lines = [json.loads(line) for line in given.out.read_text().splitlines()]
    for seed in range(len(lines), given.runs):
        lines.append(measure(seed))
        if given.out is not None:
            with given.out.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    lines = lines[: given.runs]
    complete = [line["complete"] for line in lines]
    found = {kind: [line[kind] for line in lines] for kind in KINDS}
    flagged = {kind: sum(kind in line["flagged"] for line in lines) for kind in KINDS}
    print("| losses | efficiency | intervals of frequency | of damping | flagged |")
    print("|---|---|---|---|---|")
    whole = np.array(complete)
    worst = np.inf
    for kind, rows in found.items():
        told = np.array(rows)
        both = np.isfinite(told[:, :, :1]) & np.isfinite(whole[:, :, :1])
        square = [
            np.nanmean(np.where(both, a, np.nan)[:, :, 0] ** 2, axis=0) for a in (whole, told)
        ]
        there = KINDS[kind](
            heard(np.random.default_rng(999))[:BOUND_ROWS], np.random.default_rng(1)
        )
        efficiency = float(np.exp(np.mean(np.log(square[0] / square[1] / bound_ratio(there)))))
        held = np.nanmean(np.abs(told[:, :, 0]) < 1.96 * told[:, :, 1], axis=(0, 1))
        print(
            f"| {kind} | {efficiency:.2f} | {100 * held[0]:.0f} % | {100 * held[1]:.0f} % | "
            f"{flagged[kind]} of {given.runs} |"
        )
        worst = min(worst, np.inf if kind.startswith("where") else efficiency)
    return 0 if worst > 0.9 - 1 / np.sqrt(given.runs) else 1


if __name__ == "__main__":
    sys.exit(main())
