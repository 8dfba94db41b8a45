"""Score test of one more mode in the model of a band."""

import numpy as np
from jaxtyping import Complex

from .evaluation import evaluate
from .fisher_information import (
    ModelTangents,
    Tangents,
    add_prior,
    cross_information,
    real_rows,
    real_slopes,
    restricted_inverse,
    surprise_of,
)
from .model import BandData, BandModel


class AddedModeTest:
    """What one more mode would add to a model, to first order (half a score statistic)."""

    def __init__(self, data: BandData, model: BandModel) -> None:
        here = evaluate(data, model)
        if here.precision is None:
            raise ValueError("The density of the model is not positive definite.")
        self._data, self._by_group = data, here.precision
        self._precision = np.ascontiguousarray(here.precision.transpose(1, 2, 0))
        self._tangents = ModelTangents(data, model, here.gain, here.bent, self._precision)
        self._surprise = surprise_of(data, here.density, here.precision)
        information, score = add_prior(
            model,
            self._tangents.information(self._precision, data.number),
            self._tangents.score(self._surprise),
        )
        self._inverse = restricted_inverse(information)
        self._step = self._inverse @ score

    def gain(
        self, pole: complex, shape: Complex[np.ndarray, " direction"]
    ) -> tuple[float, Complex[np.ndarray, " direction"]]:
        """Log-likelihood gained by one more mode, to first order.

        The better of two shapes counts, and is given: the one tried, and that which the data
        ask for there.
        """
        shapes = shape, self._asked_for(pole)
        gains = [self._gain(pole, each) for each in shapes]
        return max(gains), shapes[int(np.argmax(gains))]

    def _gain(self, pole: complex, shape: np.ndarray) -> float:
        # With no force as yet, neither pole nor shape of the new mode makes a difference.
        response = 1.0 / (1j * self._data.omega - pole)
        new = Tangents.of(shape[None], response[None], self._precision)
        sums = cross_information(new, new, self._precision, self._data.number)
        known = real_rows(*(one[0, :, 0] for one in sums))
        plain, turned = cross_information(
            self._tangents.vectors, new, self._precision, self._data.number
        )
        across = self._tangents.real_parameters(
            real_rows(*(self._tangents.coordinates(one[:, :, 0]) for one in (plain, turned)))
        )
        known = known - across.T @ self._inverse @ across
        left = real_slopes(new.score(self._surprise)[0, :, 0]) - across.T @ self._step
        return float(0.5 * left @ restricted_inverse((known + known.T) / 2) @ left)

    def _asked_for(self, pole: complex) -> np.ndarray:
        """Shape along which a little power at a pole would raise the likelihood most."""
        weight = 1.0 / np.abs(1j * self._data.omega - pole) ** 2
        size = np.tensordot(self._data.number * weight, self._by_group, axes=1)
        slope = self._surprise @ weight
        root = np.linalg.inv(np.linalg.cholesky(size))
        directions = np.linalg.eigh(root @ slope @ root.conj().T)[1]
        shape = root.conj().T @ directions[:, -1]
        return np.asarray(shape / np.linalg.norm(shape))
