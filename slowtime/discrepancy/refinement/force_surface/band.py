"""Standard deviation of a fitted force surface, which grows beyond the measured range."""

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit
from slowtime.dynamics.effects import Motion, force_along


def surface_band(
    fit: Fit, motion: Motion, number: int = -1
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    r"""Force of a fitted surface along a motion, and its standard deviation.

    The force is linear in its coefficients, so that within the measured range
    :math:`\sigma^2 = j^T C j` with their covariance :math:`C`, inflated where the model leaves
    more than noise. Beyond it, the standard deviation of the prior of a coefficient is added
    for each half range of elongation or speed.

    Parameters
    ----------
    fit
        Of a model with the surface.
    motion
        Along the element.
    number
        Of the surface among the effects; the last where not given.

    Returns
    -------
    Force and standard deviation [N].
    """
    at = number % len(fit.plant.effects)
    effect = fit.plant.effects[at]
    kind = fit.plant.kinds[effect.kind]
    named = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    own = {name: named["effect", at, name] for name in kind.names}
    columns = [i for i, name in enumerate(fit.prior.names) if name[:2] == ("effect", at)]
    coefficients = [p.name for p in kind.parameters if p.spread]
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
    wide = max(fit.chi2_in_band, 1.0)
    inner = wide * fit.covariance[np.ix_(columns, columns)]
    within = np.maximum(np.einsum("ti,ij,tj->t", slopes, inner, slopes), 0.0)
    return force, np.asarray(np.sqrt(within + beyond**2))
