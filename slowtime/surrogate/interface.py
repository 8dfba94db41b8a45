"""Common interface of surrogates: design checks, scaling, bands, extrapolation flags.

Estimators after scikit-learn's conventions, so that pipelines, `clone`, grid searches and
cross-validation work. Inputs arrive as anything scikit-learn takes.
"""

import warnings
from typing import Any, Literal, TypeVar, overload

import numpy as np
from scipy import stats

try:
    from sklearn.base import BaseEstimator, RegressorMixin
    from sklearn.utils.validation import check_is_fitted, validate_data
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError(
        "Surrogates follow scikit-learn, which is not installed. Run "
        "`pip install 'slowtime[surrogate]'`."
    ) from missing

from .bases import Law
from .domain import domain
from .surrogate_warnings import ExtrapolationWarning, FewPointsWarning, IllConditionedWarning

LEAST_POINTS = 3
EXTRAPOLATIONS = ("warn", "raise", "ignore")
ALIKE = 1e-10
"""Share of the widest direction of a design below which it has no width."""

Own = TypeVar("Own", bound="Surrogate")


class Surrogate(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """A function learnt from points: mean and standard deviation at any other."""

    extrapolation: str

    def fit(self: Own, X: Any, y: Any) -> Own:
        """Learn from inputs [point input] and outputs [point]."""
        x, scaled = self._prepare(X, y)
        self._learn(x, scaled)
        return self

    @overload
    def predict(self, X: Any, return_std: Literal[False] = False) -> np.ndarray: ...

    @overload
    def predict(self, X: Any, return_std: Literal[True]) -> tuple[np.ndarray, np.ndarray]: ...

    def predict(
        self, X: Any, return_std: bool = False
    ) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
        """Mean at points and, if asked for, its standard deviation, both in units of `y`.

        Points where the design has none are warned of, or refused (`extrapolation`).
        """
        x = self._checked_points(X)
        mean, sd = self._foretell(x)
        mean = self.y_mean_ + self.y_scale_ * mean
        return (mean, self.y_scale_ * sd) if return_std else mean

    def predict_interval(self, X: Any, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Compute the ends of the band that holds the function with probability `level`.

        Parameters
        ----------
        X
            Points [sample, input].
        level
            Probability [1].

        Returns
        -------
        Lower and upper end at each point [unit of the outputs].

        Raises
        ------
        ValueError
            Where `level` is outside (0, 1).
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"{level=} is outside (0, 1). Give 0.95 for a 95 % band.")
        mean, sd = self.predict(X, return_std=True)
        half = self._quantile(level) * sd
        return mean - half, mean + half

    def extrapolates(self, X: Any) -> np.ndarray:
        """Which points lie where the design has none: outside its box or hull."""
        check_is_fitted(self)
        x = validate_data(self, X, reset=False, dtype=np.float64)
        return self.domain_.outside(x)

    def _learn(self, x: np.ndarray, y: np.ndarray) -> None:
        raise NotImplementedError(f"{type(self).__name__} does not say how it learns.")

    def _foretell(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        raise NotImplementedError(f"{type(self).__name__} does not say how it foretells.")

    def _quantile(self, level: float) -> float:
        """Half-width of a band of that level, over the standard deviation."""
        return float(stats.norm.ppf(0.5 + 0.5 * level))

    def _prepare(self, X: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        if self.extrapolation not in EXTRAPOLATIONS:
            raise ValueError(
                f"extrapolation={self.extrapolation!r} is not known. "
                f"Allowed: {', '.join(EXTRAPOLATIONS)}."
            )
        x, outputs = validate_data(
            self,
            X,
            y,
            dtype=np.float64,
            y_numeric=True,
            ensure_min_samples=LEAST_POINTS,
        )
        outputs = np.asarray(outputs, dtype=np.float64)
        scale = float(outputs.std())
        if scale <= 1e-12 * float(np.abs(outputs).max(initial=0.0)):
            raise ValueError(
                f"All {len(outputs)} outputs are {outputs[0]:g}: there is nothing to learn. "
                "Check which column is the output; if it really is constant, use that value "
                "instead of a surrogate."
            )
        _judge(x)
        self.domain_ = domain(x)
        self.y_mean_, self.y_scale_ = float(outputs.mean()), scale
        return x, (outputs - self.y_mean_) / scale

    def _checked_points(self, X: Any) -> np.ndarray:
        check_is_fitted(self)
        x: np.ndarray = validate_data(self, X, reset=False, dtype=np.float64)
        outside = self.domain_.outside(x)
        if self.extrapolation != "ignore" and outside.any():
            text = self._where(x, outside)
            if self.extrapolation == "raise":
                raise ValueError(text)
            warnings.warn(text, ExtrapolationWarning, stacklevel=3)
        return x

    def _where(self, x: np.ndarray, outside: np.ndarray) -> str:
        beyond = self.domain_.beyond(x)
        text = f"{int(outside.sum())} of {len(x)} points lie where the design has none"
        if beyond.any():
            k, d = map(int, np.argwhere(beyond)[0])
            lo, hi = self.domain_.lo[d], self.domain_.hi[d]
            text += f", such as point {k}: input {d} is {x[k, d]:g}, taught [{lo:g}, {hi:g}]"
        else:
            text += f", such as point {int(np.argmax(outside))}: within the box, off the design"
        return text + ". What is said there is a guess; add points, or set extrapolation."

    def _unit(self, x: np.ndarray) -> np.ndarray:
        """Scale inputs to the box of the design; one that does not vary counts for nought."""
        return np.asarray((x - self.domain_.lo) / self._width())

    def _width(self) -> np.ndarray:
        width = self.domain_.hi - self.domain_.lo
        return np.asarray(np.where(width > 0, width, 1.0))

    def _laws(self, marginals: Any) -> list[Law]:
        """Laws as given, one for each input; uniform over the design if None."""
        inputs = self.n_features_in_
        if marginals is None:
            return [
                stats.uniform(lo, width)
                for lo, width in zip(self.domain_.lo, self._width(), strict=True)
            ]
        laws = list(marginals)
        if len(laws) != inputs:
            raise ValueError(
                f"{len(laws)} marginals were given for {inputs} inputs. Give a distribution of "
                "scipy.stats for each, such as uniform(0, 1), or none."
            )
        for d, law in enumerate(laws):
            lo, hi = law.support()
            if self.domain_.lo[d] < lo or self.domain_.hi[d] > hi:
                raise ValueError(
                    f"Input {d} goes from {self.domain_.lo[d]:g} to {self.domain_.hi[d]:g}, "
                    f"beyond its marginal's [{lo:g}, {hi:g}]. Give a law that allows the "
                    "design."
                )
        return laws


def _judge(x: np.ndarray) -> None:
    """Warn of designs that cannot tell their inputs apart."""
    count, inputs = x.shape
    if count < 2 * (inputs + 1):
        warnings.warn(
            f"{count} points in {inputs} inputs: a plane alone has {inputs + 1} coefficients. "
            f"Give {2 * (inputs + 1)} or more, or leave inputs out.",
            FewPointsWarning,
            stacklevel=4,
        )
    width = x.max(axis=0) - x.min(axis=0)
    still = np.flatnonzero(width == 0.0)
    if len(still):
        warnings.warn(
            f"Input {int(still[0])} is {x[0, still[0]]:g} at every point, so nothing is learnt "
            "of it. Vary it, or leave it out.",
            IllConditionedWarning,
            stacklevel=4,
        )
    moving = (x - x.mean(axis=0))[:, width > 0] / width[width > 0]
    values = np.linalg.svd(moving, compute_uv=False)
    if count > inputs and len(values) > 1 and values[-1] < ALIKE * values[0]:
        _, _, directions = np.linalg.svd(moving, full_matrices=False)
        moved = np.flatnonzero(width > 0)
        named = moved[np.abs(directions[-1]) > 0.1].tolist()
        warnings.warn(
            f"Inputs {named} vary together at every point, so what each does cannot be told. "
            "Vary them apart, or leave one out.",
            IllConditionedWarning,
            stacklevel=4,
        )
