r"""Score test for a free force at an element, beside all laws of a fitted model.

The free force consists of curves in elongation :math:`e` and its rate :math:`v`, and of
elongations :math:`z_j` that lag behind,

.. math:: F = \sum_i \beta_i \, \phi_i(e / e_s, v / v_s) + \sum_j \gamma_j z_j / e_s ,
          \quad \tau_j \dot z_j = e - z_j ,

while all constants :math:`\theta`, parameters of laws and initial states included, are free.
With :math:`H` and :math:`g` the normal equations of both at the fit, it would lower
:math:`\chi^2` by

.. math:: r^T S^+ r, \quad S = H_{\beta\beta} - H_{\beta\theta} H_{\theta\theta}^{-1}
          H_{\theta\beta}, \quad r = g_\beta - H_{\beta\theta} H_{\theta\theta}^{-1} g_\theta .

If the laws are right, this is distributed as :math:`\chi^2` with the rank of :math:`S` as
degrees of freedom, however nonlinear they are; nothing is refitted.

References
----------
.. [1] C. R. Rao, "Large sample tests of statistical hypotheses concerning several parameters",
   Proc. Camb. Phil. Soc. 44 (1948).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Float

from slowtime.discrepancy.calibration import Fit, prior_of, spectral_weights
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.calibration.levenberg_marquardt import (
    Iterate,
    LeastSquaresProblem,
    normal_equations,
)
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Kind, Law, Parameter
from slowtime.dynamics.effects.compilation import compiled
from slowtime.dynamics.plant import Name

RIDGE = 1e-10
"""[1] Added to the diagonal of the scaled normal equations. Source: well above double
precision."""
MIN_OWN_SHARE = 1e-6
"""[share of the squared slope to a curve] That all other unknowns must leave of it. Source:
square root of what double precision resolves, with margin."""
CURVE_TERMS = 11
"""[1] Strengths of curves of the free force. Source: terms of `curve_force`."""
LAG_TERMS = 2
"""[1] Elongations that lag. Source: terms of `curve_and_lag_law`."""

Unknowns = Float[np.ndarray, " unknown"]


@compiled
def curve_force(e: float, v: float, p: Any) -> float:
    """Force [N] of curves in elongation [m] and rate [m/s], each over its scale."""
    x = e / p[0]
    y = v / p[1]
    far = abs(x)
    fast = abs(y)
    spring = p[2] * x * far + p[3] * x * x + p[4] * x * x * x + p[5] * x * x * x * x * x
    damper = p[6] * y * fast + p[7] * y * y + p[8] * y * y * y
    both = p[9] * far * y + p[10] * x * x * y + p[11] * x * y + p[12] * x * fast
    return float(spring + damper + both)


def curve_law(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force along curves [N]."""
    return float(curve_force(e, v, p))


def curve_and_lag_law(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force along curves, and of elongations that lag [N]."""
    return float(curve_force(e, v, p) + (p[13] * z[0] + p[14] * z[1]) / p[0])


def slow_lag_rate(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate [m/s] of an elongation with a lag of twice the time of one radian of the motion."""
    return float((e - z[0]) * p[1] / (2.0 * p[0]))


def fast_lag_rate(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate [m/s] of an elongation with a lag of half that time."""
    return float((e - z[1]) * p[1] / (0.5 * p[0]))


def _free_force_kind(name: str, strengths: int, action: Law) -> Kind:
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


CURVE_KIND = _free_force_kind("any_curve", CURVE_TERMS, Law(force=curve_law))
LAG_KIND = _free_force_kind(
    "any_lag",
    CURVE_TERMS + LAG_TERMS,
    Law(force=curve_and_lag_law, rates=(slow_lag_rate, fast_lag_rate)),
)
"""Kinds of free force; they are never named as effects."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ScoreTest:
    """Result of the score test of a free force.

    Parameters
    ----------
    gain, degrees
        Chi squared that it would explain, and its degrees of freedom.
    """

    gain: float
    degrees: int
    spread: Float[np.ndarray, "curve direction"]
    steps: Float[np.ndarray, " direction"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeForce:
    """Scaled normal equations of a model with a free force beside its laws.

    Parameters
    ----------
    rest
        Cholesky factor of the equations without the free force.
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
        """Add a free force, all its strengths zero, to a model, and linearise there."""
        own = {kind.name: kind for kind in (CURVE_KIND, LAG_KIND)}
        both = carry_effect(fit, free, {**kinds, **own})
        prior = prior_of(both.plant)
        more = np.zeros(len(both.plant.state_names) - len(fit.plant.state_names))
        problem = LeastSquaresProblem(
            plant=both.plant,
            prior=prior,
            trials=tuple(trials),
            weights=tuple(
                spectral_weights(trial, fit.noise, i) for i, trial in enumerate(trials)
            ),
            samples=tuple(len(trial.outputs) for trial in trials),
        )
        states = tuple(np.concatenate([s, more]) if s.size else s for s in fit.states)
        normal, _ = normal_equations(problem, Iterate(values=both.values, states=states))
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

    def step_without(self, name: Name) -> tuple[float, float]:
        """Value of a parameter after one more step without the free force, and its sd."""
        at = self.names.index(name)
        unit = np.zeros(int((~self.curves).sum()))
        unit[at] = 1.0
        row = scipy.linalg.cho_solve(self.rest, unit)
        step = float(self.scale[at]) * float(row @ self.gradient[~self.curves])
        return float(self.values[at]) + step, float(self.scale[at]) * math.sqrt(row[at])

    def score_test(self) -> ScoreTest:
        """Compute the score statistic of the free force."""
        free = self.curves
        cross = scipy.linalg.cho_solve(self.rest, self.matrix[np.ix_(~free, free)])
        inner = self.matrix[np.ix_(free, free)] - self.matrix[np.ix_(free, ~free)] @ cross
        left = self.gradient[free] - cross.T @ self.gradient[~free]
        values, vectors = np.linalg.eigh(inner)
        own = values > MIN_OWN_SHARE
        spread = self.scale[free][:, None] * (vectors[:, own] / np.sqrt(values[own]))
        steps = (vectors[:, own].T @ left) / np.sqrt(values[own])
        return ScoreTest(float(steps @ steps), int(own.sum()), spread, steps)
