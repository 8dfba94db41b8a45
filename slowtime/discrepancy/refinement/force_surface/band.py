"""Standard deviation of a fitted force surface, which grows beyond the measured range."""

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit
from slowtime.dynamics.effects import Motion, force_along

from .truncated_normal import truncated_normal

MEMORYLESS = "measured_force"
"""Kind of the part of a surface that does not depend on past motion."""
SAMPLES = 400
"""[samples] Of coefficients that are bounded. Source: their standard deviation is then known to
4 %, which a drawing does not show."""


def surface_band(
    fit: Fit, motion: Motion, *, instantaneous: bool = False
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    r"""Force of a surface, the last effect of a fit, along a motion, and its sd [N].

    The force is linear in its coefficients, so that within the measured range
    :math:`\sigma^2 = j^T C j` with their covariance :math:`C`, inflated where the model leaves
    more than noise. Coefficients that are bounded, in a monotone surface, have that
    distribution within their bounds, and :math:`C` is their mean square about the fit. Beyond
    the measured range, the standard deviation of the prior of a coefficient is added for each
    half range of elongation or speed. An `instantaneous` band leaves out the part that depends
    on past motion.
    """
    at = len(fit.plant.effects) - 1
    effect = fit.plant.effects[at]
    kind = fit.plant.kinds[effect.kind]
    named = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    own = {name: named["effect", at, name] for name in kind.names}
    if instantaneous:
        kind = fit.plant.kinds[MEMORYLESS]
        own = {name: own[name] for name in kind.names}
    coefficients = [p.name for p in kind.parameters if p.spread]
    columns = [
        i
        for i, name in enumerate(fit.prior.names)
        if name[:2] == ("effect", at) and name[-1] in own
    ]
    scales = {name: value for name, value in own.items() if name not in coefficients}
    force = force_along(kind, own, motion)
    outside = np.hypot(
        np.maximum(np.maximum(own["low_m"] - motion.e, motion.e - own["high_m"]), 0)
        / ((own["high_m"] - own["low_m"]) / 2),
        np.maximum(np.abs(motion.v) / own["high_m_per_s"] - 1, 0),
    )
    beyond = own["spread_n"] * outside
    if not columns:
        return force, beyond
    slopes = np.stack(
        [
            force_along(kind, {**scales, str(fit.prior.names[i][-1]): 1.0}, motion)
            for i in columns
        ],
        axis=1,
    )
    inner = _mean_squares(fit, columns)
    within = np.maximum(np.einsum("ti,ij,tj->t", slopes, inner, slopes), 0.0)
    return force, np.asarray(np.sqrt(within + beyond**2))


def _mean_squares(fit: Fit, columns: list[int]) -> Float[np.ndarray, "own own"]:
    """Mean squares of coefficients about their fitted values [N^2], within their bounds."""
    covariance = max(fit.chi2_in_band, 1.0) * fit.covariance[np.ix_(columns, columns)]
    here = fit.free[columns]
    low, high = fit.prior.low[columns] - here, fit.prior.high[columns] - here
    if np.isinf(low).all() and np.isinf(high).all():
        return np.asarray(covariance)
    off = truncated_normal(covariance, np.minimum(low, 0), np.maximum(high, 0), SAMPLES)
    return np.asarray(off.T @ off / len(off))
