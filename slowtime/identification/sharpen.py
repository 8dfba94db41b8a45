"""Spectrum and candidate poles in; the modes that the spectrum needs, at their likeliest, out.

Candidates that are close to each other share a window of the spectrum and one model. A
candidate stays only if leaving it out costs more log-likelihood than its parameters are worth.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from .band_likelihood import (
    ROUGHLY,
    BandData,
    BandFit,
    BandModel,
    Prospects,
    fit,
    forced,
    log_likelihood,
    restarted,
    started,
)

SELECTING = 12.0
SHARPENING = 50.0
"""A window reaches so many half-bandwidths either way, while modes are chosen and then
fitted ..."""

WIDEST = 0.5
"""... but not over more than this share of the frequency ..."""

FEWEST_BINS = 40
"""... and never less than so many ordinates."""

MOST_BESIDE = 3
"""Modes beyond the window that send their skirts into it, on either side."""

CLOSE = 6.0
"""Modes within so many half-bandwidths of each other are fitted together."""

MOST_TOGETHER = 8
"""Modes in one window."""

JOINT = 1.1
"""Groups share a window where it is no wider than their widest one by more than this."""

SPARE = 1
MOST_DIRECTIONS = 5
"""Combinations of channels that are kept: so many more than modes, and so many at most."""

QUIET = 1e-3
"""Noise taken for granted, as a share of the median density: no record is without."""

GROUPED = 0.2
"""Ordinates are averaged over this share of the distance to the nearest pole."""

WORTH = 1.5
"""Of the Bayesian penalty, below which a candidate is not needed."""

CLEAR = 3.0
"""... and above which a rough refit without it settles the matter."""

PROMISE = 0.5
"""... and below which, to first order, it is not even tried."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Fourier coefficients of channels of like power; |coefficient|² is a density.

    `spared` marks ordinates that are not to be used, such as those of a line taken out.
    """

    coefficients: Complex[np.ndarray, "frequency channel"]
    spacing_hz: float
    spared: np.ndarray


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Sharp:
    """One mode at its likeliest.

    Parameters
    ----------
    pole
        s [rad/s].
    covariance
        Of the log decay rate and the angular frequency.
    shape, shape_sd
        In the channels of the spectrum; the shape of unit norm.
    evidence
        Log-likelihood that would be lost without the mode, over what it must be worth.
    prominence
        Density of the mode over that of everything else at its peak, where it shows best.
    strength
        Density at the peak, all channels of the spectrum together.
    """

    pole: complex
    covariance: Float[np.ndarray, "2 2"]
    shape: Complex[np.ndarray, " channel"]
    shape_sd: Float[np.ndarray, " channel"]
    evidence: float
    prominence: float
    strength: float

    @property
    def half_bandwidth_hz(self) -> float:
        """Decay rate over 2 pi [Hz]."""
        return -self.pole.real / (2 * np.pi)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where a mode is thought to be: pole [rad/s] and shape."""

    pole: complex
    shape: Complex[np.ndarray, " channel"]


def select(
    spectrum: Spectrum, starts: list[Start], *, low_hz: float, high_hz: float
) -> list[tuple[int, Sharp]]:
    """Modes among the candidates, each with the index of its start.

    Windows are narrow here: little else in them can be mistaken for a mode.
    """
    return _in_windows(spectrum, starts, (low_hz, high_hz), SELECTING, 0, _selected)


def sharpen(
    spectrum: Spectrum, starts: list[Start], *, low_hz: float, high_hz: float
) -> list[tuple[int, Sharp]]:
    """Modes at their likeliest, each with the index of its start.

    Windows are wide here: most is to be learned in them, with the skirts of the modes beyond
    accounted for. That asks for a list of modes without strangers.
    """
    return _in_windows(spectrum, starts, (low_hz, high_hz), SHARPENING, MOST_BESIDE, _kept)


def _in_windows(
    spectrum: Spectrum,
    starts: list[Start],
    edges: tuple[float, float],
    wide: float,
    beside: int,
    choose: "_Choice",
) -> list[tuple[int, Sharp]]:
    least = 0.25 * spectrum.spacing_hz * 2 * np.pi
    order = sorted(range(len(starts)), key=lambda k: starts[k].pole.imag)
    poles = np.array([starts[k].pole for k in order])
    poles = np.minimum(poles.real, -least) + 1j * poles.imag
    found: list[tuple[int, Sharp]] = []

    def about(group: list[int]) -> _Window:
        return _Window.about(spectrum, poles, group, edges, wide, beside)

    for group, window in _shared(_groups(poles), about):
        modes = window.modes + window.beside
        shapes = np.stack([starts[order[k]].shape for k in modes], axis=1)
        for k, sharp in _fitted(spectrum, window, poles[modes], shapes, choose):
            if modes[k] in group:
                found.append((order[modes[k]], sharp))
    return sorted(found, key=lambda pair: abs(pair[1].pole))


