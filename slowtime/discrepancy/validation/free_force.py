r"""A fitted model and an element in; what a free force there explains beside all laws, out.

Beside the laws a force is laid of curves in elongation :math:`e` and its rate :math:`v`, and of
elongations :math:`z_j` that lag behind,

.. math:: F = \sum_i \beta_i \, \phi_i(e / e_s, v / v_s) + \sum_j \gamma_j z_j / e_s ,
          \quad \tau_j \dot z_j = e - z_j ,

and all constants :math:`\theta`, laws' numbers and initial states among them, are free beside
it. With :math:`H` and :math:`g` the normal equations of both at what was found, it would take
from :math:`\chi^2` (Rao 1948)

.. math:: r^T S^+ r, \quad S = H_{\beta\beta} - H_{\beta\theta} H_{\theta\theta}^{-1}
          H_{\theta\beta}, \quad r = g_\beta - H_{\beta\theta} H_{\theta\theta}^{-1} g_\theta .

Were the laws right, this would be distributed as :math:`\chi^2` of as many degrees as :math:`S`
has rank, however nonlinear they are; nothing is refitted.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

from slowtime.discrepancy.calibration import Fit, prior_of, weights_of
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.levenberg_marquardt import Point, Problem, normal_at
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Kind, Law, Parameter
from slowtime.dynamics.effects.compilation import compiled
from slowtime.dynamics.plant import Name

RIDGE, OWN = 1e-10, 1e-6
"""Of scaled normal equations; share of the slope to a curve that all else must leave of it."""
CURVES, LAGS = 11, 2
"""How many strengths of curves the free force has, and of elongations that lag."""

Unknowns = Float[np.ndarray, " unknown"]


@compiled
def bent(e: float, v: float, p: Any) -> float:
    """Force of curves in elongation and rate, each over its scale [N]."""
    x = e / p[0]
    y = v / p[1]
    far = abs(x)
    fast = abs(y)
    spring = p[2] * x * far + p[3] * x * x + p[4] * x * x * x + p[5] * x * x * x * x * x
    damper = p[6] * y * fast + p[7] * y * y + p[8] * y * y * y
    both = p[9] * far * y + p[10] * x * x * y + p[11] * x * y + p[12] * x * fast
    return float(spring + damper + both)


def curved(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force along curves [N]."""
    return float(bent(e, v, p))


def lagged(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force along curves, and of elongations that lag [N]."""
    return float(bent(e, v, p) + (p[13] * z[0] + p[14] * z[1]) / p[0])


def lagging(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of an elongation that lags by twice the time of a radian of the motion [m/s]."""
    return float((e - z[0]) * p[1] / (2.0 * p[0]))


def following(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of one that lags by half that time [m/s]."""
    return float((e - z[1]) * p[1] / (0.5 * p[0]))


def _free(name: str, strengths: int, action: Law) -> Kind:
    return Kind(
        name=name,
        family="unknown",
        where="element",
        parameters=(
            Parameter(name="e_m", unit="m", meaning="scale of elongation", fitted=False),
            Parameter(name="v_m_per_s", unit="m/s", meaning="scale of its rate", fitted=False),
            *(
                Parameter(name=f"curve_{i}_n", unit="N", meaning="force at the scales")
                for i in range(strengths)
            ),
        ),
        equation="Σ βi φi(e, v) + Σ γj zj, τj żj = e − zj",
        source="",
        sentence="A force that follows the motion along a curve of its own.",
        action=action,
    )


CURVED = _free("any_curve", CURVES, Law(force=curved))
LAGGED = _free("any_lag", CURVES + LAGS, Law(force=lagged, rates=(lagging, following)))
"""No effects that are ever named: what is laid beside those that are."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """What a free force would take, and by what.

    Parameters
    ----------
    gain, degrees
        Chi squared that it would take, and its degrees of freedom.
    spread
        One standard deviation of its strengths along each direction in which they are known,
        whatever the others [N].
    steps
        Where they are along each of them, in standard deviations.
    """

    gain: float
    degrees: int
    spread: Float[np.ndarray, "curve direction"]
    steps: Float[np.ndarray, " direction"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeForce:
    """Normal equations of a model with a free force beside its laws, scaled.

    Parameters
    ----------
    names, values
        Of the constants and numbers that are free; initial states come after them.
    curves
        Which unknowns are strengths of the free force.
    scale
        From scaled unknowns to unknowns.
    rest
        Cholesky's factor of the equations without the free force.
    """

    names: tuple[Name, ...]
    values: Float[np.ndarray, " name"]
    curves: Bool[np.ndarray, " unknown"]
    scale: Unknowns
    matrix: Float[np.ndarray, "unknown unknown"]
    gradient: Unknowns
    rest: tuple[Float[np.ndarray, "other other"], bool]

    @classmethod
    def of(
        cls, fit: Fit, free: Effect, trials: Sequence[Trial], kinds: Mapping[str, Kind]
    ) -> "FreeForce":
        """Lay a free force beside the laws of a fit, and linearise at what was found."""
        own = {kind.name: kind for kind in (CURVED, LAGGED)}
        both = carry_effect(fit, free, {**kinds, **own})
        prior = prior_of(both.plant)
        more = np.zeros(len(both.plant.state_names) - len(fit.plant.state_names))
        problem = Problem(
            plant=both.plant,
            prior=prior,
            trials=tuple(trials),
            weights=tuple(weights_of(trial, fit.noise, i) for i, trial in enumerate(trials)),
            samples=tuple(len(trial.outputs) for trial in trials),
        )
        states = tuple(np.concatenate([s, more]) if s.size else s for s in fit.states)
        normal, _ = normal_at(problem, Point(values=both.values, states=states))
        last = ("effect", len(fit.plant.effects))
        curves = np.zeros(len(normal.gradient), dtype=bool)
        curves[: len(prior.names)] = [name[:2] == last for name in prior.names]
        scale = 1 / np.sqrt(np.maximum(np.diag(normal.matrix), np.finfo(float).tiny))
        matrix = normal.matrix * np.outer(scale, scale)
        inner = matrix[np.ix_(~curves, ~curves)] + RIDGE * np.eye(int((~curves).sum()))
        return cls(
            names=prior.names,
            values=both.values[list(prior.index)],
            curves=curves,
            scale=scale,
            matrix=matrix,
            gradient=normal.gradient * scale,
            rest=scipy.linalg.cho_factor(inner),
        )

    def without(self, name: Name) -> tuple[float, float]:
        """Where a number would be by the next step without the free force, and its error.

        What other numbers make up for wholly is not known at all.
        """
        at = self.names.index(name)
        unit = np.zeros(int((~self.curves).sum()))
        unit[at] = 1.0
        row = scipy.linalg.cho_solve(self.rest, unit)
        step = float(self.scale[at]) * float(row @ self.gradient[~self.curves])
        return float(self.values[at]) + step, float(self.scale[at]) * math.sqrt(row[at])

    def taken(self) -> Taken:
        """Ask what the free force would take."""
        free = self.curves
        cross = scipy.linalg.cho_solve(self.rest, self.matrix[np.ix_(~free, free)])
        inner = self.matrix[np.ix_(free, free)] - self.matrix[np.ix_(free, ~free)] @ cross
        left = self.gradient[free] - cross.T @ self.gradient[~free]
        values, vectors = np.linalg.eigh(inner)
        own = values > OWN
        spread = self.scale[free][:, None] * (vectors[:, own] / np.sqrt(values[own]))
        steps = (vectors[:, own].T @ left) / np.sqrt(values[own])
        return Taken(float(steps @ steps), int(own.sum()), spread, steps)
