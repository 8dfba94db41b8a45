"""Random effects over sister assets: a Gaussian prior on the parameters of a law."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

FEWEST_SISTERS = 3
"""Sister assets from which their spread is estimated [1]; of fewer, the weak prior is kept."""


@dataclasses.dataclass(frozen=True, slots=True)
class FleetPrior:
    """Gaussian law of the parameters of one degradation law, in physical units.

    Parameters
    ----------
    law
        Name of the law.
    mean, covariance
        Of its parameters (see `Curve.names`), in physical units.
    """

    law: str
    mean: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]


def pooled(sisters: Sequence[FleetPrior]) -> FleetPrior | None:
    r"""Pool what sister assets say into a prior for one more asset.

    By moments of the random-effects model: the mean of the sisters' posterior means, and the
    covariance between them, less what each posterior leaves open, plus the error of the mean.

    .. math:: \Sigma_b = \max(0, \mathrm{Cov}(m_i) - \overline{C_i}), \qquad
              \Sigma = \Sigma_b (1 + 1/n) + \overline{C_i} / n

    Parameters
    ----------
    sisters
        Posterior mean and covariance of each sister asset under the same law.

    Returns
    -------
    The prior; None of fewer than `FEWEST_SISTERS`.

    References
    ----------
    .. [1] R. DerSimonian and N. Laird, "Meta-analysis in clinical trials" (1986).
    """
    if len({one.law for one in sisters}) > 1:
        names = ", ".join(sorted({one.law for one in sisters}))
        raise ValueError(f"Sisters of different laws were given: {names}. Give those of one.")
    if len(sisters) < FEWEST_SISTERS:
        return None
    means = np.array([one.mean for one in sisters])
    own = np.mean([one.covariance for one in sisters], axis=0)
    number = len(sisters)
    between = np.cov(means.T).reshape(own.shape) - own
    values, vectors = np.linalg.eigh(between)
    between = (vectors * np.maximum(values, 0.0)) @ vectors.T
    covariance = between * (1.0 + 1.0 / number) + own / number
    # With few sisters the spread itself is uncertain: Student's t as a wider Gaussian.
    widened = covariance * (number - 1.0) / max(number - 3.0, 1.0)
    return FleetPrior(sisters[0].law, means.mean(axis=0), widened)
