r"""Equivalent stiffness and damping of one element, by record, under random motion.

A force :math:`F(e, v)` of an element whose elongation is random acts on the spectra like

.. math:: k_r = \mathrm{E}[F e] / \mathrm{E}[e^2] , \quad
          c_r = \mathrm{E}[F v] / \mathrm{E}[v^2]

which depend on the level of record :math:`r` (statistical linearisation). The averages are
those over a normal motion with the spectrum that the fit gives the element, so that laws with
memory are linearised like any other.

References
----------
.. [1] J. B. Roberts and P. D. Spanos, "Random Vibration and Statistical Linearization" (1990).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.fft
from jaxtyping import Float

from slowtime.discrepancy.localization import LinearModel
from slowtime.dynamics.description import OpenJoint
from slowtime.dynamics.effects import Kind, Motion, Place, force_along

from .spectra import AmbientFit, ConstantChange, SpectralProblem

SAMPLES = 2**14
"""[samples] Of a simulated motion. Source: some hundred periods of the lowest mode, over which
averages scatter by some per cent."""
OVERSAMPLING = 8.0
"""[1] Sampling rate of a simulated motion over the highest frequency of the lines. Source:
more than ten samples for each period, so that kinks of a law are met."""
BLOCKS = 32
"""[blocks] Of a motion, over which the scatter of an equivalent is judged. Source: some
periods of the lowest mode in each, and a scatter known to an eighth."""
CENTRE_STEPS = 4
"""[iterations] For the mean elongation under a law that is not odd. Source: the secant rule
gains a digit with each."""
PRIOR_RATIO = 3.0
"""[1] Prior standard deviation of an equivalent stiffness over that of the element, and of an
equivalent damping over stiffness by the lowest circular frequency. Source: a decision: wide
beside what a law adds to an element."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ElementMotion:
    """A normal motion of an element in one record.

    `static_m_per_n` is the elongation for each unit of a constant force of the element.
    """

    motion: Motion
    static_m_per_n: float
    records: float = 1.0

    @property
    def size_m(self) -> float:
        """Root mean square of the elongation [m]."""
        return float(np.sqrt(np.mean(self.motion.e**2)))

    def equivalents(self, kind: Kind, parameters: Mapping[str, float]) -> tuple[float, ...]:
        """Give the stiffness [N/m] and damping [N s/m], or mass [kg] of a node, of a law."""
        e, v, a = self.motion.e, self.motion.v, self.motion.a
        if kind.where == "node":
            inertia = -force_along(kind, parameters, self.motion)
            return (float(inertia @ a / (a @ a)),)
        force = self._centred(kind, parameters)
        force = force - force.mean()
        return float(force @ e / (e @ e)), float(force @ v / (v @ v))

    def nonlinear(
        self, kind: Kind, parameters: Mapping[str, float]
    ) -> tuple[float, tuple[float, float]]:
        """Measure what a law has beyond its equivalents, and by how much these vary for it.

        Gives the root mean square of the rest over that of the linear force [1], and variances
        of stiffness [N²/m²] and damping [N²s²/m²] in one record. The law's force must not
        depend on time.
        """
        e, v = self.motion.e, self.motion.v
        force = self._centred(kind, parameters)
        force = force - force.mean()
        linear = (force @ e / (e @ e)) * e + (force @ v / (v @ v)) * v
        rest, varied = force - linear, []
        for one in (e, v):
            parts = (np.array_split(product, BLOCKS) for product in (rest * one, one**2))
            each = [more.sum() / square.sum() for more, square in zip(*parts, strict=True)]
            varied.append(self.records * np.var(each) / BLOCKS)
        share = float(np.sqrt(np.mean(rest**2) / max(np.mean(linear**2), 1e-300)))
        return share, (float(varied[0]), float(varied[1]))

    def during(self, begin_s: float, duration_s: float) -> "ElementMotion":
        """Give the motion the times of a record, for laws that change with them."""
        times = begin_s + duration_s * np.linspace(0.0, 1.0, len(self.motion.e))
        return dataclasses.replace(self, motion=dataclasses.replace(self.motion, times=times))

    def _centred(
        self, kind: Kind, parameters: Mapping[str, float]
    ) -> Float[np.ndarray, " time"]:
        """Force of a law about the elongation at which it is in equilibrium on average."""
        centre, before = 0.0, 0.0
        force = force_along(kind, parameters, self.motion)
        rest = self.static_m_per_n * float(force.mean())
        rest_before = 0.0
        for _ in range(CENTRE_STEPS):
            if not abs(centre + rest) > 0.02 * self.size_m:
                break
            gap, gap_before = centre + rest, before + rest_before
            slope = (gap - gap_before) / (centre - before) if centre != before else 1.0
            before, rest_before = centre, rest
            centre -= gap / max(slope, 1.0)
            moved = dataclasses.replace(self.motion, e=self.motion.e + centre)
            force = force_along(kind, parameters, moved)
            rest = self.static_m_per_n * float(force.mean())
        return np.asarray(force)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Equivalents:
    """Equivalent constants beyond the model's, of one element or node in each record.

    Parameters
    ----------
    values
        Stiffness of each record [N/m], then damping of each [N s/m]; of a node, masses [kg].
    """

    place: Place
    values: Float[np.ndarray, " equivalent"]
    covariance: Float[np.ndarray, "equivalent equivalent"]
    motions: tuple[ElementMotion, ...]

    def nonlinear(
        self, kind: Kind, parameters: Mapping[str, float]
    ) -> tuple[float, Float[np.ndarray, " equivalent"]]:
        """Give what a law has beyond its equivalents, where most, and their variances."""
        shares, varied = zip(
            *(one.nonlinear(kind, parameters) for one in self.motions), strict=True
        )
        return max(shares), np.concatenate(list(zip(*varied, strict=True)))

    def of_law(
        self, kind: Kind, parameters: Mapping[str, float]
    ) -> Float[np.ndarray, " equivalent"]:
        """Equivalents of a law, in the order of the values."""
        every = [one.equivalents(kind, parameters) for one in self.motions]
        return np.array([value for values in zip(*every, strict=True) for value in values])


