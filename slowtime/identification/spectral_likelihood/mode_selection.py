"""Selection of the modes that a spectrum needs, each at maximum likelihood.

Candidates that are close to each other share a window of the spectrum and one model. A
candidate stays only if leaving it out costs more log-likelihood than its parameters are worth.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from .likelihood import (
    BandFit,
    band_log_likelihood,
    expectation_maximisation,
    fit_band_model,
    fit_forces,
)
from .model import BandModel
from .score_test import AddedModeTest
from .shape_complement import ShapeComplement, shape_complement
from .window_data import WindowData, WindowUnits, prepare_window
from .windows import SpectralWindow, Spectrum, group_close_poles, shared_windows

SELECTING = 12.0
"""Half-width of windows in the selection of modes [half-bandwidths]."""

FITTING = 50.0
"""Half-width of windows in the final fit [half-bandwidths]."""

MOST_BESIDE = 3
"""Largest number of modes beside a window, on either side, whose skirts are modelled."""

WORTH = 1.5
"""Least evidence of a mode [Bayesian penalties]."""

CONTRADICTION = 2.0
"""Difference of estimates in narrow and wide windows that counts [its standard deviations]."""

CLEAR = 3.0
"""Evidence above which a rough refit without the mode is sufficient [Bayesian penalties]."""

PROMISE = 0.5
"""First-order evidence below which a mode is not tried [Bayesian penalties]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FittedMode:
    """One mode at its likeliest.

    Parameters
    ----------
    pole
        s [rad/s].
    covariance
        Of the log decay rate and the angular frequency.
    shape, shape_sd
        In the channels of the spectrum; the shape of unit norm. Of a selection, only in the
        combinations of channels that were fitted.
    evidence
        Log-likelihood that would be lost without the mode, over what it must be worth.
    prominence
        Density of the mode over that of everything else at its peak, where it shows best.
    """

    pole: complex
    covariance: Float[np.ndarray, "2 2"]
    shape: Complex[np.ndarray, " channel"]
    shape_sd: Float[np.ndarray, " channel"]
    evidence: float
    prominence: float
    strength: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class InitialMode:
    """Where a mode is thought to be: pole [rad/s] and shape."""

    pole: complex
    shape: Complex[np.ndarray, " channel"]


def select_modes(
    spectrum: Spectrum, starts: list[InitialMode], *, low_hz: float, high_hz: float
) -> list[tuple[int, FittedMode]]:
    """Select the modes among candidates, in narrow windows."""
    # Windows are narrow here: little else in them can be mistaken for a mode.
    return _in_windows(spectrum, starts, (low_hz, high_hz), _SELECTION)


def fit_modes(
    spectrum: Spectrum,
    starts: list[InitialMode],
    *,
    low_hz: float,
    high_hz: float,
    all_of_them: bool = False,
) -> list[tuple[int, FittedMode]]:
    """Fit selected modes in wide windows, with the skirts of the modes beyond.

    With `all_of_them`, modes stay that the spectrum can do without.
    """
    # Windows are wide here: most is to be learned in them, with the skirts of the modes beyond
    # accounted for. That asks for a list of modes without strangers.
    stage = dataclasses.replace(_FINAL, worth=-np.inf) if all_of_them else _FINAL
    return _in_windows(spectrum, starts, (low_hz, high_hz), stage)


def widen_for_windows(
    spectrum: Spectrum, fitted: list[FittedMode], *, low_hz: float, high_hz: float
) -> list[FittedMode]:
    """Widen the errors of modes that narrow windows contradict.

    References
    ----------
    .. [1] J. A. Hausman, "Specification tests in econometrics", Econometrica 46 (1978).
    """
    starts = [InitialMode(one.pole, one.shape) for one in fitted]
    # The likeliest values in a narrow window differ from those in a wide one by no more than
    # the difference of their variances allows, if the model holds [1]. A larger difference
    # shows a force or a neighbour that is not as modelled; it is added to the variance.
    narrow = dict(_in_windows(spectrum, starts, (low_hz, high_hz), _CONFIRMATION))
    return [
        _contradicted(one, narrow[k]) if k in narrow else one for k, one in enumerate(fitted)
    ]


def _contradicted(wide: FittedMode, narrow: FittedMode) -> FittedMode:
    away = np.array(
        [np.log(narrow.pole.real / wide.pole.real), narrow.pole.imag - wide.pole.imag]
    )
    expected = np.maximum(np.diag(narrow.covariance) - np.diag(wide.covariance), 0.0)
    more = np.where(away**2 > CONTRADICTION**2 * expected, away**2 - expected, 0.0)
    # Below its own error a difference is that of where the search stopped.
    more = np.where(away**2 > np.diag(wide.covariance), more, 0.0)
    return dataclasses.replace(wide, covariance=wide.covariance + np.diag(more))


def _in_windows(
    spectrum: Spectrum,
    starts: list[InitialMode],
    edges: tuple[float, float],
    stage: "_Stage",
) -> list[tuple[int, FittedMode]]:
    least = 0.25 * spectrum.spacing_hz * 2 * np.pi
    order = sorted(range(len(starts)), key=lambda k: starts[k].pole.imag)
    poles = np.array([starts[k].pole for k in order])
    poles = np.minimum(poles.real, -least) + 1j * poles.imag
    found: list[tuple[int, FittedMode]] = []

    def about(group: list[int]) -> SpectralWindow:
        return SpectralWindow.about(spectrum, poles, group, edges, stage.wide, stage.beside)

    for group, window in shared_windows(group_close_poles(poles), about):
        modes = window.modes + window.beside
        shapes = np.stack([starts[order[k]].shape for k in modes], axis=1)
        for k, sharp in _fitted(spectrum, window, poles[modes], shapes, stage):
            if modes[k] in group:
                found.append((order[modes[k]], sharp))
    return sorted(found, key=lambda pair: abs(pair[1].pole))


