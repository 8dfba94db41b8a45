"""Modes of an epoch as the model at learning would have them, changed as they were measured."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from slowtime.evolution.structures import MeasuredModes, ParametricStructure
from twin_server.estimate.covariates import Removed
from twin_server.estimate.elements.memory import Baseline, ElementMemory
from twin_server.registration.structure import ElementModel

from .baseline_learning import common_patterns
from .mode_matching import aligned
from .observed_modes import ObservedMode


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Nominal:
    """The structure at learning, and the modes that the model gives it."""

    model: ElementModel
    structure: ParametricStructure
    baselines: tuple[Baseline, ...]
    frequency_hz: Float[np.ndarray, " baseline"]
    shapes: Float[np.ndarray, "baseline channel"]
    shape_error: Float[np.ndarray, " baseline"]

    @classmethod
    def of(cls, memory: ElementMemory, model: ElementModel) -> "Nominal":
        """Move the model to where the structure was while it was learnt."""
        structure = model.at(memory.theta)
        modes = structure.modes(np.zeros(len(structure.names)))
        which = [one.mode for one in memory.baselines]
        shapes = (model.rows @ modes.shape[:, which]).T
        frequency_hz = modes.frequency_hz[which]
        learnt_hz = np.array([one.frequency_hz for one in memory.baselines])
        error = shape_error(learnt_hz, frequency_hz)
        return cls(model, structure, memory.baselines, frequency_hz, shapes, error)


def shape_error(
    learnt_hz: Float[np.ndarray, " mode"], model_hz: Float[np.ndarray, " mode"]
) -> np.ndarray:
    """Error of the changes of shapes that a model gives, over these changes [1].

    Modes turn towards each other by what couples them over the difference of their
    eigenvalues (first order), so that the turn is as wrong as this difference, at most wholly.
    """
    error = np.log(learnt_hz / model_hz)
    apart = np.abs(np.log(model_hz / model_hz[:, None]))
    np.fill_diagonal(apart, np.inf)
    wrong = np.abs(error - error[:, None]) / np.maximum(apart, 1e-12)
    return np.asarray(np.minimum(wrong.max(axis=1), 1.0))


def freed(mode: ObservedMode, i: int, removed: Sequence[Removed]) -> tuple[float, float]:
    """Frequency at the reference of the covariates, and the relative sd that this adds."""
    if not removed:
        return mode.frequency_hz, 0.0
    one = removed[i]
    return one.factor * mode.frequency_hz, math.hypot(one.own_sd, one.law_sd)


class ComparedMode(NamedTuple):
    """A mode of the present beside what was learnt of it.

    Parameters
    ----------
    place
        Which baseline it is.
    ratio
        Frequency, freed of covariates, over the learnt one [1].
    relative_sd
        Standard deviation of that ratio [1].
    mode
        Its shape.
    """

    place: int
    ratio: float
    relative_sd: float
    mode: ObservedMode


def measured_now(
    matched: Sequence[tuple[Baseline, int, ObservedMode]],
    nominal: Nominal,
    removed: Sequence[Removed],
) -> MeasuredModes:
    """Modes of one epoch as the model at learning would have them."""
    compared = []
    for baseline, i, mode in matched:
        frequency, added = freed(mode, i, removed)
        own = baseline.scatter * mode.relative_sd
        sd = math.hypot(own, added if removed else baseline.relative_sd)
        compared.append(ComparedMode(i, frequency / baseline.frequency_hz, sd, mode))
    return compared_modes(compared, nominal)


def compared_modes(compared: Sequence[ComparedMode], nominal: Nominal) -> MeasuredModes:
    """Move the modes of the model by what has changed since learning.

    Parameters
    ----------
    compared
        Modes of the present, at least one.
    nominal
        The structure at learning.

    Returns
    -------
    Measured modes; their standard deviations hold the errors of what was learnt.
    """
    frequency, relative, shapes, shape_sds, moves = [], [], [], [], []
    for one in compared:
        frequency.append(one.ratio * float(nominal.frequency_hz[one.place]))
        relative.append(one.relative_sd)
        baseline, i = nominal.baselines[one.place], one.place
        shape, shape_sd, move = _shape(baseline, one.mode, nominal.shapes[i])
        shapes.append(shape)
        shape_sds.append(shape_sd)
        moves.append(nominal.shape_error[i] * move)
    values, any_shape = np.array(frequency), bool(np.isfinite(shapes).any())
    known = [nominal.baselines[one.place] for one in compared]
    return MeasuredModes(
        frequency_hz=values,
        frequency_sd_hz=values * np.array(relative),
        shapes=np.array(shapes) if any_shape else None,
        shape_sd=np.array(shape_sds) if any_shape else None,
        channels=nominal.model.rows if any_shape else None,
        shape_common=_common(known, np.array(shape_sds), np.array(moves))
        if any_shape
        else None,
    )


def _common(
    baselines: Sequence[Baseline],
    shape_sd: Float[np.ndarray, "mode channel"],
    moves: Float[np.ndarray, "mode channel"],
) -> Float[np.ndarray, "mode pattern channel"]:
    """Patterns in which the channels of each shape err together, in the unit of the shape.

    Those of what was learnt, and the error of the model in the change of each shape.
    """
    learnt = common_patterns(baselines, shape_sd)
    own = np.nan_to_num(moves)[:, None]
    return own if learnt is None else np.concatenate([learnt, own], axis=1)


def _shape(
    baseline: Baseline, mode: ObservedMode, model: Float[np.ndarray, " channel"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape of the model plus its change since learning; NaN where not measured.

    Returns
    -------
    Shape, its standard deviation, and the change, by channel [channel].
    """
    nothing = np.full(len(model), np.nan)
    if mode.shape is None or mode.shape_sd is None or baseline.shape is None:
        return nothing, nothing, nothing
    learnt, learnt_sd = np.array(baseline.shape), np.array(baseline.shape_sd)
    now, factor = aligned(mode.shape, learnt)
    own, _ = aligned(model, learnt)
    sd = np.hypot(baseline.shape_scatter * factor * mode.shape_sd, learnt_sd)
    shape = own + now - learnt
    known = np.isfinite(shape) & np.isfinite(sd)
    if known.sum() < 2:
        return nothing, nothing, nothing
    shape, sd, move = (np.where(known, one, np.nan) for one in (shape, sd, now - learnt))
    return shape, sd, move
