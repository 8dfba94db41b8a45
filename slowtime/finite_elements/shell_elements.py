r"""Matrices of flat four-node shells: a plate with shear deformation and a membrane.

All functions take arrays over elements. Degrees of freedom of a node: displacements along, then
rotations about, x, y, z. In local axes the midsurface is the x-y plane, and a line across it
turns by :math:`\beta_x = \theta_y` and :math:`\beta_y = -\theta_x`.

References
----------
.. [1] E. N. Dvorkin, K.-J. Bathe, "A continuum mechanics based four-node shell element for
   general non-linear analysis", Engineering Computations 1 (1984): transverse shear (MITC4).
.. [2] R. L. Taylor, P. J. Beresford, E. L. Wilson, "A non-conforming element for stress
   analysis", Int. J. Numer. Methods Eng. 10 (1976): the membrane (QM6).
.. [3] T. J. R. Hughes, F. Brezzi, "On drilling degrees of freedom", Comput. Methods Appl. Mech.
   Eng. 72 (1989): the rotation about the normal.
"""

import numpy as np
from jaxtyping import Float

WARPED = 1e-3
"""Distance of a corner from the mean plane over the root of the area [1] up to which an element
counts as flat: rigid rotations then strain it by as little as coordinates of four digits do."""

SHEAR_FACTOR = 5.0 / 6.0
"""Shear area over area of a solid plate [1], for parabolic shear stress."""

DRILLING = 0.01
"""Stiffness that ties the rotation about the normal to that of the membrane, over the shear
modulus [1]. Without it that rotation is free where elements lie in one plane. A cantilever of
ten elements that bends in its plane is as stiff as a beam to 1 % (`test_shell_elements`)."""

_CORNER_R, _CORNER_S = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
_GAUSS = [(r / np.sqrt(3.0), s / np.sqrt(3.0)) for r in (-1.0, 1.0) for s in (-1.0, 1.0)]
"""Points of the 2 x 2 rule, all of weight one."""


def shell_axes(corners: Float[np.ndarray, "element 4 3"]) -> Float[np.ndarray, "element 3 3"]:
    """Compute unit vectors of the local axes x, y, z of shells, one row each.

    The normal is that of both diagonals; x is along the first side.

    Local components are `axes @ global components`. Raises `ValueError` where an element has no
    area, is not flat or not convex.
    """
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    area = np.linalg.norm(normal, axis=1) / 2
    if not (area > 0.0).all():
        raise ValueError(
            f"Shell number {int(np.argmin(area)) + 1} has no area. Give four corners in order "
            "around it."
        )
    z = normal / (2 * area[:, None])
    side = corners[:, 1] - corners[:, 0]
    x = side - np.sum(side * z, axis=1)[:, None] * z
    length = np.linalg.norm(x, axis=1)
    if not (length > 0.0).all():
        raise ValueError(
            f"Shell number {int(np.argmin(length)) + 1} has two corners at one place. Give "
            "four places."
        )
    x = x / length[:, None]
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    local = _local(corners, axes)
    warp = np.abs(local[:, :, 2]).max(axis=1) / np.sqrt(area)
    if warp.max() > WARPED:
        raise ValueError(
            f"Shell number {int(np.argmax(warp)) + 1} is not flat: a corner is "
            f"{warp.max():.2g} times its size off the mean plane, and {WARPED:g} is allowed. "
            "Use smaller elements."
        )
    turned = np.array(
        [_jacobian(local, r, s)[1] for r, s in zip(_CORNER_R, _CORNER_S, strict=True)]
    )
    if not turned.min() > 0.0:
        raise ValueError(
            f"Shell number {int(np.argmin(turned.min(axis=0))) + 1} is not convex. Give its "
            "corners in order around it, with angles below 180 degrees."
        )
    return axes


def shell_stiffness(
    corners: Float[np.ndarray, "element 4 3"],
    axes: Float[np.ndarray, "element 3 3"],
    material: tuple[np.ndarray, np.ndarray],
    thickness: Float[np.ndarray, " element"],
) -> Float[np.ndarray, "element 24 24"]:
    """Stiffness of shells in local directions.

    The material is given by moduli of elasticity [Pa] and Poisson's ratios [1].
    """
    young, poisson = material
    shear = young / (2 * (1 + poisson))
    place = _local(corners, axes)
    plane = _plane_stress(young, poisson)
    centre, centre_size = _jacobian(place, 0.0, 0.0)
    inverse_centre = np.linalg.inv(centre)
    whole = np.zeros((len(place), 24, 24))
    modes = np.zeros((len(place), 4, 4))
    mixed = np.zeros((len(place), 4, 24))
    for r, s in _GAUSS:
        jacobian, size = _jacobian(place, r, s)
        slopes = np.linalg.inv(jacobian) @ _derivatives(r, s)
        membrane, bending = _in_plane(slopes)
        across = _assumed_shear(place, r, s, jacobian)
        extra = _extra_modes(inverse_centre, centre_size / size, r, s)
        drill = _drilling(slopes, r, s)
        flat = (thickness * size)[:, None, None] * plane
        whole += membrane.mT @ flat @ membrane
        whole += bending.mT @ (flat * (thickness**2 / 12)[:, None, None]) @ bending
        sheared = SHEAR_FACTOR * shear * thickness * size
        whole += sheared[:, None, None] * (across.mT @ across)
        whole += (DRILLING * shear * thickness * size)[:, None, None] * (drill.mT @ drill)
        modes += extra.mT @ flat @ extra
        mixed += extra.mT @ flat @ membrane
    return np.asarray(whole - mixed.mT @ np.linalg.solve(modes, mixed))


