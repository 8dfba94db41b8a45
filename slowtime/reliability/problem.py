"""Reliability problems: named random inputs, their dependence, a limit state."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from .random_inputs.copulas import Copula, Kind, nataf
from .random_inputs.marginals import Marginal, as_marginal

LimitState: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Value g at points [sample input]; failure where it is at most 0."""


@dataclasses.dataclass(frozen=True, slots=True)
class Conditional:
    """Distribution of an input given the inputs before it: a Rosenblatt transformation.

    Parameters
    ----------
    law
        From the columns of the earlier inputs [sample input] to a frozen distribution of
        `scipy.stats` whose parameters are arrays [sample].
    """

    law: Callable[[np.ndarray], Any]


@dataclasses.dataclass(frozen=True)
class System:
    r"""Series or parallel system: a limit state made of others.

    A series system fails where one part does, :math:`g = \min g_k`; a parallel system where
    all do, :math:`g = \max g_k`.
    """

    kind: Literal["series", "parallel"]
    parts: Mapping[str, LimitState]

    def __post_init__(self) -> None:
        if self.kind not in ("series", "parallel") or not self.parts:
            raise ValueError(
                f"A system {self.kind!r} of {len(self.parts)} parts is none. Give 'series' or "
                "'parallel', and at least one part by name."
            )

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Value of the system [sample]."""
        values = np.stack([np.asarray(part(x), dtype=float) for part in self.parts.values()])
        return np.asarray(values.min(axis=0) if self.kind == "series" else values.max(axis=0))


@dataclasses.dataclass(frozen=True)
class Problem:
    """What all methods of this room are given.

    Parameters
    ----------
    inputs
        Name → marginal distribution (`marginal`, or a frozen distribution of `scipy.stats`),
        or `Conditional` on the inputs before it.
    limit_state
        Function from points [sample input], in the order of `inputs`, to values [sample];
        failure where a value is at most 0. Or a `System` of such functions.
    dependence
        Names of inputs → their copula; inputs left out are independent. See `correlated`.
    invalid
        What NaN means: ``"error"`` raises, ``"fails"`` counts the point as failed.

    Examples
    --------
    >>> from slowtime.reliability.random_inputs.marginals import marginal
    >>> problem = Problem(
    ...     {"r": marginal("normal", mean=10.0, sd=1.0),
    ...      "s": marginal("normal", mean=5.0, sd=1.0)},
    ...     lambda x: x[:, 0] - x[:, 1])
    >>> problem.physical(np.array([[0.0, 2.0]]))
    array([[10.,  7.]])
    """

    inputs: Mapping[str, Any]
    limit_state: LimitState
    dependence: Mapping[tuple[str, ...], Copula] = dataclasses.field(default_factory=dict)
    invalid: Literal["error", "fails"] = "error"

    def __post_init__(self) -> None:
        if not self.inputs:
            raise ValueError("A problem without inputs has no probability. Give at least one.")
        if self.invalid not in ("error", "fails"):
            raise ValueError(f"invalid={self.invalid!r}. Allowed: 'error', 'fails'.")
        laws = {
            name: law if isinstance(law, Conditional) else as_marginal(law)
            for name, law in self.inputs.items()
        }
        object.__setattr__(self, "inputs", laws)
        seen: set[str] = set()
        for group in self.dependence:
            for name in group:
                if name not in laws or isinstance(laws[name], Conditional) or name in seen:
                    raise ValueError(
                        f"{name!r} cannot be joined by a copula: it is not an input with a "
                        "marginal, or is in a group already. Each input may be in one group "
                        f"at most. Inputs: {', '.join(laws)}."
                    )
                seen.add(name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(self.inputs)

    @property
    def size(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    def scores(self, u: Float[np.ndarray, "sample input"]) -> Float[np.ndarray, "sample input"]:
        """Transform independent normal scores to dependent ones by the copulas.

        Parameters
        ----------
        u
            Independent standard normal scores.

        Returns
        -------
        Dependent standard normal scores.
        """
        z = np.array(u, dtype=float)
        for group, copula in self.dependence.items():
            columns = [self.names.index(name) for name in group]
            z[:, columns] = copula.scores(z[:, columns])
        return z

    def physical(
        self, u: Float[np.ndarray, "sample input"]
    ) -> Float[np.ndarray, "sample input"]:
        """Transform independent standard normal inputs to those in their own units.

        Parameters
        ----------
        u
            Independent standard normal scores.

        Returns
        -------
        Points, each input in its own unit.
        """
        z = self.scores(u)
        x = np.empty_like(z)
        for k, law in enumerate(self.inputs.values()):
            if isinstance(law, Conditional):
                given = law.law(x[:, :k])
                upper = given.isf(ndtr(-z[:, k]))
                x[:, k] = np.where(z[:, k] < 0.0, given.ppf(ndtr(z[:, k])), upper)
            else:
                x[:, k] = law.of_score(z[:, k])
        return x

    def standard(
        self, x: Float[np.ndarray, "sample input"]
    ) -> Float[np.ndarray, "sample input"]:
        """Transform inputs in their own units to independent standard normal ones.

        Parameters
        ----------
        x
            Points, each input in its own unit.

        Returns
        -------
        Independent standard normal scores.
        """
        u = np.empty_like(np.asarray(x, dtype=float))
        for k, law in enumerate(self.inputs.values()):
            known = Marginal(law.law(x[:, :k])) if isinstance(law, Conditional) else law
            u[:, k] = known.score(x[:, k])
        for group, copula in self.dependence.items():
            columns = [self.names.index(name) for name in group]
            u[:, columns] = copula.independent(u[:, columns])
        return u


def correlated(
    inputs: Mapping[str, Any],
    correlations: Mapping[tuple[str, str], float],
    kind: Kind = "linear",
) -> dict[tuple[str, ...], Copula]:
    """Make the dependence of inputs with given correlations of pairs (Nataf).

    Parameters
    ----------
    inputs
        Name → marginal distribution, as in `Problem`.
    correlations
        Two names → their correlation [1]; pairs that are not named have none.
    kind
        Kind of the correlations; see `copulas.nataf`.

    Returns
    -------
    Names of the correlated inputs → their copula.

    Raises
    ------
    ValueError
        Where a correlation names an input that does not exist, or none has that correlation.

    Examples
    --------
    >>> from slowtime.reliability.random_inputs.marginals import marginal
    >>> inputs = {name: marginal("normal", mean=0.0, sd=1.0) for name in "ab"}
    >>> correlated(inputs, {("a", "b"): 0.5})[("a", "b")].correlation.round(6)
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    used = tuple(name for name in inputs if any(name in pair for pair in correlations))
    unknown = {name for pair in correlations for name in pair} - set(used)
    if unknown:
        raise ValueError(f"{sorted(unknown)} are no inputs. Inputs: {', '.join(inputs)}.")
    places = {(used.index(a), used.index(b)): rho for (a, b), rho in correlations.items()}
    return {used: nataf([as_marginal(inputs[name]) for name in used], places, kind)}


