r"""Response of the structure of today under a chosen load, with uncertainty bands.

.. math:: \ln \theta \sim N(\mu, \Sigma), \quad \ln \zeta_j \sim N(\nu_j, s_j^2), \qquad
          M(\theta) \ddot q + C(\theta, \zeta) \dot q + K(\theta) q = f(t)

Structures are drawn, and each is run under the same load: the bands are of what is not known
of the structure. Its damping is modal, as it was measured.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.dynamics.damping import modal_damping
from slowtime.dynamics.simulation import simulate_structure
from slowtime.dynamics.structure import Structure
from slowtime.evolution.change import check_level
from slowtime.evolution.structures import ParametricStructure

from .modal_response import modal_response

QUANTITIES = ("displacement", "velocity", "acceleration")
"""Quantities of a response that can be asked for."""

Runs = Float[np.ndarray, "draw time output"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ParameterBelief:
    """A structure as it is believed to be.

    Parameters
    ----------
    structure
        Nominal matrices, and the parts of them that are not sure.
    theta, covariance
        Logarithms of the factors on these parts.
    log_damping, log_damping_sd
        Logarithms of the damping ratios, of the lowest mode first, independent of each other.
    influence, base_mass
        As of `Structure`: what moves along with the base.
    """

    structure: ParametricStructure
    theta: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    log_damping: Float[np.ndarray, " mode"]
    log_damping_sd: Float[np.ndarray, " mode"]
    influence: Float[np.ndarray, " dof"] | None = None
    base_mass: Float[np.ndarray, " dof"] | None = None

    def thetas(
        self, count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "draw parameter"]:
        """Draw logarithms of the parameter factors.

        Returns
        -------
        One row per draw.
        """
        values, vectors = scipy.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return np.asarray(self.theta + rng.standard_normal((count, len(self.theta))) @ root.T)

    def draw(self, count: int, rng: np.random.Generator) -> Iterator[Structure]:
        """Draw structures."""
        for theta, zeta in self.draw_modal(count, rng):
            yield self.structure_at(theta, zeta)

    def draw_modal(
        self, count: int, rng: np.random.Generator
    ) -> Iterator[tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " mode"]]]:
        """Draw logarithms of the factors, and damping ratios.

        Parameters
        ----------
        count
            Number of draws.

        Returns
        -------
        Both, draw by draw.
        """
        thetas = self.thetas(count, rng)
        away = rng.standard_normal((count, len(self.log_damping)))
        # Beyond this a mode would not swing, which those measured do.
        ratios = np.minimum(np.exp(self.log_damping + away * self.log_damping_sd), 0.95)
        yield from zip(thetas, ratios, strict=True)

    def structure_at(
        self, theta: Float[np.ndarray, " parameter"], ratios: Float[np.ndarray, " mode"]
    ) -> Structure:
        """Structure at logarithms of the factors, with a damping ratio for each mode."""
        mass, stiffness = self.structure.matrices(theta)
        return Structure(
            mass=mass,
            stiffness=stiffness,
            damping=_symmetric(modal_damping(mass, stiffness, ratios)),
            names=self.structure.dof_names,
            influence=self.influence,
            base_mass=self.base_mass,
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """What many runs have in common.

    Parameters
    ----------
    mean, sd, lo, hi
        At each time, of each output; `lo` and `hi` are quantiles.
    peak, rms
        Mean, sd, lo and hi of each output's largest magnitude, and of its root mean square.
    """

    mean: Float[np.ndarray, "time output"]
    sd: Float[np.ndarray, "time output"]
    lo: Float[np.ndarray, "time output"]
    hi: Float[np.ndarray, "time output"]
    peak: Float[np.ndarray, "output 4"]
    rms: Float[np.ndarray, "output 4"]


def response_runs(
    believed: ParameterBelief,
    load: Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    on: str | None,
    outputs: Sequence[str],
    quantity: str = "acceleration",
    draws: int = 400,
    rng: np.random.Generator,
) -> Runs:
    """Simulate drawn structures from rest under a load that is linear between its samples.

    Parameters
    ----------
    believed
        Belief about the parameters of the structure.
    load
        Force on the degree of freedom `on` [N], or acceleration of the base [m/s^2].
    rate_hz
        Sampling rate of the load [Hz].
    on
        None for the base.
    outputs
        Degrees of freedom that are looked at.
    quantity
        Displacement [m] and velocity [m/s] against the base; acceleration in space [m/s^2].
    draws, rng
        How many structures, and where their randomness comes from.

    Returns
    -------
    Response of each draw, in SI units.
    """
    if quantity not in QUANTITIES:
        raise ValueError(f"{quantity=} is none of {', '.join(QUANTITIES)}.")
    which, runs = QUANTITIES.index(quantity), np.empty((draws, len(load), len(outputs)))
    names = believed.structure.dof_names
    rows = np.array([[float(name == out) for name in names] for out in outputs])
    for number, (theta, ratios) in enumerate(believed.draw_modal(draws, rng)):
        matrices = believed.structure.matrices(theta)
        pushed = _pushed(believed, matrices[0], on)
        found = modal_response(matrices, ratios, pushed, load, rate_hz, rows=rows, order=which)
        if found is not None:
            if on is None and which == 2 and believed.influence is not None:
                found = found + np.multiply.outer(load, rows @ believed.influence)
            runs[number] = found
            continue
        structure = believed.structure_at(theta, ratios)
        if on is None:
            force = structure.base_force(load)
        else:
            force = np.zeros((len(load), structure.dofs))
            force[:, structure.dof(on)] = load
        motion = simulate_structure(structure, force, rate_hz, hold="first")[which]
        if on is None and which == 2 and structure.influence is not None:
            motion = motion + np.multiply.outer(load, structure.influence)
        runs[number] = motion[:, [structure.dof(name) for name in outputs]]
    return runs


def _pushed(
    believed: ParameterBelief, mass: Float[np.ndarray, "dof dof"], on: str | None
) -> Float[np.ndarray, " dof"]:
    """Force on each degree of freedom per unit of the load, on one of them or by the base."""
    if on is not None:
        return np.array([float(name == on) for name in believed.structure.dof_names])
    carried = Structure(
        mass=mass,
        damping=np.zeros_like(mass),
        stiffness=believed.structure.stiffness,
        influence=believed.influence,
        base_mass=believed.base_mass,
    )
    return np.asarray(carried.base_force(np.ones(1))[0])


def bands(runs: Runs, level: float = 0.95) -> Bands:
    """Mean and interval of the response over all runs.

    Parameters
    ----------
    runs
        Simulated runs.
    level
        Probability of the interval.

    Returns
    -------
    Bands at each time.

    Examples
    --------
    >>> found = bands(np.arange(101.0).reshape(101, 1, 1), level=0.9)
    >>> np.ravel([found.mean, found.lo, found.hi]).round(9)
    array([50.,  5., 95.])
    """
    check_level(level)
    ends = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
    lo, hi = np.quantile(runs, ends, axis=0)
    peak, rms = np.abs(runs).max(axis=1), np.sqrt((runs**2).mean(axis=1))
    return Bands(
        runs.mean(axis=0), runs.std(axis=0), lo, hi, _summary(peak, ends), _summary(rms, ends)
    )


def _summary(
    each: Float[np.ndarray, "draw output"], ends: Sequence[float]
) -> Float[np.ndarray, "output 4"]:
    lo, hi = np.quantile(each, ends, axis=0)
    return np.column_stack((each.mean(axis=0), each.std(axis=0), lo, hi))


def _symmetric(matrix: Float[np.ndarray, "dof dof"]) -> Float[np.ndarray, "dof dof"]:
    return np.asarray(0.5 * (matrix + matrix.T))
