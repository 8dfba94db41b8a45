"""Compute the references of problems without a closed form: `python -m
tests.slowtime.reliability.references`.

Two inputs, and what reduces to one, are integrated by quadrature. The others are a long
importance sampling, which stratified sampling in the radius must agree with.
"""

import csv
import sys

import numpy as np
from scipy import integrate, stats

from slowtime.reliability import Problem, Stopping, importance
from tests.slowtime.reliability.problems import (
    REFERENCES,
    RP,
    SERIES_BETA,
    Known,
    directions,
    named,
)

PHI = stats.norm
FINE = 1e-3
"""Coefficient of variation of what is sampled."""

LINE = np.linspace(-9.5, 9.5, 1601)


def planar(problem: Problem, columns: int = 3001) -> float:
    """Two inputs: along lines of the second, the intervals that fail, their ends bisected."""
    first = np.linspace(-8.5, 8.5, columns)
    weight = PHI.pdf(first) * (first[1] - first[0])
    total = 0.0
    for chunk in np.array_split(np.arange(columns), 20):
        total += float(weight[chunk] @ _lines(problem, first[chunk]))
    return total


def _lines(problem: Problem, first: np.ndarray) -> np.ndarray:
    def g(u: np.ndarray, second: np.ndarray) -> np.ndarray:
        return np.asarray(problem.limit_state(problem.physical(np.stack([u, second], axis=1))))

    grid = g(np.repeat(first, len(LINE)), np.tile(LINE, len(first)))
    fails = grid.reshape(len(first), -1) <= 0.0
    line, place = np.nonzero(fails[:, 1:] != fails[:, :-1])
    lo, hi, at_lo = LINE[place], LINE[place + 1], fails[line, place]
    for _ in range(40):
        middle = 0.5 * (lo + hi)
        same = (g(first[line], middle) <= 0.0) == at_lo
        lo, hi = np.where(same, middle, lo), np.where(same, hi, middle)
    beyond = PHI.sf(0.5 * (lo + hi))
    value = np.where(fails[:, 0], 1.0, 0.0)
    np.add.at(value, line, np.where(at_lo, -beyond, beyond))
    return value


def stratified(problem: Problem, rng: np.random.Generator, count: int) -> tuple[float, float]:
    """Radial strata of equal ratio, the number of points by a first pass; value and sd."""
    edges = np.append(10.0 ** (-0.125 * np.arange(72)), 0.0)
    held = edges[:-1] - edges[1:]
    share = np.array([_ring(problem, rng, edges, k, 4000) for k in range(len(held))])
    spread = np.maximum(share * (1.0 - share), 1e-4) ** 0.5 * held
    counts = np.maximum(count * spread / spread.sum(), 2000).astype(int)
    means = np.array([_ring(problem, rng, edges, k, n) for k, n in enumerate(counts)])
    variance = np.sum(held**2 * means * (1.0 - means) / counts)
    return float(held @ means), float(np.sqrt(variance))


def _ring(
    problem: Problem, rng: np.random.Generator, edges: np.ndarray, ring: int, count: int
) -> float:
    failed = 0
    for done in range(0, count, 200_000):
        size = min(200_000, count - done)
        tail = rng.uniform(edges[ring + 1], edges[ring], size=size)
        ways = rng.standard_normal((size, problem.size))
        radius = np.sqrt(stats.chi2.isf(tail, problem.size)) / np.linalg.norm(ways, axis=1)
        failed += int(
            np.sum(problem.limit_state(problem.physical(ways * radius[:, None])) <= 0)
        )
    return failed / count


def rp54() -> float:
    """Sum of 20 exponential inputs below 8.951."""
    return float(stats.gamma.cdf(8.951, 20))


def rp107() -> float:
    """A plane at distance 5."""
    return float(PHI.sf(5.0))


def rp63() -> float:
    """x1 above a tenth of a chi-square variable of 99 degrees, less 4.5."""

    def inner(q: float) -> float:
        return float(PHI.sf(0.1 * q - 4.5) * stats.chi2.pdf(q, 99))

    return float(integrate.quad(inner, 20.0, 400.0, epsabs=0.0, epsrel=1e-11, limit=500)[0])


def rp33() -> float:
    """Two planes at distance 3 in a plane: sum of both less the pair."""
    rho = 1.0 / np.sqrt(3.0)
    pair = integrate.quad(
        lambda z: PHI.pdf(z) * PHI.sf((3.0 - rho * z) / np.sqrt(1.0 - rho**2)), 3.0, 12.0,
        epsabs=0.0, epsrel=1e-12,
    )[0]  # fmt: skip
    return float(2.0 * PHI.sf(3.0) - pair)


def rp77() -> float:
    """By cases of x3, each a normal tail."""

    def below(c: float) -> float:
        return float(PHI.cdf((c - 10.0) / np.sqrt(1.25)) * PHI.pdf(c - 4.0))

    def above(c: float) -> float:
        return float(PHI.sf(c) * PHI.pdf(c - 4.0))

    one = integrate.quad(below, -8.0, 5.0, epsabs=0.0, epsrel=1e-11)[0]
    return float(one + integrate.quad(above, 5.0, 16.0, epsabs=0.0, epsrel=1e-11)[0])


def series(count: int = 2_000_000) -> tuple[float, float]:
    """Union of half-spaces: draw one beyond its plane, count it over how many it is beyond."""
    rng, ways = np.random.default_rng(3), directions()
    alone = PHI.sf(SERIES_BETA)
    total = square = 0.0
    for _ in range(count // 200_000):
        which = rng.integers(len(ways), size=200_000)
        u = rng.standard_normal((200_000, ways.shape[1]))
        along = PHI.isf(alone * rng.uniform(size=200_000))
        axis = ways[which]
        u += (along - np.sum(u * axis, axis=1))[:, None] * axis
        share = 1.0 / np.maximum(np.sum(u @ ways.T >= SERIES_BETA, axis=1), 1)
        total, square = total + share.sum(), square + (share**2).sum()
    mean = total / count
    sd = np.sqrt((square / count - mean**2) / count)
    return float(len(ways) * alone * mean), float(len(ways) * alone * sd)


EXACT = {"RP33": rp33, "RP54": rp54, "RP63": rp63, "RP77": rp77, "RP107": rp107}


def main() -> None:
    """Write the file of references."""
    count = int(float(sys.argv[1])) if len(sys.argv) > 1 else 20_000_000
    rows: list[tuple[str, float, float, str]] = []
    for name, (laws, g) in RP.items():
        known = Known(Problem(named(laws), g), np.nan)
        if name in EXACT:
            rows.append((name, EXACT[name](), 0.0, "quadrature"))
        elif known.problem.size == 2:
            rows.append((name, planar(known.problem), 0.0, "quadrature"))
        else:
            value, sd = stratified(known.problem, np.random.default_rng(11), count)
            long = importance(known.problem, np.random.default_rng(12), Stopping(FINE))
            # The weights are checked by what uses none.
            assert abs(long.probability - value) < 4.0 * sd, (name, value, sd, long)
            sd = FINE * long.probability
            rows.append((name, long.probability, sd, "importance sampling"))
        print(rows[-1], flush=True)
    rows.append(("series of 20 planes", *series(), "union sampling"))
    with REFERENCES.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("problem", "probability", "sd", "by"))
        writer.writerows((n, f"{p:.9g}", f"{sd:.2g}", by) for n, p, sd, by in rows)


if __name__ == "__main__":
    main()
