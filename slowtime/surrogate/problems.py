"""Test functions with known answers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.stats import qmc

from slowtime.dynamics.builders import shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes

from .bases import Law

Outputs = Float[np.ndarray, " sample"]
Inputs = Float[np.ndarray, "sample input"]


@dataclass(frozen=True, slots=True)
class BoxProblem:
    """A function of uniform inputs between two corners."""

    name: str
    function: Callable[[np.ndarray], np.ndarray]
    lo: Float[np.ndarray, " input"]
    hi: Float[np.ndarray, " input"]

    @property
    def marginals(self) -> list[Law]:
        """Law of each input."""
        return [stats.uniform(a, b - a) for a, b in zip(self.lo, self.hi, strict=True)]

    def design(self, points: int, rng: np.random.Generator) -> tuple[Inputs, Outputs]:
        """Latin hypercube and its outputs."""
        unit = qmc.LatinHypercube(len(self.lo), rng=rng).random(points)
        inputs = qmc.scale(unit, self.lo, self.hi)
        return inputs, self.function(inputs)

    def draws(self, points: int, rng: np.random.Generator) -> tuple[Inputs, Outputs]:
        """Independent points and their outputs, to be judged by."""
        inputs = rng.uniform(self.lo, self.hi, (points, len(self.lo)))
        return inputs, self.function(inputs)


def ishigami(x: Inputs, a: float = 7.0, b: float = 0.1) -> Outputs:
    r""":math:`\sin x_1 + a \sin^2 x_2 + b x_3^4 \sin x_1` on :math:`[-\pi, \pi]^3`.

    Parameters
    ----------
    x
        Points [sample, 3].
    a, b
        Coefficients of the function [1].

    Returns
    -------
    Values [sample].

    References
    ----------
    .. [1] T. Ishigami and T. Homma, "An importance quantification technique in uncertainty
       analysis for computer models", Proc. ISUMA (1990) 398-403.
    """
    return np.asarray(
        np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])
    )


def ishigami_sobol(a: float = 7.0, b: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """First-order and total Sobol indices of `ishigami`, in closed form.

    Parameters
    ----------
    a, b
        Coefficients of the function [1].

    Returns
    -------
    First-order and total index of each input [1].

    Examples
    --------
    >>> ishigami_sobol()[0].round(4)
    array([0.3139, 0.4424, 0.    ])
    """
    pi = np.pi
    alone = np.array([0.5 * (1.0 + b * pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    pair = b**2 * pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = alone.sum() + pair
    return alone / variance, (alone + pair * np.array([1.0, 0.0, 1.0])) / variance


def borehole(x: Inputs) -> Outputs:
    """Flow of water through a borehole [m³/yr].

    Parameters
    ----------
    x
        Radius of the borehole [m], radius of influence [m], transmissivity [m²/yr] and head [m]
        of the upper aquifer, the same of the lower one, length [m] and conductivity [m/yr] of
        the borehole [sample, 8].

    References
    ----------
    .. [1] M. D. Morris, T. J. Mitchell and D. Ylvisaker, "Bayesian design and analysis of
       computer experiments", Technometrics 35 (1993) 243-255.
    """
    radius, reach, upper, upper_head, lower, lower_head, length, conductivity = x.T
    log = np.log(reach / radius)
    leak = 2.0 * length * upper / (log * radius**2 * conductivity)
    flow = (
        2.0 * np.pi * upper * (upper_head - lower_head) / (log * (1.0 + leak + upper / lower))
    )
    return np.asarray(flow)


SOBOL_G = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0])


def sobol_g(x: Inputs, a: np.ndarray = SOBOL_G) -> Outputs:
    r""":math:`\prod_i (|4 x_i - 2| + a_i) / (1 + a_i)` on the unit cube, which has many kinks.

    Parameters
    ----------
    x
        Points [sample, input].
    a
        Coefficient of each input [1]: the larger, the less the input matters.

    Returns
    -------
    Values [sample].
    """
    return np.asarray(np.prod((np.abs(4.0 * x - 2.0) + a) / (1.0 + a), axis=1))


def frame_frequency(x: Inputs) -> Outputs:
    """First natural frequency of a shear frame of five storeys.

    Parameters
    ----------
    x
        Relative changes of the stiffness of each storey, then of the mass of each floor, from
        the lowest upwards [sample, 10]; as built, 100 MN/m and 50 t each.

    Returns
    -------
    Frequencies [Hz].
    """
    storeys, floors = 1e8 * (1.0 + x[:, :5]), 5e4 * (1.0 + x[:, 5:])
    found = []
    for stiffness, mass in zip(storeys.tolist(), floors.tolist(), strict=True):
        modes = undamped_modes(assemble(shear_frame(mass, stiffness)))
        found.append(modes.frequency_hz[0])
    return np.array(found)


def _box(name: str, function: Callable[[np.ndarray], np.ndarray], *ends: float) -> BoxProblem:
    corners = np.array(ends).reshape(-1, 2).T
    return BoxProblem(name, function, corners[0], corners[1])


PROBLEMS: dict[str, BoxProblem] = {
    one.name: one
    for one in (
        _box("Ishigami", ishigami, *(-np.pi, np.pi) * 3),
        _box(
            "Borehole",
            borehole,
            *(0.05, 0.15, 100.0, 50000.0, 63070.0, 115600.0, 990.0, 1110.0),
            *(63.1, 116.0, 700.0, 820.0, 1120.0, 1680.0, 9855.0, 12045.0),
        ),
        _box("Sobol-G", sobol_g, *(0.0, 1.0) * 8),
        _box("frame", frame_frequency, *(-0.3, 0.3) * 10),
    )
}
