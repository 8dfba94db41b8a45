r"""Matrices of bars and of Euler-Bernoulli and Timoshenko beams in three dimensions.

All functions take arrays over elements. Degrees of freedom of an element: displacements along
x, y, z and rotations about x, y, z of its first node, then of its second.
"""

import numpy as np
from jaxtyping import Float, Int

PARALLEL = 1e-6
"""Sine of the angle [1] between an axis and its orientation vector below which the vector does
not define a plane: rounding of coordinates in files is smaller."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_XI, _WEIGHT = (_POINTS + 1) / 2, _WEIGHTS / 2  # exact for the sixth powers of consistent mass

_AXIAL, _TWIST = [0, 6], [3, 9]
_PLANE_XY, _PLANE_XZ = [1, 5, 7, 11], [2, 4, 8, 10]
_MIRROR = np.array([1.0, -1.0, 1.0, -1.0])  # a positive rotation about y lowers w along x


def element_axes(
    along: Float[np.ndarray, "element 3"], orientation: Float[np.ndarray, "element 3"]
) -> Float[np.ndarray, "element 3 3"]:
    """Compute unit vectors of the local axes x, y, z of elements, one row each.

    Parameters
    ----------
    along
        From the first to the second node [m].
    orientation
        A vector in the local x-y plane, on the side of y. Zero chooses the global z axis, or
        the global y axis for an element along z.

    Returns
    -------
    Rotation matrices: local components are `axes @ global components`.

    Raises
    ------
    ValueError
        Where an element has no length or its orientation lies along it.
    """
    length = np.linalg.norm(along, axis=1)
    if not (length > 0.0).all():
        raise ValueError(
            f"Element number {int(np.argmin(length)) + 1} joins two nodes at the same place. "
            "Use a spring or a rigid link there."
        )
    x = along / length[:, None]
    chosen = np.linalg.norm(orientation, axis=1) > 0.0
    upright = np.linalg.norm(x[:, :2], axis=1) < PARALLEL
    default = np.where(upright[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    reference = np.where(chosen[:, None], orientation, default)
    reference = reference / np.linalg.norm(reference, axis=1, keepdims=True)
    across = np.cross(x, reference)
    size = np.linalg.norm(across, axis=1)
    if not (size > PARALLEL).all():
        raise ValueError(
            f"The orientation of element number {int(np.argmin(size)) + 1} lies along its "
            "axis. Give a vector in the plane of its local x and y axes."
        )
    z = across / size[:, None]
    return np.stack([x, np.cross(z, x), z], axis=1)


def shear_ratio(
    bending: Float[np.ndarray, " element"],
    shear: Float[np.ndarray, " element"],
    length: Float[np.ndarray, " element"],
) -> Float[np.ndarray, " element"]:
    r"""Ratio of bending to shear flexibility, :math:`\varphi = 12 E I / (G A_s L^2)` [1].

    It is 0 for Euler-Bernoulli beams, whose shear stiffness [N] is infinite.
    """
    return np.asarray(12.0 * bending / (shear * length**2))


def bending_stiffness(
    bending: Float[np.ndarray, " element"],
    ratio: Float[np.ndarray, " element"],
    length: Float[np.ndarray, " element"],
) -> Float[np.ndarray, "element 4 4"]:
    """Stiffness for deflection and slope at both ends, exact for loads at the ends.

    From bending stiffness [N m^2], shear ratio [1] and length [m].

    References
    ----------
    .. [1] J. S. Przemieniecki, "Theory of Matrix Structural Analysis" (1968), eq. 5.116.
    """
    factor = bending / ((1.0 + ratio) * length**3)
    one, own = np.ones_like(length), (4.0 + ratio) * length**2
    half, other = 6.0 * length, (2.0 - ratio) * length**2
    rows = [
        [12 * one, half, -12 * one, half],
        [half, own, -half, other],
        [-12 * one, -half, 12 * one, -half],
        [half, other, -half, own],
    ]
    return np.asarray(factor[:, None, None] * np.moveaxis(np.array(rows), -1, 0))


def bending_mass(
    line_mass: Float[np.ndarray, " element"],
    rotary: Float[np.ndarray, " element"],
    ratio: Float[np.ndarray, " element"],
    length: Float[np.ndarray, " element"],
) -> Float[np.ndarray, "element 4 4"]:
    r"""Consistent mass for deflection and slope at both ends.

    The integrals of :math:`\rho A N^T N + \rho I \Psi^T \Psi` over the length, with the
    interpolations N of deflection and :math:`\Psi` of rotation that belong to
    `bending_stiffness`.

    Mass and rotary inertia are by length [kg/m], [kg m]; 0 neglects the latter.

    References
    ----------
    .. [1] Z. Friedman, J. B. Kosmatka, "An improved two-node Timoshenko beam finite element",
       Computers & Structures 47 (1993).
    """
    deflection, rotation = _interpolation(ratio, length)
    shares = _WEIGHT * length[:, None]
    mass = np.einsum("eg,eig,ejg->eij", shares * line_mass[:, None], deflection, deflection)
    turning = np.einsum("eg,eig,ejg->eij", shares * rotary[:, None], rotation, rotation)
    return np.asarray(mass + turning)


def _interpolation(ratio: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deflection and rotation at the Gauss points for a unit of each end's motion."""
    x, r, l = _XI, ratio[:, None], length[:, None]
    deflection = [
        1 - 3 * x**2 + 2 * x**3 + r * (1 - x),
        l * (x - 2 * x**2 + x**3 + r / 2 * (x - x**2)),
        3 * x**2 - 2 * x**3 + r * x,
        l * (-(x**2) + x**3 - r / 2 * (x - x**2)),
    ]
    rotation = [
        6 / l * (x**2 - x),
        1 - 4 * x + 3 * x**2 + r * (1 - x),
        6 / l * (x - x**2),
        -2 * x + 3 * x**2 + r * x,
    ]
    scale = 1.0 / (1.0 + r)
    return (
        np.stack([scale * n for n in deflection], axis=1),
        np.stack([scale * n for n in rotation], axis=1),
    )