def _groups(poles: np.ndarray) -> list[list[int]]:
    """Neighbours that are close, split at the widest gaps where they are too many."""
    groups: list[list[int]] = []
    for k in range(len(poles)):
        if groups:
            gap = poles[k].imag - poles[k - 1].imag
            if gap < -CLOSE * (poles[k].real + poles[k - 1].real) / 2:
                groups[-1].append(k)
                continue
        groups.append([k])
    return [part for group in groups for part in _split(group, poles)]


def _shared(
    groups: list[list[int]], about: Callable[[list[int]], "_Window"]
) -> list[tuple[list[int], "_Window"]]:
    """Windows of the groups, one for neighbours whose windows are nearly the same."""
    shared: list[tuple[list[int], _Window]] = []
    for group in groups:
        window = about(group)
        if shared:
            both = about(shared[-1][0] + group)
            parts = (shared[-1][1], window)
            needed = {mode for part in parts for mode in part.modes}
            widest = max(part.last - part.first for part in parts)
            if both.last - both.first <= JOINT * widest and needed <= set(both.modes):
                shared[-1] = (shared[-1][0] + group, both)
                continue
        shared.append((group, window))
    return shared


def _split(group: list[int], poles: np.ndarray) -> list[list[int]]:
    if len(group) <= MOST_TOGETHER // 2 + 1:
        return [group]
    at = 1 + int(np.argmax(np.diff(poles[group].imag)))
    return _split(group[:at], poles) + _split(group[at:], poles)


@dataclasses.dataclass(frozen=True, slots=True)
class _Window:
    """Ordinates from `first` to `last`, the modes in them, and modes beside them."""

    first: int
    last: int
    modes: list[int]
    beside: list[int]

    @staticmethod
    def about(
        spectrum: Spectrum,
        poles: np.ndarray,
        group: list[int],
        edges: tuple[float, float],
        wide: float,
        beside: int,
    ) -> "_Window":
        frequency, half = poles.imag / (2 * np.pi), -poles.real / (2 * np.pi)
        below = min(frequency[k] - wide * half[k] for k in group)
        above = max(frequency[k] + wide * half[k] for k in group)
        lowest, highest = frequency[group[0]], frequency[group[-1]]
        least = FEWEST_BINS * spectrum.spacing_hz
        below = min(max(below, lowest * (1 - WIDEST)), lowest - least)
        above = max(min(above, highest * (1 + WIDEST)), highest + least)
        modes = list(group)
        others = [k for k in range(len(poles)) if k not in group]
        for k in sorted(others, key=lambda k: min(abs(frequency[k] - frequency[group]))):
            if not below < frequency[k] < above:
                continue
            if len(modes) < MOST_TOGETHER:
                modes.append(k)
            elif frequency[k] < lowest:
                below = 0.5 * (frequency[k] + min(frequency[m] for m in modes))
            else:
                above = 0.5 * (frequency[k] + max(frequency[m] for m in modes))
        lower = [k for k in range(min(modes)) if frequency[k] <= below]
        upper = [k for k in range(max(modes) + 1, len(poles)) if frequency[k] >= above]
        around = lower[len(lower) - min(beside, len(lower)) :] + upper[:beside]
        below, above = max(below, edges[0] / 2), min(above, edges[1])
        first = max(2, int(np.ceil(below / spectrum.spacing_hz)))
        last = min(len(spectrum.coefficients) - 2, int(above / spectrum.spacing_hz))
        return _Window(first, last, sorted(modes), around)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """Unit of frequency, middle, scale of the channels and directions kept of them."""

    unit: float
    middle: float
    scale: np.ndarray
    directions: np.ndarray

    def pole(self, pole: np.ndarray) -> np.ndarray:
        return np.asarray((pole - 1j * self.middle) / self.unit)

    def back(self, pole: complex) -> complex:
        return complex(pole * self.unit + 1j * self.middle)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """One window made ready: data, and where poles and shapes are thought to be."""

    data: BandData
    poles: np.ndarray
    shapes: np.ndarray
    held: int

    @property
    def price(self) -> float:
        """Half the Bayesian penalty per parameter times the parameters of one mode."""
        directions = self.data.density.shape[1]
        return float(2.0 * directions * np.log(self.data.number.sum()))

    @property
    def modes(self) -> int:
        """How many are in the window."""
        return len(self.poles) - self.held

    def start(self, which: list[int]) -> BandModel:
        """Model of some of the modes and of all that are beside."""
        all_of = [*which, *range(self.modes, len(self.poles))]
        return started(self.data, self.poles[all_of], self.shapes[:, all_of], self.held)


