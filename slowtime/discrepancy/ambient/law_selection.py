r"""Selection among laws of an element by its equivalent stiffness and damping in each record.

A law with parameters :math:`p` predicts equivalents :math:`\eta(p)`; those estimated from the
spectra are :math:`\hat\eta` with covariance :math:`C_0`, which the error of linearisation
widens to :math:`C`, as does the scatter of a law that is met by chance. Its evidence is

.. math:: \log L_0 - \tfrac12 (\hat\eta - \eta)^T C^{-1} (\hat\eta - \eta)
          - \tfrac12 \log\det(I + D J^T C^{-1} J D) - \tfrac12 \log\det(C C_0^{-1}) , \quad
          D = \mathrm{diag} |p| ,

with :math:`J` its derivatives, a prior as wide as the parameters themselves (see
`estimation.occam_factor`), and :math:`L_0` the likelihood of equivalents that are free.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from slowtime.discrepancy.candidates.library_fit import is_applicable
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Hidden,
    Kind,
    Law,
    Place,
    simple_kinds,
)

from .equivalents import Equivalents

LINEARISATION_ERROR = 0.1
"""[1] Standard deviation of an equivalent of statistical linearisation, over its size and over
what is not linear in the force. Source: errors of 5 to 15 % that Roberts and Spanos (1990)
report of laws of which half and more is not linear."""
LEAST_NONLINEAR = 0.02
"""[1] Root mean square of the rest over that of the linear force, below which a law is that of
a spring and a damper. Source: a force that is not linear by 2 % shows in no spectrum."""
STARTS = 3
"""[shapes] From which a law is fitted. Source: docs/what_decides.md: half and double change no
answer."""
DIFFERENCE_STEP = 1e-2
"""[1] Relative step of a parameter for derivatives. Source: equivalents of laws with kinks
are averages over samples, and change in steps below it."""
TINY = 1e-12
"""[unit of the parameter] Least size of a parameter. Source: rounding."""
MAX_EVALUATIONS = 60
"""[evaluations] Of a fit from one start. Source: least squares of three parameters end within
forty."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FittedLaw:
    """A law fitted to equivalents.

    `log_evidence` is relative to other laws and places of the same records [nats].
    """

    effect: Effect
    sds: Mapping[str, float]
    log_evidence: float
    chi2: float


def laws_of_elements(
    kinds: Mapping[str, Kind], place: Place, description: Description, equivalents: int
) -> list[Kind]:
    """List simple laws of an element that act at all times, with fewer parameters than data."""
    return [
        kind
        for kind in simple_kinds(kinds)
        if is_applicable(kind, place, description)
        and isinstance(kind.action, Law | Friction | Hidden)
        and not _depends_on_time(kind)
        and len([p for p in kind.parameters if p.fitted]) < equivalents
    ]


def _depends_on_time(kind: Kind) -> bool:
    return kind.quadrature is not None or any(
        p.unit in ("s", "Hz") or p.name.endswith(("_s", "_hz")) for p in kind.parameters
    )


def fit_laws(
    found: Equivalents, log_likelihood: float, kinds: Sequence[Kind]
) -> list[FittedLaw]:
    """Fit each law to equivalents that were free in a fit; the most probable first."""
    laws = [
        one for kind in kinds if (one := _LawFit(found, kind).best(log_likelihood)) is not None
    ]
    return sorted(laws, key=lambda one: -one.log_evidence)


