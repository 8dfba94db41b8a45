"""Problems with known probabilities: closed forms, quadrature, and the reliability challenge.

The problems named RP are those of the black-box reliability challenge of TNO (2019) in the form
that otbenchmark 0.2.1 gives them: RP25 with x2, not its square. Their references were computed
by `references.py` beside this file.
"""

import csv
import dataclasses
from pathlib import Path

import numpy as np
from scipy import stats

from slowtime.reliability import LimitState, Marginal, Problem, marginal, unknowns


@dataclasses.dataclass(frozen=True)
class Known:
    """A problem, and the probability of its failure."""

    problem: Problem
    exact: float


def normal(mean, sd):
    return marginal("normal", mean=mean, sd=sd)


def lognormal(mean, sd):
    return marginal("lognormal", mean=mean, sd=sd)


def named(laws):
    return {f"x{k + 1}": law for k, law in enumerate(laws)}


def columns(function):
    """Limit state [sample input] of a function of one argument per input."""
    return lambda x: function(*x.T)


def rp63(x):
    return 0.1 * np.sum(x[:, 1:] ** 2, axis=1) - x[:, 0] - 4.5


def rp38(a, b, c, d, e, f, h):
    above = d**2 - 4.0 * e * f * h**2 + d * (f + 4.0 * e + 2.0 * f * h)
    return 15.59e4 - a * b**3 / (2.0 * c**3) * above / (d * e * (d + f + 2.0 * f * h))


def rp55(a, b):
    d = a - b
    curve, line, side = 0.2 + 0.6 * d**4, d / np.sqrt(2.0), 5.0 / np.sqrt(2.0) - 2.2
    return np.minimum.reduce([curve - line, curve + line, d + side, side - d])


def rp57(a, b):
    first, second = -(a**2) + b**3 + 3.0, 2.0 - a - 8.0 * b
    return np.minimum(np.maximum(first, second), (a + 3.0) ** 2 + (b + 3.0) ** 2 - 4.0)


def rp60(a, b, c, d, e):
    middle = np.maximum(d - e, np.minimum(b - e, c - e))
    half = np.minimum.reduce([b, c, d]) - 0.5 * e
    return np.minimum(a - e, np.maximum(half, middle))


def rp91(a, b, c, d, e):
    first = (
        0.847 + 0.96 * b + 0.986 * c - 0.216 * d + 0.077 * b**2 + 0.11 * c**2
        + 7.0 / 378.0 * d**2 - b * c - 0.106 * b * d - 0.11 * c * d
    )  # fmt: skip
    second = 84000.0 * a / np.sqrt(c**2 + d**2 - c * d + 3.0 * e**2) - 1.0
    return np.minimum.reduce([first, second, 84000.0 * a / np.abs(d) - 1.0])


def rp110(a, b):
    first = np.where(a <= 3.5, 0.85 - 0.1 * a, 4.0 - a)
    return np.minimum(first, np.where(b <= 2.0, 2.3 - b, 0.5 - 0.1 * b))


def rp35(a, b):
    return np.minimum(2.0 - b + np.exp(-0.1 * a**2) + (0.2 * a) ** 4, 4.5 - a * b)


def rp14(a, b, c, d, e):
    return a - 32.0 / (np.pi * b**3) * np.sqrt(c**2 * d**2 / 16.0 + e**2)


def rp8(a, b, c, d, e, f):
    return a + 2.0 * b + 2.0 * c + d - 5.0 * e - 5.0 * f


def rp53(a, b):
    return np.sin(2.5 * a) + 2.0 - (a**2 + 4.0) * (b - 1.0) / 20.0


def rp24(a, b):
    return 2.5 - 0.2357 * (a - b) + 0.00463 * (a + b - 20.0) ** 4


def rp22(a, b):
    return 2.5 - (a + b) / np.sqrt(2.0) + 0.1 * (a - b) ** 2


