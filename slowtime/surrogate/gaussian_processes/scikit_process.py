"""Gaussian process of scikit-learn behind the surrogate interface, for comparison."""

import warnings

import numpy as np

from slowtime.surrogate.interface import Surrogate


class PlainProcess(Surrogate):
    """scikit-learn's Gaussian process: a length per input, no trend, noise alike everywhere.

    Parameters
    ----------
    smoothness
        0.5, 1.5, 2.5 of a Matérn kernel, or infinity for a squared exponential.
    restarts
        Of the search for the parameters.
    random_state
        Seed of the restarts.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 12)[:, None]
    >>> PlainProcess().fit(x, np.sin(3.0 * x[:, 0])).predict([[0.5]]).round(3)
    array([0.997])
    """

    def __init__(
        self,
        *,
        smoothness: float = 2.5,
        restarts: int = 0,
        random_state: int = 0,
        extrapolation: str = "warn",
    ) -> None:
        self.smoothness = smoothness
        self.restarts = restarts
        self.random_state = random_state
        self.extrapolation = extrapolation

    def _learn(self, x: np.ndarray, y: np.ndarray) -> None:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

        lengths = np.ones(x.shape[1])
        kernel = ConstantKernel(1.0, (1e-4, 1e4)) * Matern(
            lengths, (0.02, 500.0), nu=self.smoothness
        ) + WhiteKernel(1e-6, (1e-11, 1.0))
        self.process_ = GaussianProcessRegressor(
            kernel, n_restarts_optimizer=self.restarts, random_state=self.random_state
        )
        with warnings.catch_warnings():
            # It warns of every length at its bound, which is how an idle input looks.
            warnings.simplefilter("ignore", ConvergenceWarning)
            self.process_.fit(self._unit(x), y)

    def _foretell(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean, sd = self.process_.predict(self._unit(x), return_std=True)
        noise = float(self.process_.kernel_.k2.noise_level)
        return mean, np.sqrt(np.maximum(sd**2 - noise, 0.0))
