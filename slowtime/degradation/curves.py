r"""Degradation laws that are curves: their shapes over the age.

Each curve is :math:`x(t) = f(s) + \sum_j \beta_j h_j(s; u)` with s the scaled age, linear
coefficients :math:`\beta` (level, amplitude) and at most a few shape parameters u with a
standard normal prior. The linear coefficients are integrated analytically.
"""

import dataclasses
from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

Points: TypeAlias = Float[np.ndarray, "point shape"]
Shape: TypeAlias = Callable[[Points, np.ndarray], np.ndarray]

_LARGEST = 1e3
"""Change over that in the history beyond which no curve goes [1]."""

_RATE = 2.0
"""Prior sd of the rate of a fade over the history [1]."""

_PERIODS, _PERIODS_WIDTH = 4.0, 1.2
"""Median a priori of the periods in a history, and the sd of their logarithm [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Curve:
    """A law that is a curve over the age.

    Parameters
    ----------
    name
        By which weights are told.
    shape
        Points [point, shape] and scaled ages [age] to values [point, age]: how the curve
        grows, before it is scaled to change by one over the history.
    names
        Of the shape parameters; their prior is standard normal.
    fades
        Whether the curve fades to total loss: then `shape` is the remaining share, and beside
        its level there is only an error of the nominal model.
    harmonics
        Harmonics of a wave beside the curve, each with a cosine and a sine; where the curve
        fades, the wave fades with it. The last shape parameter is the number of its periods
        in the history (`periods_of`).
    broken
        Whether the curve has a step or a bend at an unknown place. Its only shape parameter is
        then the place, over the history, a priori uniform.
    """

    name: str
    shape: Shape
    names: tuple[str, ...] = ()
    fades: bool = False
    harmonics: int = 0
    broken: Literal["step", "bend"] | None = None


def linear(points: Points, age: np.ndarray) -> np.ndarray:
    """Scaled age itself: a drift at a constant rate."""
    return np.broadcast_to(age, (len(points), age.shape[-1]))


def fade(points: Points, age: np.ndarray) -> np.ndarray:
    """Share that remains, :math:`e^{-a s}`, with a rate that may have either sign."""
    rate = _RATE * points[:, :1]
    return np.asarray(np.exp(np.clip(-rate * age, -60.0, 60.0)))


def point_of_rate(rate: float) -> float:
    """Convert a rate of `fade` to its shape parameter."""
    return rate / _RATE


def power(points: Points, age: np.ndarray) -> np.ndarray:
    r"""Power of the scaled age, :math:`s^b` with :math:`\ln b \sim N(0, 0.6^2)`."""
    exponent = np.exp(0.6 * points[:, :1])
    return np.asarray(np.maximum(age, 0.0) ** exponent)


def logistic(points: Points, age: np.ndarray) -> np.ndarray:
    """Logistic growth :math:`1 / (1 + e^{-r (s - s_0)})`: slow, fast, and slow again.

    A priori the rate r is about 3 over the history, within a factor of two, and the middle
    :math:`s_0` is somewhat after the last reading.
    """
    rate = 3.0 * np.exp(0.7 * points[:, :1])
    middle = 1.5 * np.exp(0.6 * points[:, 1:2])
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(-rate * (age - middle), -60.0, 60.0))))


def crack(points: Points, age: np.ndarray) -> np.ndarray:
    r"""Compliance of a member with an edge crack that grows by Paris' law.

    .. math:: \frac{da}{dN} = C (\Delta K)^m, \quad \Delta K \propto \sqrt{a}
              \;\Rightarrow\; \alpha(s) = \alpha_0 (1 - s / s_f)^{-2 / (m - 2)}

    with :math:`\alpha` the crack over the depth. The cracked member gives in as
    :math:`1 - 1 / (1 + \kappa V(\alpha))` with V the flexibility of a single edge crack in
    bending. Beyond :math:`\alpha = 0.95` the member has broken.

    References
    ----------
    .. [1] P. Paris and F. Erdogan, "A critical analysis of crack propagation laws" (1963).
    .. [2] H. Tada, P. C. Paris and G. R. Irwin, "The Stress Analysis of Cracks Handbook",
       single edge notch in pure bending.
    """
    exponent = 2.2 + 1.0 * np.exp(0.5 * points[:, :1])
    end = 1.0 + 1.2 * np.exp(1.0 * points[:, 1:2])
    first = 0.08 * np.exp(0.7 * points[:, 2:3])
    compliance = 0.5 * np.exp(1.0 * points[:, 3:4])
    left = np.maximum(1.0 - age / end, 1e-9)
    depth = np.minimum(np.minimum(first, 0.5) * left ** (-2.0 / (exponent - 2.0)), 0.95)
    flexible = compliance * edge_flexibility(depth)
    return np.asarray(flexible / (1.0 + flexible))


def edge_flexibility(depth: np.ndarray) -> np.ndarray:
    """Flexibility of a single edge crack in pure bending.

    References
    ----------
    .. [1] H. Tada, P. C. Paris and G. R. Irwin, "The Stress Analysis of Cracks Handbook",
       single edge notch in pure bending.
    """
    factor = 5.93 + depth * (-19.69 + depth * (37.14 + depth * (-35.84 + 13.12 * depth)))
    return np.asarray((depth / (1.0 - depth)) ** 2 * factor)


def exponential(points: Points, age: np.ndarray) -> np.ndarray:
    r"""Exponential growth, :math:`(e^{r s} - 1) / r`, which saturates where r < 0.

    A priori r has a standard deviation of 3.
    """
    rate = 3.0 * points[:, :1]
    rate = np.where(np.abs(rate) < 1e-6, 1e-6, rate)
    return np.asarray(np.expm1(np.clip(rate * age, -60.0, 60.0)) / rate)


def runaway(points: Points, age: np.ndarray) -> np.ndarray:
    r"""Growth without bound at a finite age, :math:`(1 - s / s_f)^{-q}`.

    Damage that grows as a power above one of itself does so; from the end on it stays as large
    as it was shortly before. A priori the end :math:`s_f` is 1.6 histories after the start,
    within 1.06 and 7 with 95 %, and q is 1, within a factor of three.

    References
    ----------
    .. [1] B. Voight, "A relation to describe rate-dependent material failure", Science 243
       (1989).
    """
    end = 1.0 + 0.6 * np.exp(1.2 * points[:, :1])
    order = np.exp(0.6 * points[:, 1:2])
    return np.asarray(np.maximum(1.0 - age / end, 1e-3) ** -order)


def periods_of(point: np.ndarray) -> np.ndarray:
    """Convert to the number of periods of a wave in the history."""
    # A priori it is between 0.4 and 40 with 95 %.
    return np.asarray(_PERIODS * np.exp(_PERIODS_WIDTH * point))


def points_of_periods(periods: np.ndarray) -> np.ndarray:
    """Shape parameters of numbers of periods: the inverse of `periods_of`."""
    return np.asarray(np.log(periods / _PERIODS) / _PERIODS_WIDTH)


LINEAR = Curve("linear drift", linear)
FADE = Curve("exponential fade", fade, ("rate",), fades=True)
POWER = Curve("power law", power, ("exponent",))
LOGISTIC = Curve("logistic", logistic, ("rate", "middle"))
CRACK = Curve("Paris crack", crack, ("exponent", "end", "depth", "compliance"))
EXPONENTIAL = Curve("exponential growth", exponential, ("rate",))
RUNAWAY = Curve("runaway growth", runaway, ("end", "order"))
BREATHING = Curve("oscillating fade", fade, ("rate", "periods"), fades=True, harmonics=1)
SEASONAL = Curve("seasonal drift", linear, ("periods",), harmonics=2)
BENT = Curve("bent line", linear, ("place",), broken="bend")
STEPPED = Curve("stepped line", linear, ("place",), broken="step")


def columns(curve: Curve, points: Points, age: np.ndarray) -> np.ndarray:
    """Columns of the linear coefficients of a curve: level, scaled growth, and what is beside.

    Where the curve fades, the first two are the remaining share and a constant.
    """
    grown = curve.shape(points, age)
    if curve.fades:
        found = [grown, np.ones_like(grown)]
    else:
        ends = curve.shape(points, np.array([0.0, 1.0]))
        over = ends[:, 1:] - ends[:, :1]
        scaled = (grown - ends[:, :1]) / np.where(np.abs(over) > 1e-12, over, 1e-12)
        found = [np.ones_like(scaled), np.clip(scaled, -_LARGEST, _LARGEST)]
    if curve.broken is not None:
        beyond = age - points[:, :1]
        found.append(beyond > 0.0 if curve.broken == "step" else np.maximum(beyond, 0.0))
    if curve.harmonics:
        turn = 2.0 * np.pi * periods_of(points[:, -1:]) * age
        envelope = grown if curve.fades else 1.0
        for harmonic in range(1, curve.harmonics + 1):
            found += [envelope * np.cos(harmonic * turn), envelope * np.sin(harmonic * turn)]
    return np.stack(found, axis=-1)
