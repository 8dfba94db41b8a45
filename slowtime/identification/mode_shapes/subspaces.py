"""Comparison of sets of mode shapes: AutoMAC, coordinate MAC, subspaces of close modes."""

import numpy as np
from jaxtyping import Float, Num

from .criteria import mac_matrix, normalised


def auto_mac(shapes: Num[np.ndarray, "channel mode"]) -> Float[np.ndarray, "mode mode"]:
    """MAC of each shape with each other one: large where sensors cannot tell two modes apart.

    Parameters
    ----------
    shapes
        Shapes of any norm, one column each.

    Returns
    -------
    AutoMAC [1], 1 on the diagonal.

    Examples
    --------
    >>> auto_mac(np.array([[1.0, 1.0], [0.0, 1.0]])).round(6)
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    return mac_matrix(shapes, shapes)


def coordinate_mac(
    one: Num[np.ndarray, "channel mode"], other: Num[np.ndarray, "channel mode"]
) -> Float[np.ndarray, " channel"]:
    r"""Coordinate MAC: how well each channel agrees over paired modes (CoMAC).

    .. math:: \mathrm{CoMAC}_c = \frac{(\sum_j |\phi_{cj} \psi_{cj}^*|)^2}
              {\sum_j |\phi_{cj}|^2 \, \sum_j |\psi_{cj}|^2}

    Parameters
    ----------
    one, other
        Shapes, one column for each pair; each is brought to unit norm first.

    Returns
    -------
    CoMAC of each channel [1]; 1 for channels that neither set moves.

    References
    ----------
    .. [1] N. A. J. Lieven, D. J. Ewins, "Spatial correlation of mode shapes, the coordinate
       modal assurance criterion (COMAC)", Proc. 6th IMAC (1988).
    """
    first = np.abs(np.column_stack([normalised(column) for column in one.T]))
    second = np.abs(np.column_stack([normalised(column) for column in other.T]))
    power = np.sum(first**2, axis=1) * np.sum(second**2, axis=1)
    both = np.sum(first * second, axis=1) ** 2
    return np.asarray(np.where(power > 0.0, both / np.where(power > 0.0, power, 1.0), 1.0))


def subspace_mac(
    one: Num[np.ndarray, "channel mode"], other: Num[np.ndarray, "channel reference"]
) -> float:
    r"""Smallest squared cosine between two spans of shapes; the MAC for one shape each.

    Shapes of close modes turn among each other under the least change, their span does not.

    Parameters
    ----------
    one, other
        Shapes of any norm; the second set has at least as many.

    Returns
    -------
    Subspace MAC, 0 to 1 [1].

    References
    ----------
    .. [1] Å. Björck, G. H. Golub, "Numerical methods for computing angles between linear
       subspaces", Mathematics of Computation 27 (1973).

    Examples
    --------
    >>> pair = np.eye(3)[:, :2]
    >>> round(subspace_mac(pair @ np.array([[0.6, -0.8], [0.8, 0.6]]), pair), 6)
    1.0
    """
    if one.shape[1] > other.shape[1] or one.shape[0] != other.shape[0]:
        raise ValueError(
            f"Shapes of {one.shape} and {other.shape} were given. Give the same channels, and "
            "at least as many shapes in the second set as in the first."
        )
    first, second = np.linalg.qr(one)[0], np.linalg.qr(other)[0]
    cosines = np.linalg.svd(first.conj().T @ second, compute_uv=False)
    return float(min(cosines.min() ** 2, 1.0))