@dataclasses.dataclass(frozen=True, slots=True)
class _Stage:
    """How windows are fitted: half-width, modes beside, choice of modes, and whole shapes.

    Modes of less evidence than `worth` [Bayesian penalties] are dropped.
    """

    wide: float
    beside: int
    choose: Callable[[WindowData], tuple[list[int], BandFit]]
    whole: bool
    worth: float = WORTH


def _fitted(
    spectrum: Spectrum,
    window: SpectralWindow,
    poles: np.ndarray,
    shapes: np.ndarray,
    stage: _Stage,
) -> list[tuple[int, FittedMode]]:
    """Fit a window, dropping what it can do without; (index into poles, mode) of the rest."""
    frame, case = prepare_window(spectrum, window, poles, shapes)
    data = case.data
    left, best = stage.choose(case)
    while left:
        rests = [_without(case, best, k) for k in range(len(left))]
        losses = [
            best.log_likelihood - band_log_likelihood(data, r.predicted(data)) for r in rests
        ]
        worst = int(np.argmin(losses))
        if losses[worst] >= stage.worth * case.price:
            rest = None
            if stage.whole:
                rest = shape_complement(case.ordinates, frame.directions, data, best.model)
            return [
                (left[k], _sharp(frame, best, k, loss / case.price, rest))
                for k, loss in enumerate(losses)
            ]
        left.pop(worst)
        best = fit_band_model(data, rests[worst])
    return []


def _kept(case: WindowData) -> tuple[list[int], BandFit]:
    """All modes at once, for they have been chosen."""
    everything = list(range(case.modes))
    return everything, fit_band_model(case.data, case.start(everything))


def _selected(case: WindowData) -> tuple[list[int], BandFit]:
    """Add candidates, the one that promises most first, as long as they keep the promise."""
    # Poles stay where the candidates have them until all have been added: free ones would leave
    # for where another mode is still missing.
    left: list[int] = []
    waiting = set(range(case.modes))
    best = fit_forces(case.data, case.start([]))
    reached = band_log_likelihood(case.data, best.predicted(case.data))
    while waiting:
        prospects = AddedModeTest(case.data, best)
        gains = {k: prospects.gain(case.poles[k], case.shapes[:, k]) for k in waiting}
        waiting = {k for k in waiting if gains[k][0] >= PROMISE * case.price}
        if not waiting:
            break
        most = max(waiting, key=lambda k: gains[k][0])
        waiting.remove(most)
        more = best.with_modes(case.poles[[most]], gains[most][1][:, None])
        for start in (expectation_maximisation(case.data, more), more):
            trial = fit_forces(case.data, start)
            likelihood = band_log_likelihood(case.data, trial.predicted(case.data))
            if likelihood - reached >= WORTH * case.price:
                best, reached = trial, likelihood
                left.append(most)
                break
    return left, fit_band_model(case.data, best, roughly=True)


_SELECTION = _Stage(SELECTING, 0, _selected, whole=False)
_FINAL = _Stage(FITTING, MOST_BESIDE, _kept, whole=True)
_CONFIRMATION = _Stage(SELECTING, MOST_BESIDE, _kept, whole=False)


def _without(case: WindowData, whole: BandFit, mode: int) -> BandModel:
    """Model without a mode, refitted as far as it takes to see whether the mode is needed."""
    rest = expectation_maximisation(case.data, whole.model.without(mode))
    loss = whole.log_likelihood - band_log_likelihood(case.data, rest.predicted(case.data))
    return rest if loss > CLEAR * case.price else fit_band_model(case.data, rest).model


def _sharp(
    frame: WindowUnits,
    found: BandFit,
    mode: int,
    evidence: float,
    rest: ShapeComplement | None,
) -> FittedMode:
    model = found.model
    units = np.array([1.0, frame.unit])
    covariance = found.pole_covariance(mode) * units[:, None] * units
    scale, inside = frame.scale[:, None], frame.scale[:, None] * frame.directions
    shape = inside @ model.shape[:, mode]
    moved = inside @ found.shape_covariance(mode) @ inside.conj().T
    if rest is not None:
        outside = scale * rest.outside
        shape = shape + outside @ rest.component[:, mode]
        moved = moved + outside @ rest.covariance[mode] @ outside.conj().T
    size = float(np.linalg.norm(shape))
    shape = shape / size
    across = np.eye(len(shape)) - np.outer(shape, shape.conj())
    variance = np.real(np.diag(across @ moved @ across.conj().T)) / size**2
    return FittedMode(
        frame.back(model.pole[mode]),
        covariance,
        shape,
        np.sqrt(np.maximum(variance, 0.0)),
        evidence,
        model.prominence(mode),
        _strength(model, mode, inside),
    )


def _strength(model: BandModel, mode: int, expand: np.ndarray) -> float:
    part = model.resonances(np.array([model.pole[mode].imag]))[mode, 0]
    return float(np.trace(expand @ part @ expand.conj().T).real)