def changes_of(problem: SpectralProblem, place: Place) -> tuple[ConstantChange, ...]:
    """Give an element or a node constants of its own in each record."""
    if place.kind == "element":
        return element_changes(problem, place.id)
    mass = problem.plant.entries["mass", place.id].value
    return tuple(
        ConstantChange(constant=("mass", place.id), record=record, scale=mass)
        for record in range(len(problem.records))
    )


def element_changes(problem: SpectralProblem, element: str) -> tuple[ConstantChange, ...]:
    """Give an element a stiffness and a damping of its own in each record."""
    linear = LinearModel.of(problem.plant.description)
    structure = linear.structure
    part = next(one for one in problem.plant.description.elements if one.id == element)
    stiffness = problem.plant.entries["stiffness", element].value
    if isinstance(part, OpenJoint):
        # It has no stiffness of its own: that of what holds the weaker of its ends counts.
        ends = np.flatnonzero(linear.elongation(Place("element", element)))
        stiffness = float(np.diag(structure.stiffness)[ends].min()) / PRIOR_RATIO
    squares = np.linalg.eigvals(np.linalg.solve(structure.mass, structure.stiffness)).real
    lowest = math.sqrt(max(float(squares.min()), 1e-6 * float(squares.max())))
    scales = {
        "stiffness": PRIOR_RATIO * stiffness,
        "damping": PRIOR_RATIO * stiffness / lowest,
    }
    return tuple(
        ConstantChange(constant=(what, element), record=record, scale=scale)
        for what, scale in scales.items()
        for record in range(len(problem.records))
    )


def equivalents_of(
    problem: SpectralProblem,
    fit: AmbientFit,
    place: Place,
    spans: Sequence[tuple[float, float]] | None = None,
) -> Equivalents:
    """Read the equivalents of a place from a fit with `changes_of`.

    Laws see the campaign time of the records where `spans` gives begin and duration [s] of
    each.
    """
    numbers = range(len(problem.records))
    motions = [element_motion(problem, fit, record, place) for record in numbers]
    if spans is not None:
        motions = [one.during(*span) for one, span in zip(motions, spans, strict=True)]
    return Equivalents(place, fit.change_values, fit.change_covariance, tuple(motions))


def element_motion(
    problem: SpectralProblem, fit: AmbientFit, record: int, place: Place
) -> ElementMotion:
    """Draw a normal motion of an element, with the spectrum that a fit gives it."""
    at = np.zeros(problem.unknowns)
    at[: problem.free] = fit.values / problem.prior.mean - 1
    scale = np.array([change.scale for change in problem.changes])
    at[problem.free : problem.linear] = fit.change_values / scale
    linear = LinearModel.of(problem.described(at, record))
    rate = OVERSAMPLING * float(problem.records[record].frequency_hz[-1])
    frequency = np.arange(SAMPLES // 2 + 1) * rate / SAMPLES
    row = linear.elongation(place)
    response = np.einsum("d,fdj->fj", row, linear.compliance(frequency))
    power = np.abs(response) ** 2 @ fit.force_density[record]
    power *= problem.records[record].shape_at(frequency, fit.force_shape[record])
    rng = np.random.default_rng(0)  # the same draw for every law, so that laws compare
    drawn = rng.standard_normal((2, len(frequency)))
    # A one-sided density S gives each line the variance S df of the motion.
    lines = SAMPLES / 2 * np.sqrt(power * rate / SAMPLES) * (drawn[0] + 1j * drawn[1])
    lines[[0, -1]] = 0.0
    s = 2j * np.pi * frequency
    e, v, a = (scipy.fft.irfft(lines * s**order, SAMPLES) for order in range(3))
    bare = LinearModel.of(problem.plant.description)
    static = float(row @ bare.compliance(np.zeros(1))[0].real @ row)
    # Every second line of a record is used.
    recorded_s = 2 / float(np.diff(problem.records[record].frequency_hz[:2])[0])
    records = SAMPLES / rate / recorded_s
    times = np.arange(SAMPLES) / rate
    return ElementMotion(Motion(e=e, v=v, a=a, times=times), static, records)