def shell_mass(
    corners: Float[np.ndarray, "element 4 3"],
    axes: Float[np.ndarray, "element 3 3"],
    density: Float[np.ndarray, " element"],
    thickness: Float[np.ndarray, " element"],
) -> Float[np.ndarray, "element 24 24"]:
    """Consistent mass of shells in local directions, with rotary inertia."""
    place = _local(corners, axes)
    shares = np.zeros((len(place), 4, 4))
    for r, s in _GAUSS:
        shape = _shapes(r, s)
        shares += _jacobian(place, r, s)[1][:, None, None] * np.outer(shape, shape)
    moving = (density * thickness)[:, None, None] * shares
    turning = (thickness**2 / 12)[:, None, None] * moving
    whole = np.zeros((len(place), 24, 24))
    for k in range(6):
        whole[:, k::6, k::6] = moving if k < 3 else turning
    return whole


def _local(corners: np.ndarray, axes: np.ndarray) -> np.ndarray:
    middle = corners.mean(axis=1, keepdims=True)
    return np.asarray((corners - middle) @ axes.mT)


def _plane_stress(young: np.ndarray, poisson: np.ndarray) -> np.ndarray:
    """Stress over strain in a plane: xx, yy and shear."""
    plane = np.zeros((len(young), 3, 3))
    plane[:, 0, 0] = plane[:, 1, 1] = 1.0
    plane[:, 0, 1] = plane[:, 1, 0] = poisson
    plane[:, 2, 2] = (1 - poisson) / 2
    return np.asarray((young / (1 - poisson**2))[:, None, None] * plane)


def _shapes(r: float, s: float) -> np.ndarray:
    return np.asarray((1 + r * _CORNER_R) * (1 + s * _CORNER_S) / 4)


def _derivatives(r: float, s: float) -> np.ndarray:
    """Slopes of the four shape functions along r and s."""
    along = _CORNER_R * (1 + s * _CORNER_S) / 4
    return np.stack([along, _CORNER_S * (1 + r * _CORNER_R) / 4])


def _jacobian(place: np.ndarray, r: float, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of x and y along r and s, and their determinant [m^2]."""
    jacobian = _derivatives(r, s) @ place[:, :, :2]
    return jacobian, np.linalg.det(jacobian)


def _in_plane(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Membrane strains and curvatures over the degrees of freedom."""
    membrane = np.zeros((len(slopes), 3, 24))
    membrane[:, 0, 0::6] = membrane[:, 2, 1::6] = slopes[:, 0]
    membrane[:, 1, 1::6] = membrane[:, 2, 0::6] = slopes[:, 1]
    bending = np.zeros_like(membrane)
    bending[:, 0, 4::6], bending[:, 1, 3::6] = slopes[:, 0], -slopes[:, 1]
    bending[:, 2, 4::6], bending[:, 2, 3::6] = slopes[:, 1], -slopes[:, 0]
    return membrane, bending


def _assumed_shear(place: np.ndarray, r: float, s: float, jacobian: np.ndarray) -> np.ndarray:
    """Transverse shear that is interpolated between the middles of the sides."""
    natural = np.zeros((len(place), 2, 24))
    sides = (
        (0, (0.0, -1.0), (1 - s) / 2),
        (0, (0.0, 1.0), (1 + s) / 2),
        (1, (-1.0, 0.0), (1 - r) / 2),
        (1, (1.0, 0.0), (1 + r) / 2),
    )
    for way, middle, share in sides:
        shape, slope = _shapes(*middle), _derivatives(*middle)[way]
        tangent = (slope @ place)[:, :2]
        natural[:, way, 2::6] += share * slope
        natural[:, way, 4::6] += share * tangent[:, :1] * shape
        natural[:, way, 3::6] -= share * tangent[:, 1:] * shape
    return np.asarray(np.linalg.solve(jacobian, natural))


def _extra_modes(inverse: np.ndarray, ratio: np.ndarray, r: float, s: float) -> np.ndarray:
    """Strains of the inner modes 1 - r^2 and 1 - s^2 of both displacements."""
    slope = ratio[:, None, None] * (inverse @ np.diag([-2.0 * r, -2.0 * s]))
    extra = np.zeros((len(inverse), 3, 4))
    extra[:, 0, :2] = extra[:, 2, 2:] = slope[:, 0]
    extra[:, 1, 2:] = extra[:, 2, :2] = slope[:, 1]
    return extra


def _drilling(slopes: np.ndarray, r: float, s: float) -> np.ndarray:
    """Rotation about the normal less that of the membrane."""
    drill = np.zeros((len(slopes), 1, 24))
    drill[:, 0, 5::6] = _shapes(r, s)
    drill[:, 0, 0::6] = slopes[:, 1] / 2
    drill[:, 0, 1::6] = -slopes[:, 0] / 2
    return drill
