"""Comparison of mode shapes: modal assurance criterion, phase collinearity.

A shape has one number a channel, known up to a complex factor that nobody can see in ambient
records. Every measure here ignores that factor; `normalised` chooses one.
"""

import numpy as np
from jaxtyping import Complex, Float, Num


def normalised(shape: Num[np.ndarray, " channel"]) -> Complex[np.ndarray, " channel"]:
    """Shape of unit norm whose largest component is real and positive.

    Examples
    --------
    >>> normalised(np.array([3j, -4j])).round(3) + 0
    array([-0.6+0.j,  0.8+0.j])
    """
    columns = _columns(shape[:, None])
    largest = columns[np.argmax(np.abs(columns[:, 0])), 0]
    return np.asarray(columns[:, 0] * (np.conj(largest) / np.abs(largest)))


def mac(one: Num[np.ndarray, " channel"], other: Num[np.ndarray, " channel"]) -> float:
    r"""Modal assurance criterion of two shapes, 0 (orthogonal) to 1 (alike).

    .. math:: \frac{|\phi^H \psi|^2}{(\phi^H \phi)(\psi^H \psi)}

    References
    ----------
    .. [1] R. J. Allemang, "The modal assurance criterion", Sound and Vibration 37 (2003).

    Examples
    --------
    >>> round(mac(np.array([1.0, 1.0]), np.array([1.0, 0.0])), 6)
    0.5
    """
    return float(mac_matrix(one[:, None], other[:, None])[0, 0])


def mac_matrix(
    one: Num[np.ndarray, "channel mode"], other: Num[np.ndarray, "channel other"]
) -> Float[np.ndarray, "mode other"]:
    """MAC of each column of one with each column of the other; see `mac`."""
    overlap = np.abs(_columns(one).conj().T @ _columns(other)) ** 2
    return np.asarray(np.minimum(overlap, 1.0))


def auto_mac(shapes: Num[np.ndarray, "channel mode"]) -> Float[np.ndarray, "mode mode"]:
    """MAC of each shape with each other of the same set: 1 on the diagonal."""
    # A large value beside the diagonal means that the sensors do not tell the two modes apart.
    return mac_matrix(shapes, shapes)


def comac(
    one: Num[np.ndarray, "channel mode"], other: Num[np.ndarray, "other_channel other_mode"]
) -> Float[np.ndarray, " channel"]:
    r"""Coordinate modal assurance criterion: agreement of paired modes at each channel.

    .. math:: \mathrm{COMAC}_j = \frac{(\sum_k |\phi_{jk} \psi_{jk}^*|)^2}
              {\sum_k |\phi_{jk}|^2 \, \sum_k |\psi_{jk}|^2}

    Returns
    -------
    COMAC of each channel [1]; not a number where one of the two never moves.

    References
    ----------
    .. [1] N. A. J. Lieven, D. J. Ewins, "Spatial correlation of mode shapes, the coordinate
       modal assurance criterion (COMAC)", IMAC 6 (1988).

    Examples
    --------
    >>> shapes = np.array([[1.0, 1.0], [0.5, -1.0]])
    >>> comac(shapes, shapes).round(6)
    array([1., 1.])
    """
    first, second = _columns(one), _columns(other)
    if first.shape != second.shape:
        raise ValueError(
            f"Shapes of {first.shape} and of {second.shape} were given. Give the same channels "
            "and paired modes, one column each."
        )
    product = np.sum(np.abs(first * second.conj()), axis=1) ** 2
    size = np.sum(np.abs(first) ** 2, axis=1) * np.sum(np.abs(second) ** 2, axis=1)
    return np.asarray(np.where(size > 0, product / np.where(size > 0, size, 1.0), np.nan))


def mpc(shape: Num[np.ndarray, " channel"]) -> float:
    """Modal phase collinearity of one shape; see `mpcs`."""
    return float(mpcs(shape[:, None])[0])


def mpcs(shapes: Num[np.ndarray, "channel mode"]) -> Float[np.ndarray, " mode"]:
    r"""Modal phase collinearity of each column: 1 where all components lie on one line.

    With the second moments about zero of the real parts x and imaginary parts y,

    .. math:: \mathrm{MPC} = \frac{(S_{xx} - S_{yy})^2 + 4 S_{xy}^2}{(S_{xx} + S_{yy})^2}
              = \frac{|\phi^T \phi|^2}{(\phi^H \phi)^2} ,

    1 for a proportionally damped mode, and about 2 / channels for noise.

    References
    ----------
    .. [1] R. S. Pappa, K. B. Elliott, A. Schenk, "Consistent-mode indicator for the
       eigensystem realization algorithm", J. Guidance, Control, Dynamics 16 (1993); there the
       components are first taken from their mean, which a rigid shape does not survive.
    """
    columns = _columns(shapes)
    return np.asarray(np.minimum(np.abs(np.sum(columns**2, axis=0)) ** 2, 1.0))


def mean_phase_deviation(shape: Num[np.ndarray, " channel"]) -> float:
    r"""Mean angle between the components and the best line through zero.

    .. math:: \frac{\sum_j |\phi_j| \arccos |\cos(\arg \phi_j - \theta)|}{\sum_j |\phi_j|},
              \qquad \theta = \tfrac{1}{2} \arg \sum_j \phi_j^2

    0 for a real shape; the line of angle :math:`\theta` is the one of least squared distance.

    References
    ----------
    .. [1] E. Reynders, J. Houbrechts, G. De Roeck, "Fully automated (operational) modal
       analysis", Mechanical Systems and Signal Processing 29 (2012), eq. 15.
    """
    turned = _on_the_real_line(_columns(shape[:, None])[:, 0])
    angle = np.arctan2(np.abs(turned.imag), np.abs(turned.real))
    weight = np.abs(turned)
    return float(weight @ angle / weight.sum())


def real_shape(shape: Num[np.ndarray, " channel"]) -> Float[np.ndarray, " channel"]:
    """Nearest real shape: turned onto the real line, of unit norm, largest component positive.

    Examples
    --------
    >>> real_shape(np.array([3 + 3j, 4 + 4j])).round(3)
    array([0.6, 0.8])
    """
    real = _on_the_real_line(_columns(shape[:, None])[:, 0]).real
    real = real / np.linalg.norm(real)
    return np.asarray(real * np.sign(real[np.argmax(np.abs(real))]))


def _on_the_real_line(column: np.ndarray) -> np.ndarray:
    """Turn by the angle that leaves the least squared imaginary part."""
    return np.asarray(column * np.exp(-0.5j * np.angle(np.sum(column**2))))


def _columns(shapes: np.ndarray) -> np.ndarray:
    """Complex columns of unit norm, or a refusal."""
    columns = np.asarray(shapes, dtype=complex)
    largest = np.abs(columns).max(axis=0, initial=0.0)
    if not (np.isfinite(largest).all() and (largest > 0).all()):
        raise ValueError(
            f"Shapes of largest components {largest} were given. Allowed are finite shapes "
            "with a component other than zero; leave out modes that no channel sees."
        )
    columns = columns / largest
    return np.asarray(columns / np.linalg.norm(columns, axis=0))
