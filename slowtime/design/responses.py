r"""Responses of a structure to a load, for rows of design variables and inputs.

Peaks of a stationary response over a duration :math:`T` follow Poisson crossings of either
side,

.. math:: P[\max |r| \le a] = \exp\left(-\nu T e^{-a^2 / (2 \sigma^2)}\right),
   \qquad \nu = \frac{\dot\sigma}{\pi \sigma},

so that a peak is a function of one more input, uniform between 0 and 1. Crossings of a lightly
damped response come in clumps, so that such peaks err on the safe side, by 15 % where the
damping is 1 %.

References
----------
.. [1] A. G. Davenport, "Note on the distribution of the largest value of a random function with
   application to gust loading", Proc. ICE 28 (1964) 187-196.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.dynamics.elements import BASE, Spring
from slowtime.dynamics.random_vibration import Shaping, kanai_tajimi

from .additions import AddedStructure
from .stationary import state_matrices, stationary_covariance

NEGLIGIBLE = 1e-9
"""Share of the load in an absolute acceleration below which it is rounding."""

Quantity = Literal["displacement", "velocity", "acceleration", "force"]
Statistic = Literal["rms", "peak", "mean_peak"]
Rows: TypeAlias = Float[np.ndarray, " row"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class NoiseLoad:
    """Stationary noise: base acceleration, or force on one node.

    Parameters
    ----------
    psd
        One-sided [(m/s^2)^2/Hz] of base acceleration, [N^2/Hz] of force.
    node
        Where the force acts; None for base acceleration.
    shaping
        Filter that colours it (`kanai_tajimi`); None for white noise.
    """

    psd: float
    node: str | None = None
    shaping: Shaping | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class HarmonicLoad:
    """Steady harmonic base acceleration [m/s^2] or force [N] on one node."""

    amplitude: float
    frequency_hz: float
    node: str | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RecordedLoad:
    """Samples of base acceleration [m/s^2] or of a force [N] on one node, linear between.

    Parameters
    ----------
    samples
        From rest.
    rate_hz
        Of the samples.
    """

    samples: Float[np.ndarray, " time"]
    rate_hz: float
    node: str | None = None


Load: TypeAlias = NoiseLoad | HarmonicLoad | RecordedLoad


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """One number of the response.

    Parameters
    ----------
    quantity
        Displacement [m], velocity [m/s] (both of the second node less the first), absolute
        acceleration [m/s^2] of one node, or force [N] in the spring and damper `element`.
    between
        Two nodes, `BASE` for the ground.
    element
        Of a force.
    statistic
        ``"rms"``; ``"peak"``: the largest within `duration_s`, as random as it is;
        ``"mean_peak"``: its mean.
    duration_s
        Of the load, for peaks of noise.
    """

    quantity: Quantity
    between: tuple[str, str] = (BASE, BASE)
    element: str | None = None
    statistic: Statistic = "rms"
    duration_s: float | None = None

    def __post_init__(self) -> None:
        if self.duration_s is not None and not 0.0 < self.duration_s < math.inf:
            raise ValueError(f"duration_s={self.duration_s:g}. Give seconds above 0.")


class Responses:
    """Functions from variables and inputs to responses, all of one structure and load.

    Parameters
    ----------
    structure
        With what is added and what scatters.
    load
        Its amplitude is multiplied by the input `intensity`, if there is one.
    wanted
        Which numbers.
    """

    def __init__(
        self, structure: AddedStructure, load: Load, wanted: Sequence[Response]
    ) -> None:
        self.structure, self.load, self.wanted = structure, load, tuple(wanted)
        for one in self.wanted:
            self._check(one)

    @property
    def random_peaks(self) -> tuple[int, ...]:
        """Places of the responses that need a uniform input each."""
        return tuple(
            place
            for place, one in enumerate(self.wanted)
            if one.statistic == "peak" and isinstance(self.load, NoiseLoad)
        )

    def __call__(
        self,
        d: Float[np.ndarray, "row variable"],
        factors: Float[np.ndarray, "row factor"],
        intensity: Rows,
        chances: Float[np.ndarray, "row peak"],
    ) -> Float[np.ndarray, "row response"]:
        """Responses of each row.

        Parameters
        ----------
        d
            Design variables.
        factors
            Of the parts that scatter.
        intensity
            Factor of the load's amplitude.
        chances
            Probability of a smaller peak, of each of `random_peaks`.
        """
        parts = self.structure.matrices(d, factors)
        mass, damping, stiffness = parts["mass"], parts["damping"], parts["stiffness"]
        a = state_matrices(mass, damping, stiffness)
        push = self._push(mass)
        reads = np.stack([self._row(one, a, factors) for one in self.wanted], axis=1)
        direct = self._direct(push)
        match self.load:
            case NoiseLoad():
                unit = self._noise(self.load, a, push, (reads, direct), chances)
            case HarmonicLoad():
                unit = _harmonic(self.load, a, push, (reads, direct))
                unit = self._as_statistic(unit)
            case RecordedLoad():
                peak, rms = _recorded(self.load, a, push, (reads, direct))
                unit = np.where([one.statistic == "rms" for one in self.wanted], rms, peak)
        return np.asarray(intensity[:, None] * unit)

    def stationary(
        self, d: Float[np.ndarray, "row variable"], factors: Float[np.ndarray, "row factor"]
    ) -> tuple[Float[np.ndarray, "row response"], Float[np.ndarray, "row response"]]:
        """Compute standard deviations of the responses to noise, and of their rates.

        Parameters
        ----------
        d
            Design variables, in SI units.
        factors
            Factors on the parts that scatter [1].

        Returns
        -------
        Standard deviations of the responses, and of their rates per second.

        Raises
        ------
        ValueError
            Under another load, or where a motion does not die away.
        """
        if not isinstance(self.load, NoiseLoad):
            raise ValueError("Only noise has a stationary response. Give a noise load.")
        parts = self.structure.matrices(d, factors)
        a = state_matrices(parts["mass"], parts["damping"], parts["stiffness"])
        push = self._push(parts["mass"])
        reads = np.stack([self._row(one, a, factors) for one in self.wanted], axis=1)
        return _deviations(self.load, a, push, (reads, self._direct(push)))

    def _check(self, one: Response) -> None:
        names = [node.id for node in self.structure.description.nodes]
        for node in one.between:
            if node != BASE and node not in names:
                raise ValueError(f"No node is called {node!r}. Nodes: {', '.join(names)}.")
        if one.quantity == "force":
            elements = self.structure.description.elements
            springs = [element.id for element in elements if isinstance(element, Spring)]
            if one.element not in springs:
                raise ValueError(
                    f"Force in {one.element!r} was asked for. Springs: {', '.join(springs)}."
                )
        noise = isinstance(self.load, NoiseLoad)
        white = isinstance(self.load, NoiseLoad) and self.load.shaping is None
        rough = one.quantity == "acceleration" and (
            self.load.node is not None or one.statistic != "rms"
        )
        rough = rough or (one.quantity in ("velocity", "force") and one.statistic != "rms")
        if white and rough:
            raise ValueError(
                f"The {one.statistic} of {one.quantity} under white noise has no end. Give a "
                "coloured load (kanai_tajimi), or ask for displacement."
            )
        if noise and one.statistic != "rms" and one.duration_s is None:
            raise ValueError("A peak under noise needs the duration of the load: duration_s.")

    def _push(self, mass: np.ndarray) -> Float[np.ndarray, "row dof"]:
        """Acceleration of the coordinates by one unit of the load."""
        whole = self.structure.structure
        if self.load.node is None:
            carried = mass @ self.structure.influence
            if whole.base_mass is not None:
                carried = carried + whole.base_mass
            return np.asarray(-np.linalg.solve(mass, carried[:, :, None])[:, :, 0])
        unit = np.tile(self.structure.row_of(self.load.node), (len(mass), 1))
        return np.asarray(np.linalg.solve(mass, unit[:, :, None])[:, :, 0])

    def _row(
        self, one: Response, a: np.ndarray, factors: np.ndarray
    ) -> Float[np.ndarray, "row state"]:
        """Row over the state that gives a response, the load's own direct part apart."""
        dofs = self.structure.structure.dofs
        rows = len(a)
        if one.quantity == "force":
            return self._force_row(one, factors, dofs)
        if one.quantity == "acceleration":
            return np.asarray(
                np.einsum("d,rds->rs", self.structure.row_of(one.between[1]), a[:, dofs:])
            )
        way = np.zeros(2 * dofs)
        offset = dofs if one.quantity == "velocity" else 0
        way[offset : offset + dofs] = self._way(*one.between)
        return np.tile(way, (rows, 1))

    def _force_row(
        self, one: Response, factors: np.ndarray, dofs: int
    ) -> Float[np.ndarray, "row state"]:
        elements = self.structure.description.elements
        spring = next(element for element in elements if element.id == one.element)
        assert isinstance(spring, Spring)
        way = self._way(*spring.between)
        row = np.zeros((len(factors), 2 * dofs))
        held = (spring.stiffness_n_per_m, spring.damping_n_s_per_m)
        for place, (part, value) in enumerate(zip(("stiffness", "damping"), held, strict=True)):
            name = f"{spring.id}.{part}"
            known = self.structure.factors
            factor = factors[:, known.index(name)] if name in known else np.ones(len(factors))
            row[:, place * dofs : (place + 1) * dofs] = value * factor[:, None] * way
        return row

    def _way(self, first: str, second: str) -> np.ndarray:
        return np.asarray(self.structure.row_of(second) - self.structure.row_of(first))

    def _direct(self, push: np.ndarray) -> Float[np.ndarray, "row response"]:
        """Tell what one unit of the load adds to absolute accelerations at once."""
        direct = np.zeros((len(push), len(self.wanted)))
        for place, one in enumerate(self.wanted):
            if one.quantity == "acceleration":
                at = self.structure.row_of(one.between[1])
                direct[:, place] = push @ at + (1.0 if self.load.node is None else 0.0)
        direct[np.abs(direct) < NEGLIGIBLE] = 0.0
        return direct

    def _as_statistic(self, amplitude: np.ndarray) -> np.ndarray:
        rms = np.array([one.statistic == "rms" for one in self.wanted])
        return np.asarray(np.where(rms, amplitude / math.sqrt(2.0), amplitude))

    def _noise(
        self,
        load: NoiseLoad,
        a: np.ndarray,
        push: np.ndarray,
        heard: tuple[np.ndarray, np.ndarray],
        chances: np.ndarray,
    ) -> np.ndarray:
        found, rates = _deviations(load, a, push, heard)
        peaks = list(self.random_peaks)
        for place, one in enumerate(self.wanted):
            if one.statistic == "rms":
                continue
            assert one.duration_s is not None
            crossings = rates[:, place] / (np.pi * found[:, place]) * one.duration_s
            if one.statistic == "mean_peak":
                root = np.sqrt(2.0 * np.log(np.maximum(crossings, math.e)))
                found[:, place] *= root + np.euler_gamma / root
            else:
                u = np.clip(chances[:, peaks.index(place)], 1e-300, 1.0 - 1e-16)
                log = np.log(crossings) - np.log(-np.log(u))
                found[:, place] *= np.sqrt(2.0 * np.maximum(log, 0.0))
        return found


