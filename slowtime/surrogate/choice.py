"""Choice of a surrogate by leave-one-out prediction."""

import dataclasses
import warnings
from typing import Any

import numpy as np
from scipy import stats

from .interface import Surrogate
from .surrogate_warnings import SurrogateWarning

LEVEL = 0.95


@dataclasses.dataclass(frozen=True, slots=True)
class ScoredSurrogate:
    """How one surrogate foretold the points left out."""

    name: str
    crps: float
    """Continuous ranked probability score of mean and band [unit of y]; less is better."""

    rmse: float
    coverage: float
    """Share of points within the 95 % band."""

    failure: str | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Choice:
    """The surrogate that foretold best, fitted to all points, and how all of them did."""

    surrogate: Surrogate
    name: str
    candidates: tuple[ScoredSurrogate, ...]
    """The best first; those that failed last."""

    why: str


def defaults() -> dict[str, Surrogate]:
    """Surrogates that are compared unless others are given."""
    from .gaussian_processes.gaussian_process import GaussianProcess
    from .gaussian_processes.hybrid_expansion import HybridExpansion
    from .networks import NetworkEnsemble
    from .polynomial_chaos import PolynomialChaos
    from .support_vectors import SupportVectors

    return {
        "polynomial chaos": PolynomialChaos(),
        "Gaussian process, Matérn 5/2": GaussianProcess(),
        "Gaussian process, squared exponential": GaussianProcess("squared exponential"),
        "H-PCFE": HybridExpansion(),
        "support vectors": SupportVectors(),
        "networks": NetworkEnsemble(),
    }


def choose(
    X: Any,
    y: Any,
    candidates: dict[str, Surrogate] | None = None,
    *,
    folds: int = 5,
    random_state: int = 0,
) -> Choice:
    """Compare surrogates by cross-validation and fit the best to all points.

    The score is the continuous ranked probability score, which counts an error as it is and a
    band that is too wide or too narrow as well.

    Parameters
    ----------
    X
        Points [sample, input].
    y
        Outputs [sample].
    candidates
        By name; six of different kinds if None.
    folds
        Parts of the design, each left out once, the same for all.
    random_state
        Seed of the parts.

    Returns
    -------
    The best surrogate, fitted, and the scores of all.

    Examples
    --------
    >>> from slowtime.surrogate import GaussianProcess, PolynomialChaos
    >>> x = np.random.default_rng(0).uniform(size=(40, 2))
    >>> chosen = choose(x, x[:, 0] ** 2 - x[:, 1], {
    ...     "process": GaussianProcess(folds=1), "chaos": PolynomialChaos()})
    >>> chosen.name
    'chaos'
    """
    from sklearn.base import clone
    from sklearn.model_selection import KFold
    from sklearn.utils.validation import check_X_y

    x, outputs = check_X_y(X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=folds)
    named = defaults() if candidates is None else candidates
    if not named:
        raise ValueError("There is nothing to choose from. Give candidates by name, or none.")
    splits = list(KFold(folds, shuffle=True, random_state=random_state).split(x))
    tried: list[tuple[ScoredSurrogate, np.ndarray]] = []
    for name, surrogate in named.items():
        tried.append(_try(name, clone(surrogate), x, np.asarray(outputs, float), splits))
    tried.sort(key=lambda one: (one[0].failure is not None, one[0].crps))
    best = tried[0][0]
    if best.failure is not None:
        reasons = "; ".join(f"{one.name}: {one.failure}" for one, _ in tried)
        raise ValueError(f"No candidate could be fitted. {reasons}")
    fitted = clone(named[best.name]).fit(X, y)
    return Choice(
        surrogate=fitted,
        name=best.name,
        candidates=tuple(one for one, _ in tried),
        why=_why(tried, float(np.std(outputs))),
    )


def _try(
    name: str,
    surrogate: Surrogate,
    x: np.ndarray,
    y: np.ndarray,
    splits: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[ScoredSurrogate, np.ndarray]:
    mean, sd = np.empty(len(y)), np.empty(len(y))
    inside = np.empty(len(y), dtype=bool)
    try:
        with warnings.catch_warnings():
            # Points left out lie at the edge of those kept; the whole design is what counts.
            warnings.simplefilter("ignore", SurrogateWarning)
            for seen, rest in splits:
                fitted = surrogate.fit(x[seen], y[seen])
                mean[rest], sd[rest] = fitted.predict(x[rest], return_std=True)
                lo, hi = fitted.predict_interval(x[rest], LEVEL)
                inside[rest] = (lo <= y[rest]) & (y[rest] <= hi)
    except (ValueError, np.linalg.LinAlgError) as error:
        nothing = np.full(len(y), np.nan)
        return ScoredSurrogate(name, np.inf, np.inf, np.nan, failure=str(error)), nothing
    score = _crps(mean, sd, y)
    rmse = float(np.sqrt(np.mean((mean - y) ** 2)))
    return ScoredSurrogate(name, float(score.mean()), rmse, float(inside.mean())), score


def _crps(mean: np.ndarray, sd: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Score of a Gaussian forecast (Gneiting and Raftery 2007)."""
    sd = np.maximum(sd, 1e-300)
    z = (y - mean) / sd
    inner = z * (2.0 * stats.norm.cdf(z) - 1.0) + 2.0 * stats.norm.pdf(z) - 1.0 / np.sqrt(np.pi)
    return np.asarray(sd * inner)


def _why(tried: list[tuple[ScoredSurrogate, np.ndarray]], spread: float) -> str:
    best, own = tried[0]
    text = [
        f"{best.name} foretells points left out best: its error is "
        f"{100 * best.rmse / spread:.2g} % of the output's spread, and its 95 % band held "
        f"{100 * best.coverage:.0f} % of them."
    ]
    others = [(one, score) for one, score in tried[1:] if one.failure is None]
    if others:
        second, score = others[0]
        more = score - own
        chance = float(more.std(ddof=1) / np.sqrt(len(more)))
        if more.mean() < 2.0 * chance:
            text.append(f"{second.name} is no worse than chance allows.")
        else:
            text.append(
                f"{second.name} comes next, with {second.crps / best.crps:.2g} times the score."
            )
    if not 0.85 <= best.coverage:
        text.append("Its band is too narrow; do not rely on it.")
    if best.rmse > 0.5 * spread:
        text.append("Even so it explains little: more points are needed, or other inputs.")
    text += [f"{one.name} failed: {one.failure}" for one, _ in tried if one.failure is not None]
    return " ".join(text)
