r"""Homotopy (D-MORPH) regression: the least-weight solution of all that fit.

With fewer samples than terms, infinitely many coefficients :math:`a` solve the normal equations
:math:`\Phi^T \Phi a = \Phi^T y`. Followed to its end, the homotopy of Li and Rabitz leads from
any of them to the one that minimises :math:`a^T W a`.
"""

import numpy as np
from jaxtyping import Float

RANK = 1e-11


def homotopy(
    design: Float[np.ndarray, "sample term"],
    outputs: Float[np.ndarray, " sample"],
    weights: Float[np.ndarray, " term"],
) -> Float[np.ndarray, " term"]:
    r"""Minimiser of :math:`\sum_p w_p a_p^2` among the least-squares solutions.

    .. math:: a = W^{-1/2} (\Phi W^{-1/2})^+ y

    which equals :math:`V_{>r} (U_{>r}^T V_{>r})^{-1} U_{>r}^T \Phi^+ y` of the published form,
    without its projector, whose singular values of nought have to be told from small ones.

    Parameters
    ----------
    design
        Value of each term at each point.
    outputs
        Output at each point.
    weights
        :math:`w_p > 0`: what a coefficient costs.

    Returns
    -------
    Coefficients.

    References
    ----------
    .. [1] G. Li and H. Rabitz, "D-MORPH regression: application to modeling with unknown
       parameters more than observation data", J. Math. Chem. 48 (2010) 1010-1035.

    Examples
    --------
    >>> homotopy(np.array([[1.0, 1.0]]), np.array([3.0]), np.array([1.0, 2.0]))
    array([2., 1.])
    """
    if not (np.isfinite(weights).all() and (weights > 0.0).all()):
        raise ValueError(
            f"Weights go from {weights.min():g} to {weights.max():g}. Give positive ones: a "
            "term of no weight has no least-weight coefficient."
        )
    root = np.sqrt(weights)
    scaled, *_ = np.linalg.lstsq(design / root, outputs, rcond=RANK)
    found: Float[np.ndarray, " term"] = scaled / root
    return found
