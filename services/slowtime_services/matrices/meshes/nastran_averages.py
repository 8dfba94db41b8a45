r"""Interpolation elements RBE3 of bulk data → relations of a frame.

A reference point moves as the rigid body that fits the motions of its points best,

.. math:: \min_{u, \varphi} \sum_i w_i |u_i - u - \varphi \times r_i|^2
          \;\Rightarrow\;
          \begin{pmatrix} u \\ \varphi \end{pmatrix} = (S^T W S)^{-1} S^T W \, u_{points}

so that forces on it are spread over the points and stiffen nothing. Each component of the
reference point is one relation.

References
----------
.. [1] MSC Nastran, "Quick Reference Guide", bulk data entry RBE3.
"""

import numpy as np
from jaxtyping import Float

from .mesh import DIRECTIONS, Mesh
from .nastran_deck import Fields

TRANSLATIONS = {0, 1, 2}
FLAT = 1e-9
"""Smallest over largest eigenvalue of the fit [1], lengths over the size of the group, below
which the points do not determine the rotation: rounding of positions with ten digits."""

NEGLIGIBLE = 1e-12
"""Factor over the largest one [1] of a term that rounding leaves."""

END_OF_GROUPS = ("UM", "ALPHA")


def average(mesh: Mesh, card: Fields) -> None:
    """Add the relations of one RBE3 to a mesh.

    Parameters
    ----------
    mesh
        With all points.

    Raises
    ------
    MatrixFileError
        Where its components are others than translations, or its points do not determine
        the motion.
    """
    reference, moved = card.whole(3), card.directions(4)
    centre = np.array(mesh.place(reference, card.line))
    points = _weighed_points(mesh, card)
    arms = np.array([mesh.place(name, card.line) for name, _, _ in points]) - centre
    size = float(np.linalg.norm(arms, axis=1).max()) or 1.0
    rows = np.concatenate(
        [
            _rigid_rows(arm / size)[list(ways)]
            for arm, (_, ways, _) in zip(arms, points, strict=True)
        ]
    )
    weights = np.concatenate([np.full(len(ways), weight) for _, ways, weight in points])
    normal = rows.T @ (weights[:, None] * rows)
    values = np.linalg.eigvalsh(normal)
    if not values[0] > FLAT * values[-1]:
        raise card.error(
            "has points whose translations do not determine the motion of the reference point, "
            "such as points on one line. Add points, or use RBE2."
        )
    factors = np.linalg.solve(normal, rows.T * weights)
    factors[3:] /= size
    names = [(name, way) for name, ways, _ in points for way in ways]
    for k in moved:
        terms = [{"node": reference, "direction": DIRECTIONS[k], "factor": 1.0}]
        least = NEGLIGIBLE * float(np.abs(factors[k]).max())
        terms += [
            {"node": name, "direction": DIRECTIONS[way], "factor": -factor}
            for (name, way), factor in zip(names, factors[k].tolist(), strict=True)
            if abs(factor) > least
        ]
        mesh.constraints.append({"terms": terms})


def _rigid_rows(arm: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 6"]:
    """Displacements of a point at an arm, of translations and rotations of a rigid body."""
    x, y, z = arm
    turned = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.concatenate([np.eye(3), turned], axis=1)


def _weighed_points(mesh: Mesh, card: Fields) -> list[tuple[str, tuple[int, ...], float]]:
    """Points of all groups with their components, 0 to 2, and weights."""
    found: list[tuple[str, tuple[int, ...], float]] = []
    weight = 0.0
    ways: tuple[int, ...] = ()
    k = 5
    while k < len(card) and card.text(k).upper() not in END_OF_GROUPS:
        text = card.text(k)
        if text and not text.isdecimal():
            weight, ways = card.real(k), card.directions(k + 1)
            if not weight > 0.0 or not ways or set(ways) - TRANSLATIONS:
                raise card.error(
                    f"has the weight {text} and components {card.text(k + 1)!r}. Allowed are "
                    "positive weights, and components 1 to 3 of the points that are averaged."
                )
            k += 1
        elif text:
            if not ways:
                raise card.error("begins with a point. A weight and its components come first.")
            mesh.place(card.whole(k), card.line)
            found.append((card.whole(k), ways, weight))
        k += 1
    if not found:
        raise card.error("averages no points. Name them after a weight and components.")
    if any(card.text(j).upper() == "UM" for j in range(k, len(card))):
        raise card.error("names dependent components of its own (UM). Leave them out.")
    return found
