"""Support vector regression with conformal prediction bands."""

from typing import Any

import numpy as np

from .interface import Surrogate

GRID = {
    "C": [1.0, 10.0, 100.0],
    "gamma": [0.03, 0.1, 0.3, 1.0],
    "epsilon": [0.01, 0.1],
}
ONE_SD = 0.6827


class SupportVectors(Surrogate):
    r"""Support-vector regression with radial functions, its settings found by cross-validation.

    The band is conformal: as wide as the errors on points left out, so that it holds a new
    point as often as it says whatever the function, if points come from the law of the design.
    It is equally wide everywhere, and the standard deviation is half its width at 68 %.

    Parameters
    ----------
    folds
        Of the cross-validation.
    grid
        Settings to try: lists of ``C``, ``gamma`` (over the number of inputs) and ``epsilon``
        for standardised inputs and outputs; a grid of 24 if None.
    extrapolation
        ``"warn"``, ``"raise"`` or ``"ignore"``.

    References
    ----------
    .. [1] V. Vovk, A. Gammerman and G. Shafer, "Algorithmic Learning in a Random World",
       Springer (2005). R. F. Barber et al., "Predictive inference with the jackknife+", Ann.
       Statist. 49 (2021) 486-507: with the errors of folds the guarantee weakens, in theory,
       to 1 - 2 (1 - level).

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 30)[:, None]
    >>> surrogate = SupportVectors().fit(x, np.sin(3.0 * x[:, 0]))
    >>> bool(abs(surrogate.predict([[0.5]])[0] - np.sin(1.5)) < 0.02)
    True
    """

    def __init__(
        self,
        *,
        folds: int = 5,
        grid: dict[str, list[float]] | None = None,
        extrapolation: str = "warn",
    ) -> None:
        self.folds = folds
        self.grid = grid
        self.extrapolation = extrapolation

    def _learn(self, x: np.ndarray, y: np.ndarray) -> None:
        from sklearn.model_selection import GridSearchCV, KFold, cross_val_predict
        from sklearn.svm import SVR

        self.mean_, self.sd_ = x.mean(axis=0), np.where(x.std(axis=0) > 0, x.std(axis=0), 1.0)
        standard = (x - self.mean_) / self.sd_
        grid: dict[str, Any] = dict(GRID if self.grid is None else self.grid)
        grid["gamma"] = [one / x.shape[1] for one in grid["gamma"]]
        parts = KFold(min(self.folds, len(y)), shuffle=True, random_state=0)
        search = GridSearchCV(
            SVR(cache_size=100), grid, cv=parts, scoring="neg_mean_squared_error"
        )
        self.machine_ = search.fit(standard, y).best_estimator_
        self.settings_ = search.best_params_
        again = KFold(min(self.folds, len(y)), shuffle=True, random_state=1)
        self.errors_ = np.sort(
            np.abs(y - cross_val_predict(self.machine_, standard, y, cv=again))
        )

    def _foretell(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean = self.machine_.predict((x - self.mean_) / self.sd_)
        return mean, np.full(len(x), self._half_width(ONE_SD))

    def _half_width(self, level: float) -> float:
        count = len(self.errors_)
        rank = int(np.ceil(level * (count + 1)))
        if rank > count:
            raise ValueError(
                f"{count} points say nothing of a {100 * level:g} % band without a law. Ask "
                f"for {100 * count / (count + 1):.0f} % at most, or give "
                f"{int(np.ceil(level / (1 - level)))} points."
            )
        return float(self.errors_[rank - 1])

    def _quantile(self, level: float) -> float:
        one = self._half_width(ONE_SD)
        return self._half_width(level) / one if one > 0.0 else 0.0