RP: dict[str, tuple[list[Marginal], LimitState]] = {
    "RP8": (
        [lognormal(120.0, 12.0)] * 4 + [lognormal(50.0, 10.0), lognormal(40.0, 8.0)],
        columns(rp8),
    ),
    "RP14": (
        [
            marginal("uniform", lo=70.0, hi=80.0),
            normal(39.0, 0.1),
            marginal("gumbel", mean=1500.0, sd=350.0),
            normal(400.0, 0.1),
            normal(250000.0, 35000.0),
        ],
        columns(rp14),
    ),
    "RP22": ([normal(0.0, 1.0)] * 2, columns(rp22)),
    "RP24": ([normal(10.0, 3.0)] * 2, columns(rp24)),
    "RP25": (
        [normal(0.0, 1.0)] * 2,
        columns(lambda a, b: np.maximum(a**2 - 8.0 * b + 16.0, -16.0 * a + b + 32.0)),
    ),
    "RP28": (
        [normal(78064.0, 11710.0), normal(0.0104, 0.00156)],
        columns(lambda a, b: a * b - 146.14),
    ),
    "RP31": ([normal(0.0, 1.0)] * 2, columns(lambda a, b: 2.0 - b + 256.0 * a**4)),
    "RP33": (
        [normal(0.0, 1.0)] * 3,
        columns(lambda a, b, c: np.minimum(-a - b - c + 3.0 * np.sqrt(3.0), 3.0 - c)),
    ),
    "RP35": ([normal(0.0, 1.0)] * 2, columns(rp35)),
    "RP38": (
        [
            normal(350.0, 35.0),
            normal(50.8, 5.08),
            normal(3.81, 0.381),
            normal(173.0, 17.3),
            normal(9.38, 0.938),
            normal(33.1, 3.31),
            normal(0.036, 0.0036),
        ],
        columns(rp38),
    ),
    "RP53": ([normal(1.5, 1.0), normal(2.5, 1.0)], columns(rp53)),
    "RP54": ([marginal("exponential", mean=1.0)] * 20, lambda x: x.sum(axis=1) - 8.951),
    "RP55": ([marginal("uniform", lo=-1.0, hi=1.0)] * 2, columns(rp55)),
    "RP57": ([normal(0.0, 1.0)] * 2, columns(rp57)),
    "RP60": (
        [
            lognormal(2200.0, 220.0),
            lognormal(2100.0, 210.0),
            lognormal(2300.0, 230.0),
            lognormal(2000.0, 200.0),
            lognormal(1200.0, 480.0),
        ],
        columns(rp60),
    ),
    "RP63": ([normal(0.0, 1.0)] * 100, rp63),
    "RP75": ([normal(0.0, 1.0)] * 2, columns(lambda a, b: 3.0 - a * b)),
    "RP77": (
        [normal(10.0, 0.5), normal(0.0, 1.0), normal(4.0, 1.0)],
        columns(lambda a, b, c: np.where(c <= 5.0, a - b - c, c - b)),
    ),
    "RP89": (
        [normal(0.0, 1.0)] * 2,
        columns(lambda a, b: np.minimum(-(a**2) - b + 8.0, -a / 5.0 - b + 6.0)),
    ),
    "RP91": (
        [
            normal(0.07433, 0.005),
            normal(0.1, 0.01),
            normal(13.0, 60.0),
            normal(4751.0, 48.0),
            normal(-684.0, 11.0),
        ],
        columns(rp91),
    ),
    "RP107": ([normal(0.0, 1.0)] * 10, lambda x: 5.0 * np.sqrt(10.0) - x.sum(axis=1)),
    "RP110": ([normal(0.0, 1.0)] * 2, columns(rp110)),
    "RP111": ([normal(0.0, 1.0)] * 2, columns(lambda a, b: 12.5 - np.abs(a * b))),
}


def plane(beta, size):
    return Problem(unknowns(size), lambda u: beta - u.sum(axis=1) / np.sqrt(size))


def sphere(square, size):
    return Problem(unknowns(size), lambda u: square - np.sum(u**2, axis=1))


def exponentials(most, size):
    laws = [marginal("exponential", mean=1.0)] * size
    return Problem(named(laws), lambda x: most - x.sum(axis=1))


def lognormals(most, size, sd):
    laws = [lognormal(1.0, sd)] * size
    return Problem(named(laws), lambda x: most - x.sum(axis=1))


