"""Maximum-likelihood modes of a band from its spectral matrices.

Candidates that are close share a window of the band and one model. One stays only if leaving it
out costs more log-likelihood than its parameters are worth.
"""

import dataclasses

import numpy as np

from slowtime.identification.automatic.estimation import (
    ALIKE,
    CLEAR_PEAK,
    FLANKS,
    MOST_DAMPING,
    MOST_DOUBT,
    MOVED,
    PEAK,
)
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import mac, normalised
from slowtime.identification.modes import Mode
from slowtime.identification.spectral_likelihood.likelihood import (
    BandFit,
    band_log_likelihood,
    fit_band_model,
    initial_model,
)
from slowtime.identification.spectral_likelihood.mode_selection import (
    CLEAR,
    FITTING,
    SELECTING,
    WORTH,
)
from slowtime.identification.spectral_likelihood.model import BandModel
from slowtime.identification.spectral_likelihood.windows import WIDEST
from slowtime.identification.subspace.stabilisation import StablePole

from .channel_shapes import ShapeWithErrors, expand_to_channels
from .window_data import (
    FadingSpectra,
    FadingWindow,
    StartMode,
    group_start_modes,
    prepare_fading_window,
)

CLOSE = 12.0
"""Distance below which candidates share a window [half-bandwidths]."""

