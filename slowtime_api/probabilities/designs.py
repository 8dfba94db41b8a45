"""Designs that are cheap, robust and safe."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from slowtime.design import Design, Effort, optimise, optimise_emulated
from slowtime_api.arguments import existing_file
from slowtime_api.models import Model
from slowtime_api.results import Result
from slowtime_api.signals import read
from slowtime_services.argument_checks import Bounds, Share, checked
from slowtime_services.files import ALL
from slowtime_services.problem_files.design import DesignTask, read_design

ReadSamples = Callable[[Path, str | None, float | None], tuple[np.ndarray, float]]
"""Path, channel and rate [Hz] of the record of a load → its samples and rate [Hz]."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalDesigns(Result):
    """The best design for each weight of the mean, and the starting one.

    Parameters
    ----------
    task
        Variables, random inputs, objective and constraints.
    designs
        One per weight: variables, objective, and probabilities of failure with intervals, at
        the start and at the optimum; bounds that are active, and warnings.
    """

    task: DesignTask
    designs: tuple[Design, ...]

    def __len__(self) -> int:
        return len(self.designs)

    @property
    def heading(self) -> str:
        """What was optimised, in a line."""
        return f"{len(self)} designs of {self.task.name or 'a structure'}"

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against trusting a design, in sentences."""
        return tuple(said for one in self.designs for said in one.warnings)

    def rows(self) -> list[dict[str, Any]]:
        """Return each design.

        Returns
        -------
        One dictionary per weight: ``alpha`` [1], the variables, ``mean`` and ``sd`` of the
        objective, and ``worst``, the largest probability of failure over the accepted one [1].
        """
        return [
            {
                "alpha": one.alpha,
                **dict(zip(one.names, one.best.variables.tolist(), strict=True)),
                "mean": one.best.mean,
                "sd": one.best.sd,
                "worst": max(
                    (
                        each.found.probability / each.accepted
                        for each in one.best.constraints.values()
                    ),
                    default=0.0,
                ),
            }
            for one in self.designs
        ]

    def model(self) -> Model:
        """Return the model with the first design built in.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If the design file has no model.
        """
        if self.task.structure is None:
            raise ValueError("The design file has no model. Its variables are in `designs`.")
        return Model(self.task.structure.described(self.designs[0].best.variables))


@checked
def optimise_design(
    path: str | Path,
    *,
    alphas: Sequence[Share] = (),
    variation: Annotated[float, Bounds(above=0, below=1)] = 0.02,
    seed: int = 0,
    progress: Callable[[str], Any] | None = None,
) -> OptimalDesigns:
    """Choose a damper, mass or stiffness: cheap, robust and safe.

    Parameters
    ----------
    path
        Design file (YAML or JSON): variables, random inputs, objective, limit states and, where
        there is one, a model and the record of its load.
    alphas
        Weights of the mean of the objective against its standard deviation [1], one
        optimisation for each; that of the file where none is given.
    variation
        Coefficient of variation to which probabilities are verified [1].
    seed
        Of all random numbers.
    progress
        Called with what is done, in words.

    Returns
    -------
    The best design for each weight, verified.

    Raises
    ------
    ValueError
        If the file, its model or its load cannot be used.

    References
    ----------
    .. [1] I. Doltsinis and Z. Kang, "Robust design of structures using optimization methods",
       Computer Methods in Applied Mechanics and Engineering 193 (2004) 2221-2237.
    """
    return optimise_file(
        existing_file(path), _samples, alphas=alphas, variation=variation, seed=seed,
        say=progress or (lambda _: None),
    )  # fmt: skip


def optimise_file(
    path: Path,
    read_samples: ReadSamples,
    *,
    alphas: Sequence[float],
    variation: float,
    seed: int,
    say: Callable[[str], Any],
) -> OptimalDesigns:
    """Optimise the design of a file as `optimise_design` does, with a reader of loads."""
    task = read_design(path, read_samples)
    effort = Effort(variation=variation)
    tasks = [task.with_alpha(alpha) for alpha in alphas] or [task]
    found = tuple(_optimised(one, effort, seed, say) for one in tasks)
    return OptimalDesigns(task=task, designs=found)


def _optimised(
    task: DesignTask, effort: Effort, seed: int, say: Callable[[str], Any]
) -> Design:
    if task.runs is None:
        return optimise(task.problem(), seed=seed, effort=effort, say=say)
    assert task.responses is not None
    return optimise_emulated(
        task.problem, task.responses, task.runs, seed=seed, effort=effort, say=say
    )


def _samples(
    path: Path, channel: str | None, rate_hz: float | None
) -> tuple[np.ndarray, float]:
    """Read the record of a load."""
    signals = read(path, rate_hz=rate_hz, keep=(ALL,))
    return load_samples(signals.record, path.name, channel), signals.rate_hz


def load_samples(record: Any, name: str, channel: str | None) -> np.ndarray:
    """Return the samples of a load from its record.

    Raises
    ------
    ValueError
        If samples are missing, or the channel is not clear.
    """
    if record.gaps:
        raise ValueError(f"{name} lacks samples. Cut it at its gaps.")
    names = record.channels
    if channel is None and len(names) > 1:
        raise ValueError(f"{name} has {', '.join(names)}. Name one as `channel`.")
    if channel is not None and channel not in names:
        raise ValueError(f"{name} has no {channel}, but: {', '.join(names)}.")
    column = 0 if channel is None else names.index(channel)
    return np.asarray(record.samples[:, column], dtype=float)
