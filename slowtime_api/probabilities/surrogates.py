"""Fast surrogates of slow models, chosen by cross-validation."""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from slowtime.surrogate import PolynomialChaos, choose
from slowtime.surrogate.choice import LEVEL, Choice, defaults
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_services.argument_checks import Vector, checked

Kind = Literal[
    "chaos", "matern", "squared-exponential", "hybrid", "support-vectors", "networks"
]
KINDS: tuple[Kind, ...] = (
    "chaos", "matern", "squared-exponential", "hybrid", "support-vectors", "networks",
)  # fmt: skip
"""Of `slowtime.surrogate.choice.defaults`, in order."""
Points = Float[np.ndarray, " point"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Predictions(Result):
    """Values of a surrogate at points, with their errors.

    Parameters
    ----------
    inputs
        Values of each input.
    value, sd, lo, hi
        Prediction, its standard deviation, and ends of its 95 % band.
    extrapolated
        Whether a point lies outside the range of the runs.
    """

    inputs: dict[str, Points]
    value: Points
    sd: Points
    lo: Points
    hi: Points
    extrapolated: Bool[np.ndarray, " point"]

    @property
    def heading(self) -> str:
        """How many predictions there are, in a line."""
        return f"{len(self.value)} predictions"

    def rows(self) -> list[dict[str, Any]]:
        """Return each point.

        Returns
        -------
        One dictionary per point: the inputs, ``value``, ``sd``, ``lo``, ``hi`` and
        ``extrapolated``.
        """
        columns = self.inputs | {
            name: getattr(self, name) for name in ("value", "sd", "lo", "hi", "extrapolated")
        }
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in rows]


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FittedSurrogate(Result):
    """The surrogate that predicts runs left out best, and how all did.

    Parameters
    ----------
    names
        Names of the inputs.
    choice
        The surrogate, fitted to all runs, and the scores of all candidates.
    sobol
        First-order and total Sobol' index of each input [1]; empty where no polynomial chaos
        can be fitted.
    """

    names: tuple[str, ...]
    choice: Choice
    sobol: dict[str, tuple[float, float]]

    @property
    def heading(self) -> str:
        """The choice and its reason."""
        return self.choice.why

    def rows(self) -> list[dict[str, Any]]:
        """Return each candidate, the best first.

        Returns
        -------
        One dictionary per candidate: ``surrogate``; ``crps`` and ``rmse`` in the unit of the
        output; ``coverage`` of the 95 % band [1]; ``failure``, why it could not be fitted.
        """
        return [
            {
                "surrogate": one.name,
                "crps": one.crps if one.failure is None else None,
                "rmse": one.rmse if one.failure is None else None,
                "coverage": one.coverage if one.failure is None else None,
                "failure": one.failure,
            }
            for one in self.choice.candidates
        ]

    @checked
    def predict(self, inputs: Mapping[str, Vector]) -> Predictions:
        """Predict the output at points.

        Parameters
        ----------
        inputs
            Values of each input by name, all of one length.

        Returns
        -------
        Values with standard deviations and 95 % bands.

        Raises
        ------
        ValueError
            If an input is missing, or lengths differ.
        """
        x = _columns(inputs, self.names)
        fitted = self.choice.surrogate
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mean, sd = fitted.predict(x, return_std=True)
            lo, hi = fitted.predict_interval(x, LEVEL)
        return Predictions(
            inputs=dict(zip(self.names, x.T, strict=True)), value=mean, sd=sd, lo=lo, hi=hi,
            extrapolated=fitted.extrapolates(x),
        )  # fmt: skip

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the Sobol' indices of the inputs.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        at = np.arange(len(self.sobol))
        for shift, label in enumerate(("alone", "in total")):
            shares = [100 * pair[shift] for pair in self.sobol.values()]
            axes.bar(at + 0.4 * shift - 0.2, shares, width=0.38, label=label)
        axes.set_xticks(at, list(self.sobol))
        axes.set(ylabel="share of the variance [%]")
        axes.legend()
        return save(axes, path)


@checked
def fit_surrogate(
    inputs: Mapping[str, Vector],
    output: Vector,
    kinds: Sequence[Kind] | None = None,
    *,
    seed: int = 0,
) -> FittedSurrogate:
    """Fit a fast surrogate to runs of a slow model, chosen by cross-validation.

    Parameters
    ----------
    inputs
        Values of each input by name, one for each run.
    output
        Output of each run.
    kinds
        Surrogates to be compared; all where not given.
    seed
        Of all random numbers.

    Returns
    -------
    The best surrogate with its scores, and the importance of the inputs.

    Raises
    ------
    ValueError
        If lengths differ, or no surrogate can be learnt from the runs.

    References
    ----------
    .. [1] B. Sudret, "Global sensitivity analysis using polynomial chaos expansions",
       Reliability Engineering and System Safety 93 (2008) 964-979.

    Examples
    --------
    >>> x = np.linspace(-1.0, 1.0, 30)
    >>> found = fit_surrogate({"x": x}, x**3 - x, ["chaos"])
    >>> round(float(found.predict({"x": [0.5]}).value[0]), 3)
    -0.375
    """
    names = tuple(inputs)
    if not names:
        raise ValueError("inputs={} was given. Give the values of at least one input.")
    x = _columns(inputs, names)
    if len(x) != len(output):
        raise ValueError(
            f"{len(x)} values of the inputs and {len(output)} of the output were given. Give "
            "one of each for each run."
        )
    wanted = KINDS if kinds is None else kinds
    every = zip(KINDS, defaults().values(), strict=True)
    candidates = {str(name): one for name, one in every if name in wanted}
    with np.errstate(all="ignore"):
        choice = choose(x, output, candidates, random_state=seed)
    return FittedSurrogate(names=names, choice=choice, sobol=_sobol(x, output, names))


def _columns(inputs: Mapping[str, Any], names: Sequence[str]) -> Float[np.ndarray, "run input"]:
    """Return inputs as columns, in the order of their names."""
    missing = [name for name in names if name not in inputs]
    if missing:
        raise ValueError(f"inputs lack {', '.join(missing)}. Give all inputs.")
    if len({len(inputs[name]) for name in names}) > 1:
        told = ", ".join(f"{name}: {len(inputs[name])}" for name in names)
        raise ValueError(f"inputs differ in length ({told}). Give series of one length.")
    return np.column_stack([inputs[name] for name in names])


def _sobol(
    x: np.ndarray, y: np.ndarray, names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Sobol' indices by input: alone and in total, of a polynomial chaos of the runs."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            chaos = PolynomialChaos().fit(x, y)
        except ValueError:
            return {}
    indices = zip(names, chaos.sobol_first_, chaos.sobol_total_, strict=True)
    return {name: (float(first), float(total)) for name, first, total in indices}