SHOWN = 4.0
"""Range about a mode in which the misfit of the model is tested [half-bandwidths]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Sharp:
    """One mode at its likeliest.

    `covariance` is that of decay rate and angular frequency, `shape` is in directions, and
    `channels` is what the channels show, with standard deviations.
    """

    start: StartMode
    pole: complex
    covariance: np.ndarray
    shape: np.ndarray
    channels: ShapeWithErrors
    prominence: float
    crowded: bool


def fit_band_modes(
    seen: FadingSpectra, found: list[StablePole], beside: list[StablePole]
) -> tuple[Mode, ...]:
    """Fit the modes of a band, and drop candidates that the data do not support."""
    # Those beside the ordinates are held where they are: they send their skirts in.
    starts = [StartMode(candidate.pole, candidate.shape, candidate) for candidate in found]
    chosen = _in_windows(seen, starts, [], SELECTING, CLOSE)
    again = [StartMode(sharp.pole, sharp.shape, sharp.start.candidate) for sharp in chosen]
    held = [StartMode(candidate.pole, candidate.shape, candidate) for candidate in beside]
    return tuple(_mode(sharp) for sharp in _in_windows(seen, again, held, FITTING, np.inf))


def _in_windows(
    seen: FadingSpectra,
    starts: list[StartMode],
    held: list[StartMode],
    reach: float,
    close: float,
) -> list[_Sharp]:
    order = sorted(starts, key=lambda start: start.pole.imag)
    sharp = []
    for group in group_start_modes(order, close):
        case = prepare_fading_window(seen, order, group, held, reach)
        left, best = _needed(case)
        shown = expand_to_channels(seen, case, best)
        crowded = _is_crowded(order, group)
        sharp += [
            _sharp(seen, case, best, shown[k], k, order[group[i]], crowded)
            for k, i in enumerate(left)
        ]
    return _distinct([one for one in sharp if _is_mode(one)])


def _is_crowded(order: list[StartMode], group: list[int]) -> bool:
    """Whether a neighbour too close to be left out is in another window."""
    for inner, outer in ((group[0], group[0] - 1), (group[-1], group[-1] + 1)):
        if 0 <= outer < len(order):
            one, other = order[inner].pole, order[outer].pole
            if abs(one.imag - other.imag) < -0.5 * CLOSE * (one.real + other.real):
                return True
    return False


def _needed(case: FadingWindow) -> tuple[list[int], BandFit]:
    """Fit all modes of a window, dropping one after the other what it can do without."""
    left = list(range(len(case.poles) - case.held))
    best = fit_band_model(
        case.data, initial_model(case.data, case.poles, case.shapes, case.held)
    )
    while left:
        rests = [_without(case, best, k) for k in range(len(left))]
        losses = [
            best.log_likelihood - band_log_likelihood(case.data, rest.predicted(case.data))
            for rest in rests
        ]
        worst = int(np.argmin(losses))
        if losses[worst] >= WORTH * case.price:
            break
        left.pop(worst)
        best = fit_band_model(case.data, rests[worst])
    return left, best


def _without(case: FadingWindow, whole: BandFit, mode: int) -> BandModel:
    """Model without a mode, refitted as far as it takes to see whether the mode is needed."""
    rest = whole.model.without(mode)
    rest = initial_model(case.data, rest.pole, rest.shape, rest.held)
    loss = whole.log_likelihood - band_log_likelihood(case.data, rest.predicted(case.data))
    return rest if loss > CLEAR * case.price else fit_band_model(case.data, rest).model


def _misfit(case: FadingWindow, model: BandModel, k: int) -> float:
    r"""How much further than it should the data is from a model near a mode, at least 1 [1].

    Root of the mean, over the ordinates that show the mode, each of which is worth n, of

    .. math:: n \, \left( \frac{u^H P u}{u^H S u} - 1 \right)^2 , \qquad u = S^{-1} \phi

    which is 1 where n independent ordinates of the density S have been averaged to P. Standard
    deviations are enlarged by it: a model that does not fit knows less than it believes.
    """
    pole, omega = model.pole[k], case.data.omega
    near = np.abs(1j * omega - pole) < SHOWN * -pole.real
    if not near.any():
        return 1.0
    density = model.predicted(case.data)[near]
    u = np.linalg.solve(
        density, np.broadcast_to(model.shape[:, k, None], (*density.shape[:2], 1))
    )
    turned = u.conj().transpose(0, 2, 1)
    ratio = (turned @ case.data.density[near] @ u).real / (turned @ density @ u).real
    off = case.data.number[near] * (ratio[:, 0, 0] - 1.0) ** 2
    return float(np.sqrt(max(off.mean(), 1.0)))


def _sharp(
    seen: FadingSpectra,
    case: FadingWindow,
    best: BandFit,
    shown: ShapeWithErrors,
    k: int,
    start: StartMode,
    crowded: bool,
) -> _Sharp:
    wider = _misfit(case, best.model, k)
    pole = complex(best.model.pole[k]) * case.unit + 1j * case.middle
    onto = wider * np.array([-pole.real, case.unit])
    return _Sharp(
        start,
        pole + seen.decay,
        best.pole_covariance(k) * onto[:, None] * onto,
        case.directions @ best.model.shape[:, k],
        (shown[0], wider * shown[1]),
        best.model.prominence(k),
        crowded,
    )


def _is_mode(sharp: _Sharp) -> bool:
    """Within the band, damped like a mode, standing out, and known at all."""
    decay = -sharp.pole.real
    if not 0 < decay < MOST_DAMPING * sharp.pole.imag:
        return False
    moved = abs(sharp.pole - sharp.start.pole) / max(decay, -sharp.start.pole.real)
    plain = moved < MOVED and FLANKS * decay < WIDEST * sharp.pole.imag
    sd = np.sqrt(np.diag(sharp.covariance))
    stands_out = sharp.prominence > (PEAK if plain else CLEAR_PEAK)
    return bool(stands_out and (sd < MOST_DOUBT * decay).all())


def _mode(sharp: _Sharp) -> Mode:
    """Mode in the units of the world."""
    decay, omega = -sharp.pole.real, sharp.pole.imag
    size = float(np.hypot(decay, omega))
    # Of decay rate and angular frequency, on frequency [Hz] and on the damping ratio.
    slopes = np.array([[decay, omega], [omega**2 / size, -decay * omega / size]])
    slopes /= np.array([[2 * np.pi * size], [size**2]])
    covariance = slopes @ sharp.covariance @ slopes.T
    sd = np.sqrt(np.diag(covariance))
    shape, shape_sd = sharp.channels
    return Mode(
        frequency_hz=Measured(size / (2 * np.pi), float(sd[0])),
        damping_ratio=Measured(decay / size, float(sd[1])),
        correlation=float(covariance[0, 1] / (sd[0] * sd[1])),
        shape=normalised(shape),
        shape_sd=shape_sd,
        quality=min(sharp.start.candidate.share, 1.0),
        flags=("crowded",) if sharp.crowded else (),
    )


def _distinct(sharp: list[_Sharp]) -> list[_Sharp]:
    """Without those that climbed to where another one is, which stands out more."""
    kept: list[_Sharp] = []
    for one in sorted(sharp, key=lambda s: -s.prominence):
        near = [k for k in kept if abs(k.pole - one.pole) < -min(k.pole.real, one.pole.real)]
        if all(mac(one.shape, other.shape) < ALIKE for other in near):
            kept.append(one)
    return sorted(kept, key=lambda s: s.pole.imag)


def is_same(one: Mode, other: Mode) -> bool:
    """Whether two estimates have like shapes and differ by under half their bandwidths."""
    width = sum(m.frequency_hz.value * m.damping_ratio.value for m in (one, other)) / 2
    reach = max(width, 3.0 * float(np.hypot(one.frequency_hz.sd, other.frequency_hz.sd)))
    away = abs(one.frequency_hz.value - other.frequency_hz.value)
    return away < reach and mac(one.shape, other.shape) > ALIKE