def beam_matrix(
    axial: Float[np.ndarray, "element 2 2"],
    twist: Float[np.ndarray, "element 2 2"],
    plane_xy: Float[np.ndarray, "element 4 4"],
    plane_xz: Float[np.ndarray, "element 4 4"],
) -> Float[np.ndarray, "element 12 12"]:
    """Local matrices of beams from those of their four uncoupled motions."""
    whole = np.zeros((len(axial), 12, 12))
    mirrored = plane_xz * np.outer(_MIRROR, _MIRROR)
    for where, part in (
        (_AXIAL, axial),
        (_TWIST, twist),
        (_PLANE_XY, plane_xy),
        (_PLANE_XZ, mirrored),
    ):
        whole[np.ix_(range(len(axial)), where, where)] = part
    return whole


def spring_pair(stiffness: Float[np.ndarray, " element"]) -> Float[np.ndarray, "element 2 2"]:
    """Stiffness between two coordinates that a spring joins."""
    return np.asarray(stiffness[:, None, None] * np.array([[1.0, -1.0], [-1.0, 1.0]]))


def linear_mass(
    line_mass: Float[np.ndarray, " element"], length: Float[np.ndarray, " element"]
) -> Float[np.ndarray, "element 2 2"]:
    """Consistent mass of a motion that is linear between both ends.

    Of an inertia by length [kg m] it is that of rotations.
    """
    share = line_mass * length / 6.0
    return np.asarray(share[:, None, None] * np.array([[2.0, 1.0], [1.0, 2.0]]))


def bar_mass(
    line_mass: Float[np.ndarray, " element"], length: Float[np.ndarray, " element"]
) -> Float[np.ndarray, "element 12 12"]:
    """Consistent mass of bars, the same in all three directions; none for rotations."""
    whole = np.zeros((len(length), 12, 12))
    part = linear_mass(line_mass, length)
    for axis in range(3):
        where = [axis, axis + 6]
        whole[np.ix_(range(len(length)), where, where)] = part
    return whole


LOOSE = 1e-9
"""Stiffness of a released direction over that before the other releases [1] below which a beam
is a mechanism: rounding is six orders smaller, and a real beam keeps a quarter."""


def released(
    stiffness: Float[np.ndarray, "own own"],
    mass: Float[np.ndarray, "own own"],
    loose: Int[np.ndarray, " loose"],
) -> tuple[Float[np.ndarray, "own own"], Float[np.ndarray, "own own"]]:
    r"""Condense degrees of freedom of an element that pass no force to its nodes.

    With :math:`u_c = T u_r`, :math:`T = -K_{cc}^{-1} K_{cr}`, for the released :math:`u_c`, the
    stiffness is exact for loads at the ends, and the mass is Guyan's.

    Rows and columns of what is released are zero. Raises `ValueError` where the releases leave
    a mechanism.

    References
    ----------
    .. [1] R. J. Guyan, "Reduction of stiffness and mass matrices", AIAA Journal 3 (1965).
    """
    kept = np.setdiff1d(np.arange(len(stiffness)), loose)
    inner = stiffness[np.ix_(loose, loose)]
    scale = 1.0 / np.sqrt(np.diag(inner))
    if not np.linalg.eigvalsh(inner * np.outer(scale, scale))[0] > LOOSE:
        raise ValueError("is a mechanism with its releases. Release less at one of its ends.")
    follow = np.zeros((len(stiffness), len(kept)))
    follow[kept, np.arange(len(kept))] = 1.0
    follow[loose] = -np.linalg.solve(inner, stiffness[np.ix_(loose, kept)])
    found = []
    for whole in (stiffness, mass):
        condensed = np.zeros_like(whole)
        condensed[np.ix_(kept, kept)] = follow.T @ whole @ follow
        found.append(condensed)
    return found[0], found[1]


def to_global(
    local: Float[np.ndarray, "element own own"], axes: Float[np.ndarray, "element 3 3"]
) -> Float[np.ndarray, "element own own"]:
    """Matrices in global directions."""
    count = local.shape[1] // 3
    blocks = local.reshape(-1, count, 3, count, 3)
    turned = np.einsum("eki,eakbl,elj->eaibj", axes, blocks, axes, optimize=True)
    return np.asarray(turned.reshape(local.shape))