_Choice = Callable[[_Case], tuple[list[int], BandFit]]


def _fitted(
    spectrum: Spectrum,
    window: _Window,
    poles: np.ndarray,
    shapes: np.ndarray,
    choose: _Choice,
) -> list[tuple[int, Sharp]]:
    """Fit a window, dropping what it can do without; (index into poles, mode) of the rest."""
    index = np.arange(window.first, window.last + 1)
    index = index[~spectrum.spared[index]]
    coefficients = spectrum.coefficients[index]
    omega = 2 * np.pi * spectrum.spacing_hz * index
    frame = _frame(coefficients, omega, poles, shapes, len(window.modes))
    projected = (coefficients / frame.scale) @ frame.directions.conj()
    guess = frame.pole(poles)
    data = _grouped(projected, (omega - frame.middle) / frame.unit, guess)
    seconds = 1.0 / spectrum.spacing_hz
    turn = complex(np.exp(1j * frame.middle * seconds))
    data = dataclasses.replace(data, length=frame.unit * seconds, turn=turn)
    start = frame.directions.conj().T @ (shapes / frame.scale[:, None])
    start = start / np.maximum(np.linalg.norm(start, axis=0), 1e-9)
    case = _Case(data, guess, start, len(window.beside))
    left, best = choose(case)
    while left:
        rests = [_without(case, best, k) for k in range(len(left))]
        losses = [
            best.log_likelihood - log_likelihood(data, r.density(data.omega)) for r in rests
        ]
        worst = int(np.argmin(losses))
        if losses[worst] >= WORTH * case.price:
            return [
                (left[k], _sharp(frame, best, k, loss / case.price))
                for k, loss in enumerate(losses)
            ]
        left.pop(worst)
        best = fit(data, rests[worst])
    return []


def _kept(case: _Case) -> tuple[list[int], BandFit]:
    """All modes at once, for they have been chosen."""
    everything = list(range(case.modes))
    return everything, fit(case.data, case.start(everything))


def _selected(case: _Case) -> tuple[list[int], BandFit]:
    """Add candidates, the one that promises most first, as long as they keep the promise.

    Poles stay where the candidates have them until all have been added: free ones would leave
    for where another mode is still missing.
    """
    left: list[int] = []
    waiting = set(range(case.modes))
    best = forced(case.data, case.start([]))
    reached = log_likelihood(case.data, best.density(case.data.omega))
    while waiting:
        prospects = Prospects(case.data, best)
        gains = {k: prospects.gain(case.poles[k], case.shapes[:, k]) for k in waiting}
        waiting = {k for k in waiting if gains[k][0] >= PROMISE * case.price}
        if not waiting:
            break
        most = max(waiting, key=lambda k: gains[k][0])
        waiting.remove(most)
        more = best.with_modes(case.poles[[most]], gains[most][1][:, None])
        for start in (restarted(case.data, more), more):
            trial = forced(case.data, start)
            likelihood = log_likelihood(case.data, trial.density(case.data.omega))
            if likelihood - reached >= WORTH * case.price:
                best, reached = trial, likelihood
                left.append(most)
                break
    return left, fit(case.data, best, enough=ROUGHLY)


def _without(case: _Case, whole: BandFit, mode: int) -> BandModel:
    """Model without a mode, refitted as far as it takes to see whether the mode is needed."""
    rest = restarted(case.data, whole.model.without(mode))
    loss = whole.log_likelihood - log_likelihood(case.data, rest.density(case.data.omega))
    return rest if loss > CLEAR * case.price else fit(case.data, rest).model