def unknowns(count: int) -> dict[str, Marginal]:
    """`count` standard normal inputs: for limit states that are already in normal space."""
    from .random_inputs.marginals import marginal

    return {f"u{k + 1}": marginal("normal", mean=0.0, sd=1.0) for k in range(count)}


class Evaluator:
    """The limit state at points of standard normal space: checked, and its calls counted."""

    def __init__(self, problem: Problem, limit_state: LimitState | None = None) -> None:
        self.problem = problem
        self.calls = 0
        self._limit_state = problem.limit_state if limit_state is None else limit_state

    def __call__(self, u: Float[np.ndarray, "sample input"]) -> Float[np.ndarray, " sample"]:
        """Values [sample]; NaN is refused, or minus infinity where it counts as failed.

        Raises
        ------
        ValueError
            Where the limit state returns another shape, what is no number, or NaN.
        """
        x = self.problem.physical(u)
        try:
            values = np.asarray(self._limit_state(x), dtype=float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"The limit state cannot be evaluated: {error}") from error
        self.calls += len(x)
        if values.shape != (len(x),):
            raise ValueError(
                f"The limit state returned shape {values.shape} for {len(x)} points of "
                f"{x.shape[1]} inputs. Return one value per point, shape ({len(x)},)."
            )
        wrong = np.isnan(values)
        if wrong.any():
            if self.problem.invalid == "error":
                raise ValueError(self._nan_message(x[int(np.argmax(wrong))], int(wrong.sum())))
            values = np.where(wrong, -np.inf, values)
        return values

    def _nan_message(self, x: np.ndarray, count: int) -> str:
        at = ", ".join(f"{n}={v:.6g}" for n, v in zip(self.problem.names, x, strict=True))
        return (
            f"The limit state returned NaN at {count} points, such as {at[:300]}. Repair it, "
            "or state that such points count as failed (invalid='fails')."
        )
