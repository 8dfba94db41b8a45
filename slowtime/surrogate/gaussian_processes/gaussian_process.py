"""Gaussian process with a trend, a length per input and known noise per point."""

import itertools
import warnings
from collections.abc import Callable

import numpy as np

from slowtime.surrogate.surrogate_warnings import IllConditionedWarning

from .covariances import Covariance, covariance
from .process_surrogate import ProcessSurrogate
from .regression import TrainedProcess

TRENDS = ("none", "constant", "linear", "quadratic")
Trend = Callable[[np.ndarray], np.ndarray]


class GaussianProcess(ProcessSurrogate):
    r"""Process :math:`y = f(x)^T b + Z(x) + \epsilon`, its parameters learnt by likelihood.

    Parameters
    ----------
    kernel
        ``"matern12"``, ``"matern32"``, ``"matern52"``, ``"squared exponential"``,
        ``"periodic"`` or a sum such as ``"matern52 + periodic"``; a length for each input.
    trend
        ``"none"`` (the mean of the outputs), ``"constant"``, ``"linear"``, ``"quadratic"`` or
        a function from inputs [point input], in units of the box of the design, to columns.
    nugget
        Standard deviation of noise beside that given to `fit` [unit of y]; learnt if None.
    starts
        Of the search for the parameters.
    folds
        Parts of the design, each left out once and foretold by a process learnt from the
        others; the band is widened by what their errors ask for. 1 takes the likelihood's word.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    Attributes
    ----------
    log_likelihood_
        Restricted likelihood of the outputs, scaled to unit variance.
    inflation_
        By what the standard deviation of the process is multiplied, 1 or more; see `folds`.
    parameters_
        Parameters by name: logarithms, in units of the box and of the outputs' deviation.
    trend_
        Coefficients of the trend.

    References
    ----------
    .. [1] C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine Learning",
       MIT Press (2006), section 2.7 and chapter 5.

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 12)[:, None]
    >>> mean, sd = GaussianProcess().fit(x, np.sin(3.0 * x[:, 0])).predict([[0.5]], True)
    >>> float(mean[0].round(3)), bool(sd[0] < 0.01)
    (0.997, True)
    """

    def __init__(
        self,
        kernel: str = "matern52",
        *,
        trend: str | Trend = "constant",
        nugget: float | None = None,
        starts: int = 2,
        folds: int = 5,
        extrapolation: str = "warn",
    ) -> None:
        self.kernel = kernel
        self.trend = trend
        self.nugget = nugget
        self.starts = starts
        self.folds = folds
        self.extrapolation = extrapolation

    def _covariance(self) -> Covariance:
        return covariance(self.kernel)

    def _trend(self, unit: np.ndarray) -> np.ndarray:
        if callable(self.trend):
            return np.asarray(self.trend(unit), dtype=float)
        if self.trend not in TRENDS:
            raise ValueError(
                f"trend={self.trend!r} is not known. Allowed: {', '.join(TRENDS)}, or a "
                "function from inputs to columns."
            )
        columns = [np.ones(len(unit))] if self.trend != "none" else []
        if self.trend in ("linear", "quadratic"):
            columns += list(2.0 * unit.T - 1.0)
        if self.trend == "quadratic":
            pairs = itertools.combinations_with_replacement(range(unit.shape[1]), 2)
            columns += [(2.0 * unit[:, i] - 1.0) * (2.0 * unit[:, j] - 1.0) for i, j in pairs]
        return np.stack(columns, axis=1) if columns else np.empty((len(unit), 0))

    def _report(self, process: TrainedProcess) -> None:
        ranges = process.covariance.ranges(self.n_features_in_)
        names = [one.name for one in ranges]
        self.parameters_ = dict(zip(names, process.theta.tolist(), strict=False))
        self.trend_ = self.y_scale_ * process.trend
        columns = process.readings.trend
        if columns.shape[1] and np.linalg.matrix_rank(columns) < columns.shape[1]:
            warnings.warn(
                f"{len(columns)} points cannot tell the {columns.shape[1]} coefficients of the "
                f"trend apart. Give a simpler trend than {self.trend!r}, or more points.",
                IllConditionedWarning,
                stacklevel=3,
            )