def beyond_lognormals(most, size, sd, step=2.0**-12):
    """Probability that a sum of lognormal inputs exceeds `most`, by powers of its transform."""
    log_sd = np.sqrt(np.log1p(sd**2))
    law = stats.lognorm(log_sd, scale=np.exp(-0.5 * log_sd**2))
    each = np.diff(law.cdf(np.arange(-0.5, 8.0 / step) * step))
    count = 2**20
    total = np.fft.irfft(np.fft.rfft(each, count) ** size, count)
    return float(total[np.arange(count) * step > most].sum())


def root_of_margin():
    """Strength less load under a root, which is no number where the load is larger."""
    laws = {"r": normal(10.0, 1.0), "s": normal(6.0, 1.0)}

    def g(x):
        with np.errstate(invalid="ignore"):
            return np.sqrt(x[:, 0] - x[:, 1])

    return Problem(laws, g, invalid="fails")


def two_sided(beta):
    return Problem(unknowns(2), lambda u: beta - np.abs(u[:, 0]))


def strength_and_load(log_mean):
    laws = {
        "r": marginal("lognormal", log_mean=log_mean, log_sd=0.1),
        "s": marginal("lognormal", log_mean=0.0, log_sd=0.2),
    }
    return Problem(laws, lambda x: x[:, 0] - x[:, 1])


def parabola(b, kappa):
    return Problem(unknowns(2), lambda u: b - u[:, 1] - kappa * u[:, 0] ** 2)


def four_branch(k):
    def g(u):
        d, s = u[:, 0] - u[:, 1], (u[:, 0] + u[:, 1]) / np.sqrt(2.0)
        bowl = 3.0 + 0.1 * d**2
        return np.minimum.reduce(
            [bowl - s, bowl + s, d + k / np.sqrt(2.0), k / np.sqrt(2.0) - d]
        )

    return Problem(unknowns(2), g)


def directions(count=20, size=10, seed=7):
    """Unit vectors of the planes of the series system [plane input]."""
    ways = np.random.default_rng(seed).standard_normal((count, size))
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


SERIES_BETA = 3.5


def series_of_planes():
    ways = directions()
    return Problem(unknowns(10), lambda u: SERIES_BETA - (u @ ways.T).max(axis=1))


def closed_forms() -> dict[str, Known]:
    """Families whose probability is exact, from 1e-2 down to 1e-6."""
    known = {}
    for p in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        for n in (2, 10, 100):
            known[f"plane {n} {p:.0e}"] = Known(plane(stats.norm.isf(p), n), p)
            known[f"sphere {n} {p:.0e}"] = Known(sphere(stats.chi2.isf(p, n), n), p)
        for n in (2, 5, 20):
            known[f"exponentials {n} {p:.0e}"] = Known(
                exponentials(stats.gamma.isf(p, n), n), p
            )
        known[f"two-sided {p:.0e}"] = Known(two_sided(stats.norm.isf(p / 2.0)), p)
        log_mean = stats.norm.isf(p) * np.hypot(0.1, 0.2)
        known[f"strength and load {p:.0e}"] = Known(strength_and_load(log_mean), p)
    known["lognormals 100"] = Known(
        lognormals(106.0, 100, 0.2), beyond_lognormals(106.0, 100, 0.2)
    )
    known["root of a margin"] = Known(root_of_margin(), stats.norm.sf(4.0 / np.sqrt(2.0)))
    return known


QUADRATURE = {
    "parabola 4 0.2": Known(parabola(4.0, 0.2), 0.000304360266005),
    "parabola 5 0.1": Known(parabola(5.0, 0.1), 8.67099435773e-7),
    "parabola 3 -0.3": Known(parabola(3.0, -0.3), 0.000772926395935),
    "four-branch 7": Known(four_branch(7.0), 0.00222279506619),
    "four-branch 6": Known(four_branch(6.0), 0.00445733149063),
}

REFERENCES = Path(__file__).with_name("references.csv")


def references() -> dict[str, float]:
    with REFERENCES.open() as file:
        return {row["problem"]: float(row["probability"]) for row in csv.DictReader(file)}


def challenge() -> dict[str, Known]:
    exact = references()
    return {name: Known(Problem(named(laws), g), exact[name]) for name, (laws, g) in RP.items()}


def every() -> dict[str, Known]:
    """All problems by name."""
    series = {
        "series of 20 planes": Known(series_of_planes(), references()["series of 20 planes"])
    }
    return closed_forms() | QUADRATURE | series | challenge()
