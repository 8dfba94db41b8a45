"""Marginal distributions by standard names, mapped from standard normal scores."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float
from scipy import optimize, special

Build = Callable[..., Any]
"""From parameters to a frozen distribution of `scipy.stats`."""


def _normal(*, mean: float, sd: float) -> Any:
    return scipy.stats.norm(mean, sd)


def _lognormal(*, mean: float, sd: float) -> Any:
    square = math.log1p((sd / mean) ** 2)
    return scipy.stats.lognorm(math.sqrt(square), scale=mean * math.exp(-0.5 * square))


def _lognormal_log(*, log_mean: float, log_sd: float) -> Any:
    return scipy.stats.lognorm(log_sd, scale=math.exp(log_mean))


def _gumbel(*, mean: float, sd: float) -> Any:
    scale = sd * math.sqrt(6.0) / math.pi
    return scipy.stats.gumbel_r(mean - np.euler_gamma * scale, scale)


def _gumbel_min(*, mean: float, sd: float) -> Any:
    scale = sd * math.sqrt(6.0) / math.pi
    return scipy.stats.gumbel_l(mean + np.euler_gamma * scale, scale)


def _weibull(*, mean: float, sd: float) -> Any:
    def spread(log_shape: float) -> float:
        k = math.exp(log_shape)
        logs = special.gammaln(1.0 + 2.0 / k) - 2.0 * special.gammaln(1.0 + 1.0 / k)
        return float(np.log(np.expm1(logs)) - 2.0 * math.log(sd / mean))

    shape = math.exp(optimize.brentq(spread, math.log(0.1), math.log(500.0)))
    return scipy.stats.weibull_min(shape, scale=mean / special.gamma(1.0 + 1.0 / shape))


def _frechet(*, mean: float, sd: float) -> Any:
    def spread(log_over: float) -> float:
        k = 2.0 + math.exp(log_over)
        logs = special.gammaln(1.0 - 2.0 / k) - 2.0 * special.gammaln(1.0 - 1.0 / k)
        return float(np.log(np.expm1(logs)) - 2.0 * math.log(sd / mean))

    shape = 2.0 + math.exp(optimize.brentq(spread, -20.0, math.log(500.0)))
    return scipy.stats.invweibull(shape, scale=mean / special.gamma(1.0 - 1.0 / shape))


def _uniform(*, mean: float, sd: float) -> Any:
    half = math.sqrt(3.0) * sd
    return scipy.stats.uniform(mean - half, 2.0 * half)


def _beta(*, mean: float, sd: float, lo: float, hi: float) -> Any:
    m, v = (mean - lo) / (hi - lo), (sd / (hi - lo)) ** 2
    total = m * (1.0 - m) / v - 1.0
    if not 0.0 < m < 1.0 or total <= 0.0:
        raise ValueError(f"{mean=} with {sd=} does not fit into [{lo}, {hi}]. Lower sd.")
    return scipy.stats.beta(m * total, (1.0 - m) * total, lo, hi - lo)


def _gamma(*, mean: float, sd: float) -> Any:
    return scipy.stats.gamma((mean / sd) ** 2, scale=sd**2 / mean)


def _triangular(*, lo: float, mode: float, hi: float) -> Any:
    return scipy.stats.triang((mode - lo) / (hi - lo), lo, hi - lo)


def _truncated_normal(*, parent_mean: float, parent_sd: float, lo: float, hi: float) -> Any:
    ends = (lo - parent_mean) / parent_sd, (hi - parent_mean) / parent_sd
    return scipy.stats.truncnorm(*ends, parent_mean, parent_sd)


FAMILIES: Mapping[str, tuple[tuple[tuple[str, ...], Build], ...]] = {
    "normal": ((("mean", "sd"), _normal),),
    "lognormal": (
        (("mean", "sd"), _lognormal),
        (("log_mean", "log_sd"), _lognormal_log),
    ),
    "gumbel": (
        (("mean", "sd"), _gumbel),
        (
            ("location", "scale"),
            lambda *, location, scale: scipy.stats.gumbel_r(location, scale),
        ),
    ),
    "gumbel_min": (
        (("mean", "sd"), _gumbel_min),
        (
            ("location", "scale"),
            lambda *, location, scale: scipy.stats.gumbel_l(location, scale),
        ),
    ),
    "weibull": (
        (("mean", "sd"), _weibull),
        (
            ("scale", "shape"),
            lambda *, scale, shape: scipy.stats.weibull_min(shape, scale=scale),
        ),
        (
            ("location", "scale", "shape"),
            lambda *, location, scale, shape: scipy.stats.weibull_min(shape, location, scale),
        ),
    ),
    "frechet": (
        (("mean", "sd"), _frechet),
        (
            ("scale", "shape"),
            lambda *, scale, shape: scipy.stats.invweibull(shape, scale=scale),
        ),
    ),
    "uniform": (
        (("lo", "hi"), lambda *, lo, hi: scipy.stats.uniform(lo, hi - lo)),
        (("mean", "sd"), _uniform),
    ),
    "beta": (
        (("a", "b", "lo", "hi"), lambda *, a, b, lo, hi: scipy.stats.beta(a, b, lo, hi - lo)),
        (("mean", "sd", "lo", "hi"), _beta),
    ),
    "gamma": (
        (("mean", "sd"), _gamma),
        (("shape", "scale"), lambda *, shape, scale: scipy.stats.gamma(shape, scale=scale)),
    ),
    "exponential": (
        (("mean",), lambda *, mean: scipy.stats.expon(scale=mean)),
        (
            ("location", "mean"),
            lambda *, location, mean: scipy.stats.expon(location, mean - location),
        ),
    ),
    "triangular": ((("lo", "mode", "hi"), _triangular),),
    "truncated_normal": ((("parent_mean", "parent_sd", "lo", "hi"), _truncated_normal),),
    "rayleigh": ((("scale",), lambda *, scale: scipy.stats.rayleigh(scale=scale)),),
    "logistic": ((("mean", "sd"), lambda *, mean, sd: scipy.stats.logistic(
        mean, sd * math.sqrt(3.0) / math.pi)),),
    "student_t": (
        (("location", "scale", "freedom"),
         lambda *, location, scale, freedom: scipy.stats.t(freedom, location, scale)),
    ),
}  # fmt: skip
"""Name → ways to state its parameters, each with what builds the distribution."""

CLOSED: Mapping[str, Callable[..., np.ndarray]] = {
    "norm": lambda z: z,
    "lognorm": lambda z, sd: np.exp(sd * z),
    "uniform": special.ndtr,
    "expon": lambda z: -special.log_ndtr(-z),
    "gumbel_r": lambda z: -np.log(-special.log_ndtr(z)),
    "gumbel_l": lambda z: np.log(-special.log_ndtr(-z)),
    "weibull_min": lambda z, k: (-special.log_ndtr(-z)) ** (1.0 / k),
    "invweibull": lambda z, k: (-special.log_ndtr(z)) ** (-1.0 / k),
}
"""Distribution of `scipy.stats` → its standard form as a function of the normal score."""


def _parts(law: Any) -> tuple[tuple[float, ...], float, float]:
    """Shapes, location and scale of a frozen distribution."""
    count = law.dist.numargs
    rest = dict(zip(("loc", "scale"), law.args[count:], strict=False)) | law.kwds
    named = [name.strip() for name in (law.dist.shapes or "").split(",") if name]
    shapes = law.args[:count] + tuple(law.kwds[k] for k in named[len(law.args[:count]) :])
    return shapes, float(rest.get("loc", 0.0)), float(rest.get("scale", 1.0))


POSITIVE = ("sd", "scale", "shape", "log_sd", "a", "b", "parent_sd", "freedom")
MEAN_POSITIVE = ("lognormal", "weibull", "frechet", "gamma")


@dataclasses.dataclass(frozen=True, slots=True)
class Marginal:
    """Distribution of one input."""

    law: Any
    """A frozen distribution of `scipy.stats`."""

    name: str = "scipy"
    parameters: tuple[tuple[str, float], ...] = ()

    @property
    def mean(self) -> float:
        """Mean, in the unit of the input."""
        return float(self.law.mean())

    @property
    def sd(self) -> float:
        """Standard deviation, in the unit of the input."""
        return float(self.law.std())

    def of_score(self, z: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        r"""Value :math:`F^{-1}(\Phi(z))` of a score, accurate in both tails.

        Parameters
        ----------
        z
            Standard normal scores.

        Returns
        -------
        Values in the unit of the input.
        """
        name = getattr(getattr(self.law, "dist", None), "name", "")
        if name in CLOSED:
            shapes, location, scale = _parts(self.law)
            return np.asarray(location + scale * CLOSED[name](z, *shapes))
        # Of large values the probability of exceeding keeps digits that its complement loses.
        tail = special.ndtr(-np.abs(z))
        x = np.empty_like(tail)
        below = z < 0.0
        x[below], x[~below] = self.law.ppf(tail[below]), self.law.isf(tail[~below])
        return np.asarray(x)

    def score(self, x: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        r"""Score :math:`\Phi^{-1}(F(x))` of a value, accurate in both tails.

        Parameters
        ----------
        x
            Values in the unit of the input.

        Returns
        -------
        Standard normal scores.
        """
        below, above = self.law.cdf(x), self.law.sf(x)
        return np.asarray(np.where(below < above, special.ndtri(below), -special.ndtri(above)))


def marginal(name: str, **parameters: float) -> Marginal:
    """Distribution by its name and parameters, as `FAMILIES` lists them.

    Raises
    ------
    ValueError
        For an unknown name, other parameters than one of its sets, or impossible values.

    Examples
    --------
    >>> round(marginal("lognormal", mean=10.0, sd=2.0).sd, 6)
    2.0
    >>> marginal("uniform", lo=0.0, hi=2.0).of_score(np.zeros(1))
    array([1.])
    """
    if name not in FAMILIES:
        raise ValueError(f"Marginal {name!r} is not known. Allowed: {', '.join(FAMILIES)}.")
    ways = FAMILIES[name]
    for wanted, build in ways:
        if set(wanted) == set(parameters):
            _refuse_impossible(name, parameters)
            return Marginal(build(**parameters), name, tuple(parameters.items()))
    allowed = " or ".join(f"({', '.join(wanted)})" for wanted, _ in ways)
    given = ", ".join(parameters) or "nothing"
    raise ValueError(f"Marginal {name!r} takes {allowed}, not ({given}).")


def _refuse_impossible(name: str, parameters: Mapping[str, float]) -> None:
    for key, value in parameters.items():
        if not math.isfinite(value):
            raise ValueError(f"{key}={value} of marginal {name!r} is not finite.")
        if key in POSITIVE and value <= 0.0:
            raise ValueError(f"{key}={value:g} of marginal {name!r} is not positive.")
    if name in MEAN_POSITIVE and parameters.get("mean", 1.0) <= 0.0:
        raise ValueError(f"mean={parameters['mean']:g} of marginal {name!r} is not positive.")
    if name == "exponential" and parameters["mean"] <= parameters.get("location", 0.0):
        raise ValueError("The mean of an exponential marginal is not above its location.")
    lo, hi = parameters.get("lo", 0.0), parameters.get("hi", math.inf)
    if not lo < hi:
        raise ValueError(f"lo={lo:g} of marginal {name!r} is not below hi={hi:g}.")
    if not lo <= parameters.get("mode", lo) <= hi:
        raise ValueError(f"mode={parameters['mode']:g} is outside [{lo:g}, {hi:g}].")


def as_marginal(given: Any) -> Marginal:
    """Take a `Marginal` as it is, and a frozen distribution of `scipy.stats` as one."""
    if isinstance(given, Marginal):
        return given
    if all(hasattr(given, name) for name in ("ppf", "isf", "cdf", "sf", "mean", "std")):
        return Marginal(given)
    raise TypeError(
        f"{given!r} is not a valid distribution. Give marginal('normal', "
        "mean=..., sd=...) or a frozen "
        "distribution of scipy.stats."
    )
