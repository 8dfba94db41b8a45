"""Domain of a design: the region in which a surrogate has training points."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError

HULL_INPUTS = 3
"""In more inputs even a good design has next to nothing within its hull: an ellipsoid tells."""


@dataclasses.dataclass(frozen=True, slots=True)
class Domain:
    """Box of a design, and its hull (up to three inputs) or ellipsoid within it."""

    lo: Float[np.ndarray, " input"]
    hi: Float[np.ndarray, " input"]
    margin: float
    """Share of the box by which points may lie outside: no design reaches its own ends."""

    faces: Float[np.ndarray, "face coefficient"] | None
    centre: Float[np.ndarray, " input"]
    spacing: float
    """Between neighbours of an even design: so far beyond its hull it is still at home."""

    whitening: Float[np.ndarray, "input input"]
    reach: float

    def beyond(self, x: Float[np.ndarray, "sample input"]) -> Bool[np.ndarray, "sample input"]:
        """Tell which inputs of which points lie outside the box of the design.

        Parameters
        ----------
        x
            Points, in the units of the design.

        Returns
        -------
        True for each input that lies outside.
        """
        edge = self.margin * (self.hi - self.lo) + 1e-9 * np.abs(self.hi - self.lo)
        outside: Bool[np.ndarray, "sample input"] = (x < self.lo - edge) | (x > self.hi + edge)
        return outside

    def outside(self, x: Float[np.ndarray, "sample input"]) -> Bool[np.ndarray, " sample"]:
        """Tell which points lie outside the box of the design, or its hull or ellipsoid.

        Parameters
        ----------
        x
            Points, in the units of the design.

        Returns
        -------
        True for each point that lies outside.
        """
        unit = (x - self.centre) / np.where(self.hi > self.lo, self.hi - self.lo, 1.0)
        if self.faces is None:
            far = np.sum((unit @ self.whitening) ** 2, axis=1) > self.reach
        else:
            far = (unit @ self.faces[:, :-1].T + self.faces[:, -1] > self.spacing).any(axis=1)
        answer: Bool[np.ndarray, " sample"] = far | self.beyond(x).any(axis=1)
        return answer


def domain(x: Float[np.ndarray, "sample input"]) -> Domain:
    """Domain of a design: its box, and its hull (up to three inputs) or ellipsoid.

    Parameters
    ----------
    x
        Points of the design, each input in its own unit.
    """
    count, inputs = x.shape
    lo, hi = x.min(axis=0), x.max(axis=0)
    centre = x.mean(axis=0)
    unit = (x - centre) / np.where(hi > lo, hi - lo, 1.0)
    values, vectors = np.linalg.eigh(np.cov(unit, rowvar=False).reshape(inputs, inputs))
    whitening = vectors / np.sqrt(np.maximum(values, 1e-10))
    distance = np.sum((unit @ whitening) ** 2, axis=1)
    margin = 2.0 / (count + 1)
    # Of a cube the corners lie at three times the mean square: a box of its own needs no less.
    reach = max(float(distance.max()) * (1.0 + margin) ** 2, 3.0 * inputs)
    spacing = float(count ** (-1.0 / inputs))
    return Domain(lo, hi, margin, _faces(unit), centre, spacing, whitening, reach)


def _faces(unit: np.ndarray) -> np.ndarray | None:
    if not 2 <= unit.shape[1] <= HULL_INPUTS or len(unit) <= unit.shape[1] + 1:
        return None
    try:
        return np.asarray(ConvexHull(unit).equations)
    except QhullError:  # all on a plane: the ellipsoid tells
        return None