def _deviations(
    load: NoiseLoad, a: np.ndarray, push: np.ndarray, heard: tuple[np.ndarray, np.ndarray]
) -> tuple[Float[np.ndarray, "row response"], Float[np.ndarray, "row response"]]:
    """Compute standard deviations of responses, and of their rates of change."""
    reads, direct = heard
    a, drive, reads = _shaped(load.shaping, a, push, reads, direct)
    noise = 0.5 * load.psd * drive[:, :, None] * drive[:, None, :]
    covariance = stationary_covariance(a, noise)
    return _sd(reads, covariance), _sd(reads @ a, covariance)


def _shaped(
    shaping: Shaping | None,
    a: np.ndarray,
    push: np.ndarray,
    reads: np.ndarray,
    direct: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State matrix, drive and rows of structure and filter together."""
    rows, size = a.shape[:2]
    dofs = size // 2
    if shaping is None:
        if direct.any():
            raise ValueError(
                "An acceleration that follows white noise at once has no end. Give a coloured "
                "load (kanai_tajimi)."
            )
        drive = np.zeros((rows, size))
        drive[:, dofs:] = push
        return a, drive, reads
    read = shaping.output_vector
    more = len(read)
    whole = np.zeros((rows, size + more, size + more))
    whole[:, :size, :size] = a
    whole[:, dofs:size, size:] = push[:, :, None] * read
    whole[:, size:, size:] = shaping.state_matrix
    drive = np.zeros((rows, size + more))
    drive[:, size:] = shaping.input_vector
    return whole, drive, np.concatenate([reads, direct[:, :, None] * read], axis=2)


def _harmonic(
    load: HarmonicLoad, a: np.ndarray, push: np.ndarray, heard: tuple[np.ndarray, np.ndarray]
) -> Float[np.ndarray, "row response"]:
    """Amplitudes of the steady response."""
    reads, direct = heard
    size = a.shape[1]
    drive = np.zeros((len(a), size), dtype=complex)
    drive[:, size // 2 :] = push
    inner = 2j * np.pi * load.frequency_hz * np.eye(size) - a
    state = np.linalg.solve(inner, drive[:, :, None])[:, :, 0]
    moved = np.einsum("rps,rs->rp", reads, state) + direct
    return np.asarray(load.amplitude * np.abs(moved))


def _recorded(
    load: RecordedLoad, a: np.ndarray, push: np.ndarray, heard: tuple[np.ndarray, np.ndarray]
) -> tuple[Float[np.ndarray, "row response"], Float[np.ndarray, "row response"]]:
    """Largest and root mean square; exact for a load that is linear between its samples."""
    reads, direct = heard
    rows, size = a.shape[:2]
    step = 1.0 / load.rate_hz
    whole = np.zeros((rows, size + 2, size + 2))
    whole[:, :size, :size] = a * step
    whole[:, size // 2 : size, size] = push * step
    whole[:, size, size + 1] = 1.0
    flow = scipy.linalg.expm(whole)
    onward = flow[:, :size, :size]
    value, slope = flow[:, :size, size], flow[:, :size, size + 1]
    state = np.zeros((rows, size))
    most = np.zeros(direct.shape)
    square = np.zeros(direct.shape)
    for now, then in zip(load.samples[:-1], load.samples[1:], strict=True):
        state = (onward @ state[:, :, None])[:, :, 0] + now * value + (then - now) * slope
        moved = (reads @ state[:, :, None])[:, :, 0] + then * direct
        np.maximum(most, np.abs(moved), out=most)
        square += moved**2
    return most, np.sqrt(square / max(len(load.samples) - 1, 1))


def _sd(
    reads: Float[np.ndarray, "row response state"], covariance: np.ndarray
) -> Float[np.ndarray, "row response"]:
    square = np.einsum("rps,rst,rpt->rp", reads, covariance, reads, optimize=True)
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


__all__ = [
    "HarmonicLoad",
    "Load",
    "NoiseLoad",
    "RecordedLoad",
    "Response",
    "Responses",
    "kanai_tajimi",
]
