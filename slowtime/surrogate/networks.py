"""Ensembles of neural networks, with their disagreement as uncertainty."""

import warnings

import numpy as np

from .interface import Surrogate


class NetworkEnsemble(Surrogate):
    """Networks that have each seen all but one part of the design; their mean is foretold.

    The standard deviation joins how far they disagree with how far each is off on the part that
    it has not seen.

    Parameters
    ----------
    members
        Networks, and parts of the design.
    hidden
        Units in each hidden layer.
    decay
        Weight decay; more makes smoother functions.
    activation
        ``"tanh"`` for smooth functions, ``"relu"`` for kinks.
    iterations
        Most steps of the optimiser (L-BFGS, which suits designs of hundreds of points).
    random_state
        Seed of the initial weights and of the parts.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 30)[:, None]
    >>> surrogate = NetworkEnsemble().fit(x, np.sin(3.0 * x[:, 0]))
    >>> bool(abs(surrogate.predict([[0.5]])[0] - np.sin(1.5)) < 0.02)
    True
    """

    def __init__(
        self,
        *,
        members: int = 5,
        hidden: tuple[int, ...] = (20, 20),
        decay: float = 1e-3,
        activation: str = "tanh",
        iterations: int = 300,
        random_state: int = 0,
        extrapolation: str = "warn",
    ) -> None:
        self.members = members
        self.hidden = hidden
        self.decay = decay
        self.activation = activation
        self.iterations = iterations
        self.random_state = random_state
        self.extrapolation = extrapolation

    def _learn(self, x: np.ndarray, y: np.ndarray) -> None:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.model_selection import KFold
        from sklearn.neural_network import MLPRegressor

        self.mean_, self.sd_ = x.mean(axis=0), np.where(x.std(axis=0) > 0, x.std(axis=0), 1.0)
        standard = (x - self.mean_) / self.sd_
        parts = KFold(min(self.members, len(y)), shuffle=True, random_state=self.random_state)
        self.networks_, unseen = [], np.empty(len(y))
        for k, (seen, rest) in enumerate(parts.split(standard)):
            network = MLPRegressor(
                hidden_layer_sizes=self.hidden,
                activation=self.activation,
                solver="lbfgs",
                alpha=self.decay,
                max_iter=self.iterations,
                random_state=self.random_state + k,
            )
            with warnings.catch_warnings():
                # Stopped early is what is asked for; how good it is the unseen part tells.
                warnings.simplefilter("ignore", ConvergenceWarning)
                network.fit(standard[seen], y[seen])
            unseen[rest] = y[rest] - network.predict(standard[rest])
            self.networks_.append(network)
        self.unseen_ = float(np.mean(unseen**2))
        self.usual_ = float(np.mean(self._each(standard).var(axis=0, ddof=1)))

    def _each(self, standard: np.ndarray) -> np.ndarray:
        return np.array([one.predict(standard) for one in self.networks_])

    def _foretell(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        each = self._each((x - self.mean_) / self.sd_)
        spread = each.var(axis=0, ddof=1)
        return each.mean(axis=0), np.sqrt(spread + max(self.unseen_ - self.usual_, 0.0))