class _LawFit:
    """Least squares of one law."""

    def __init__(self, found: Equivalents, kind: Kind) -> None:
        self.found, self.kind = found, kind
        self.free = [p.name for p in kind.parameters if p.fitted]
        # A law that is linear, or changes with time, needs no linearisation.
        exact = isinstance(kind.action, Hidden) or kind.where == "node"
        self.exact = exact or _depends_on_time(kind)
        self.factor = np.linalg.cholesky(found.covariance)

    def best(self, log_likelihood: float) -> FittedLaw | None:
        """Return the best fit; None where the law has none."""
        fits = [self._from(start) for start in self._starts()]
        if not fits:
            return None
        parameters, _ = min(fits, key=lambda one: one[1])
        if not self.exact and not self._widen(parameters):
            return None
        chi2 = self._chi2(parameters)
        slopes = self._slopes(parameters)
        sizes = np.array([abs(parameters[name]) for name in self.free])
        scaled = slopes * sizes
        _, occam = np.linalg.slogdet(np.eye(len(self.free)) + scaled.T @ scaled)
        # The prior of the evidence: what no record tells has the error of its size.
        information = slopes.T @ slopes + np.diag(1 / np.maximum(sizes, TINY) ** 2)
        sds = np.sqrt(np.diag(np.linalg.inv(information)))
        return FittedLaw(
            Effect(self.kind.name, self.found.place, parameters),
            dict(zip(self.free, sds.tolist(), strict=True)),
            log_likelihood - (chi2 + float(occam) + self._widening()) / 2,
            chi2,
        )

    def _widen(self, parameters: Mapping[str, float]) -> bool:
        """Add the errors of linearisation; tell whether the law is not linear at all."""
        found = self.found
        share, varied = found.nonlinear(self.kind, parameters)
        error = LINEARISATION_ERROR * share * self._equivalents(parameters)
        self.factor = np.linalg.cholesky(found.covariance + np.diag(error**2 + varied))
        return share > LEAST_NONLINEAR

    def _widening(self) -> float:
        _, own = np.linalg.slogdet(self.found.covariance)
        return 2 * float(np.sum(np.log(np.diag(self.factor)))) - float(own)

    def _starts(self) -> list[dict[str, float]]:
        """Shapes that the motion of the records suggests, with the best strength of each."""
        kind, found = self.kind, self.found
        largest = max(found.motions, key=lambda one: one.size_m).motion
        if _depends_on_time(kind):
            ends = [one.motion.times[[0, -1]] for one in found.motions]
            times = np.linspace(np.min(ends), np.max(ends), len(largest.times))
            largest = dataclasses.replace(largest, times=times)
        shapes = list(kind.shapes(largest)) or [{}]
        ranked: list[tuple[float, dict[str, float]]] = []
        for shape in shapes:
            unit = {p.name: 1.0 for p in kind.parameters} | dict(shape)
            told = self._scaled(unit)
            if told is not None:
                ranked.append((self._chi2(told), told))
        ranked.sort(key=lambda one: one[0])
        return [told for chi2, told in ranked[:STARTS] if math.isfinite(chi2)]

    def _scaled(self, unit: dict[str, float]) -> dict[str, float] | None:
        """Give a shape the strength that fits best; None where that is not allowed."""
        kind = self.kind
        grown = [kind.strength] if kind.strength is not None else self.free
        if kind.strength is None and len(self.free) != 1:
            return unit
        unit = unit | {name: 1.0 for name in grown}
        response = self._white(self._equivalents(unit))
        data = self._white(self.found.values)
        if not (np.isfinite(response).all() and response @ response > 0):
            return None
        strength = float(response @ data / (response @ response))
        scaled = {
            name: value * (strength if name in (*grown, *kind.scales) else 1.0)
            for name, value in unit.items()
        }
        refused = any(kind.parameter(name).refuses(value) for name, value in scaled.items())
        return None if refused or strength == 0 else scaled

    def _from(self, start: dict[str, float]) -> tuple[dict[str, float], float]:
        scale = np.array([start[name] if start[name] else 1.0 for name in self.free])
        low = np.array([self.kind.parameter(name).low for name in self.free]) / scale
        high = np.array([self.kind.parameter(name).high for name in self.free]) / scale
        low, high = np.minimum(low, high), np.maximum(low, high)

        def residual(x: Float[np.ndarray, " free"]) -> Float[np.ndarray, " equivalent"]:
            return self._residual(self._named(x * scale, start))

        try:
            solved = scipy.optimize.least_squares(
                residual,
                np.clip(np.ones(len(scale)), low + 1e-9, high - 1e-9),
                bounds=(low, high),
                diff_step=np.full(len(scale), DIFFERENCE_STEP),
                max_nfev=MAX_EVALUATIONS,
            )
        except ValueError:
            # A force beside one that was tried is not finite: the shape itself has one that is.
            return start, self._chi2(start)
        return self._named(solved.x * scale, start), float(2 * solved.cost)

    def _named(
        self, values: Float[np.ndarray, " free"], start: Mapping[str, float]
    ) -> dict[str, float]:
        return dict(start) | dict(zip(self.free, values.tolist(), strict=True))

    def _equivalents(self, parameters: Mapping[str, float]) -> Float[np.ndarray, " equivalent"]:
        return self.found.of_law(self.kind, parameters)

    def _white(self, values: Float[np.ndarray, " equivalent"]) -> Float[np.ndarray, " one"]:
        return np.asarray(
            scipy.linalg.solve_triangular(self.factor, values, lower=True, check_finite=False)
        )

    def _residual(self, parameters: Mapping[str, float]) -> Float[np.ndarray, " equivalent"]:
        """Return what a law leaves of the equivalents, not finite where its force is not."""
        return self._white(self._equivalents(parameters) - self.found.values)

    def _chi2(self, parameters: Mapping[str, float]) -> float:
        chi2 = float(np.sum(self._residual(parameters) ** 2))
        return chi2 if math.isfinite(chi2) else math.inf

    def _slopes(self, parameters: Mapping[str, float]) -> Float[np.ndarray, "equivalent free"]:
        """Return derivatives of the whitened equivalents."""
        columns = []
        for name in self.free:
            step = DIFFERENCE_STEP * max(abs(parameters[name]), 1e-12)
            near = [
                (at, self._residual({**parameters, name: parameters[name] + at}))
                for at in (-step, 0.0, step)
            ]
            # Beside the last shape whose force is finite there is one on one side only.
            finite = [(at, left) for at, left in near if np.isfinite(left).all()]
            (low, behind), (high, ahead) = finite[0], finite[-1]
            columns.append((ahead - behind) / max(high - low, step))
        return np.stack(columns, axis=1)
