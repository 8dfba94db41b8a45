"""Base of Gaussian-process surrogates: scales, noise and training."""

from typing import Any, TypeVar

import numpy as np

from slowtime.surrogate.interface import Surrogate

from .covariances import Covariance
from .regression import RegressionData, TrainedProcess, learn, trust

LEAST_LEFT = 6
"""Points without which nothing is learnt anew to see how far a band can be trusted."""

Own = TypeVar("Own", bound="ProcessSurrogate")


class ProcessSurrogate(Surrogate):
    """A surrogate whose law is a Gaussian process, with known noise per point if there is."""

    nugget: float | None
    starts: int
    folds: int

    def fit(self: Own, X: Any, y: Any, noise_sd: Any = None) -> Own:
        """Learn from inputs [point input] and outputs [point].

        Parameters
        ----------
        X
            Points [sample, input].
        y
            Outputs [sample].
        noise_sd
            Known standard deviation of each output, or of all [unit of y]; none if None.

        Returns
        -------
        This surrogate, fitted.
        """
        x, scaled = self._prepare(X, y)
        variance = np.zeros(len(scaled))
        if noise_sd is not None:
            given = np.asarray(noise_sd, dtype=float)
            if given.shape not in ((), (len(scaled),)) or not (given >= 0.0).all():
                raise ValueError(
                    f"noise_sd of shape {given.shape} for {len(scaled)} outputs, or negative. "
                    "Give one non-negative number for all, or one for each."
                )
            variance = np.broadcast_to((given / self.y_scale_) ** 2, (len(scaled),)).copy()
        unit = self._unit(x)
        readings = RegressionData(unit, self._trend(unit), scaled, variance)
        nugget = None if self.nugget is None else float(self.nugget) / self.y_scale_
        self.process_ = learn(self._covariance(), readings, nugget=nugget, starts=self.starts)
        self.inflation_ = self._inflation(self.process_)
        self.log_likelihood_ = self.process_.log_likelihood
        self.nugget_ = self.process_.nugget * self.y_scale_
        self._report(self.process_)
        return self

    def _foretell(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        unit = self._unit(x)
        mean, variance = self.process_.predict(unit, self._trend(unit))
        return mean, self.inflation_ * np.sqrt(variance)

    def _inflation(self, process: TrainedProcess) -> float:
        count, columns = process.readings.trend.shape
        left = count - int(np.ceil(count / self.folds)) if self.folds > 1 else 0
        if left < max(LEAST_LEFT, columns + 2):
            return 1.0
        # Shuffled, since designs come sorted, and always alike, so that fits can be repeated.
        rng = np.random.default_rng(count)
        ratio = trust(process, learn_nugget=self.nugget is None, folds=self.folds, rng=rng)
        return max(ratio, 1.0)

    def leave_one_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Error and standard deviation of each output as the others foretell it [unit of y]."""
        error, sd = self.process_.left_out()
        return self.y_scale_ * error, self.y_scale_ * sd

    def _covariance(self) -> Covariance:
        raise NotImplementedError(f"{type(self).__name__} does not say its covariance.")

    def _trend(self, unit: np.ndarray) -> np.ndarray:
        """Columns of the trend; a constant."""
        return np.ones((len(unit), 1))

    def _report(self, process: TrainedProcess) -> None:
        """Keep what a user wants to see of the process."""
