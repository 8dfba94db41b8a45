"""Score test of one more mode in the model of a band."""

import numpy as np
from jaxtyping import Complex

from .fisher_information import (
    add_prior,
    density_derivatives,
    misfit,
    outer_product_rows,
    restricted_inverse,
    whitener,
)
from .model import BandData, BandModel


class AddedModeTest:
    """What one more mode would add to a model, to first order (half a score statistic)."""

    def __init__(self, data: BandData, model: BandModel) -> None:
        density = model.predicted(data)
        self._data, self._density = data, density
        self._root = whitener(data, density)
        self._rows = density_derivatives(model, data, self._root)
        self._left = misfit(data, density, self._root)
        information, score = add_prior(
            model, self._rows @ self._rows.T, self._rows @ self._left
        )
        self._inverse = restricted_inverse(information)
        self._step = self._inverse @ score

    def gain(
        self, pole: complex, shape: Complex[np.ndarray, " direction"]
    ) -> tuple[float, Complex[np.ndarray, " direction"]]:
        """Log-likelihood gained by one more mode, to first order.

        The better of two: the shape given, and that which the data ask for there.

        Parameters
        ----------
        pole
            Pole, in the unit of the model.
        shape
            Shape that is tried, besides that which the data suggest.

        Returns
        -------
        Gain, and the better of the two shapes.
        """
        shapes = shape, self._asked_for(pole)
        gains = [self._gain(pole, each) for each in shapes]
        return max(gains), shapes[int(np.argmax(gains))]

    def _gain(self, pole: complex, shape: np.ndarray) -> float:
        # With no force as yet, neither pole nor shape of the new mode makes a difference.
        gain = 1.0 / (1j * self._data.omega - pole)
        seen = gain[:, None] * (self._root @ shape)
        own = outer_product_rows(seen[None], self._root.transpose(2, 0, 1))
        across = self._rows @ own.T
        known = own @ own.T - across.T @ self._inverse @ across
        left = own @ self._left - across.T @ self._step
        return float(0.5 * left @ restricted_inverse((known + known.T) / 2) @ left)

    def _asked_for(self, pole: complex) -> np.ndarray:
        """Shape along which a little power at a pole would raise the likelihood most."""
        weight = self._data.number / np.abs(1j * self._data.omega - pole) ** 2
        inverse = np.linalg.inv(self._density)
        slope = inverse @ (self._data.density - self._density) @ inverse
        size, slope = (np.tensordot(weight, each, axes=1) for each in (inverse, slope))
        root = np.linalg.inv(np.linalg.cholesky(size))
        directions = np.linalg.eigh(root @ slope @ root.conj().T)[1]
        shape = root.conj().T @ directions[:, -1]
        return np.asarray(shape / np.linalg.norm(shape))