def _frame(
    coefficients: np.ndarray,
    omega: np.ndarray,
    poles: np.ndarray,
    shapes: np.ndarray,
    modes: int,
) -> _Frame:
    """Directions of the candidate shapes first, then of the strongest rest."""
    scale = np.sqrt(np.mean(np.abs(coefficients) ** 2, axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = coefficients / scale
    number = min(len(scale), modes + SPARE, MOST_DIRECTIONS)
    seen = shapes[:, :modes] / scale[:, None]
    basis, strength, _ = np.linalg.svd(seen / np.linalg.norm(seen, axis=0))
    basis = basis[:, : min(number, int(np.count_nonzero(strength > 0.05 * strength[0])))]
    seen = scaled @ basis.conj()
    rest = scaled - seen @ basis.T
    more = np.linalg.svd(rest.T, full_matrices=False)[0][:, : number - basis.shape[1]]
    # Channels that say the same, but for rounding, have directions in which nothing is left.
    parts = np.concatenate([seen, rest @ more.conj()], axis=1)
    power = np.median(np.abs(parts) ** 2, axis=0)
    directions = np.concatenate([basis, more], axis=1)[:, power >= QUIET * power.max()]
    unit = float(-poles[:modes].real.max())
    middle = float(np.median(poles[:modes].imag))
    return _Frame(unit, middle, scale, directions)


def _grouped(projected: np.ndarray, omega: np.ndarray, poles: np.ndarray) -> BandData:
    """Average neighbouring ordinates where the density hardly changes between them."""
    square = (omega[:, None] - poles.imag) ** 2 + poles.real**2
    nearest = square.argmin(axis=1)
    square = square[np.arange(len(omega)), nearest]
    spacing = float(omega[1] - omega[0])
    size = np.maximum(GROUPED * np.sqrt(square) / spacing, 1.0)
    group = np.floor(np.cumsum(1.0 / size)).astype(int)
    _, starts = np.unique(group, return_index=True)
    number = np.diff([*starts, len(omega)]).astype(float)
    outer = projected[:, :, None] * projected[:, None, :].conj()
    density = np.add.reduceat(outer, starts, axis=0) / number[:, None, None]
    power = np.trace(density, axis1=1, axis2=2).real / density.shape[1]
    density = density + QUIET * np.median(power) * np.eye(density.shape[1])
    middle = np.add.reduceat(omega, starts) / number
    # Where the nearest resonance has its mean over the group, which curves towards it.
    own = poles[nearest[starts]]
    mean = np.add.reduceat(1.0 / square, starts) / number
    reach = np.sqrt(np.maximum(1.0 / mean - own.real**2, 0.0))
    there = own.imag + np.copysign(reach, middle - own.imag)
    return BandData(np.where(number > 1, there, middle), density, number)


def _sharp(frame: _Frame, found: BandFit, mode: int, evidence: float) -> Sharp:
    model = found.model
    units = np.array([1.0, frame.unit])
    covariance = found.pole_covariance(mode) * units[:, None] * units
    expand = frame.scale[:, None] * frame.directions
    shape = expand @ model.shape[:, mode]
    size = float(np.linalg.norm(shape))
    moved = expand @ found.shape_covariance(mode) @ expand.conj().T / size**2
    shape = shape / size
    across = np.eye(len(shape)) - np.outer(shape, shape.conj())
    variance = np.real(np.diag(across @ moved @ across.conj().T))
    return Sharp(
        frame.back(model.pole[mode]),
        covariance,
        shape,
        np.sqrt(np.maximum(variance, 0.0)),
        evidence,
        _prominence(model, mode),
        _strength(model, mode, expand),
    )


def _strength(model: BandModel, mode: int, expand: np.ndarray) -> float:
    part = model.resonances(np.array([model.pole[mode].imag]))[mode, 0]
    return float(np.trace(expand @ part @ expand.conj().T).real)


def _prominence(model: BandModel, mode: int) -> float:
    """Largest ratio, over directions, of the mode to everything else at its peak."""
    at = np.array([model.pole[mode].imag])
    parts = model.resonances(at)[:, 0]
    rest = parts.sum(axis=0) - parts[mode] + model.background(at)[0]
    own = (parts[mode] + parts[mode].conj().T) / 2
    power, directions = np.linalg.eigh((rest + rest.conj().T) / 2)
    least = max(1e-9 * float(np.linalg.norm(own)), np.finfo(float).tiny)
    root = directions / np.sqrt(np.maximum(power, least))
    return float(np.linalg.eigvalsh(root.conj().T @ own @ root)[-1])
