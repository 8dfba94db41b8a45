"""Which candidates are modes: backward elimination in fits of greatest likelihood."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import stdtrit

from slowtime.identification.mode_shapes.criteria import mac
from slowtime.identification.subspace.poles import GAUSSIAN
from slowtime.identification.subspace.stabilisation import MOST_DAMPING

from .basis import pole_quantities
from .maximum_likelihood import PoleFit, fit_poles
from .noise import ROWS_PER_KNOT, NoiseModel, model_noise
from .spectral_data import SpectralData

MOST_SD = 1.0
"""[half-bandwidths] Largest standard deviation of the frequency of a mode."""

SAME = 0.5
"""[half-bandwidths] Distance below which two poles of one shape are one mode."""

SPLIT = 2.0
"""[half-bandwidths] The same for shapes that are alike over several outputs. A structure that
is slightly nonlinear, or changed between blows, has a resonance that two poles fit better."""

ALIKE = 0.8
"""[1] Modal assurance criterion of shapes that count as one."""

FEWEST_ENTRIES = 3
"""Entries from which on a shape tells modes apart [1]."""

EVIDENCE = 2.0
"""[1] Times the Bayesian information criterion that a mode has to gain: twice, as starting
values were searched for over the whole band."""

REWEIGHTINGS = 3
"""Fits with noise by the residuals of the one before; the third changes weights by percents."""

DROPPED = 3
"""Of the candidates that are no modes, one in so many is dropped at once, the weakest."""

CANDIDATE_ROUNDS = 6
"""Iterations of a fit that only serves to reject candidates."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChosenModes:
    """Fit of the modes that remain, and which candidates they were."""

    fit: PoleFit
    candidates: tuple[int, ...]


def choose_modes(
    data: SpectralData,
    poles: Complex[np.ndarray, " candidate"],
    band_hz: tuple[float, float],
) -> ChosenModes | None:
    """Fit candidates, and drop the least of those that are no modes until all are.

    Modes are accepted in the band; None where no candidate remains.
    """
    poles = np.asarray(poles, dtype=complex)
    names = np.arange(len(poles))
    poles, names = _few_enough(data, poles, names)
    while len(poles):
        fit = fit_poles(data, poles, rounds=CANDIDATE_ROUNDS)
        # The fit is in order of frequency; candidates keep theirs by the nearest pole.
        names = names[np.argsort(poles.imag)]
        gain = evidence(data, fit)
        bad = _unlike_modes(fit, gain, band_hz)
        if not bad.any():
            whole = fit_poles(data, fit.poles)
            if not _unlike_modes(whole, evidence(data, whole), band_hz).any():
                return ChosenModes(fit=whole, candidates=tuple(int(name) for name in names))
            fit, gain = whole, evidence(data, whole)
            bad = _unlike_modes(whole, gain, band_hz)
        count = -(-int(np.count_nonzero(bad)) // DROPPED)
        drop = np.argsort(np.where(bad, gain, np.inf))[:count]
        poles = np.delete(fit.poles, drop)
        names = np.delete(names, drop)
    return None


def reweighted(
    data: SpectralData, found: ChosenModes, band_hz: tuple[float, float]
) -> tuple[SpectralData, ChosenModes | None]:
    """Estimate the noise by what a fit leaves over, and choose and fit again.

    The data come with a first guess of the noise; None where no mode remains.
    """
    for _ in range(REWEIGHTINGS):
        noise = noise_of_fit(data, found.fit)
        data = data.with_noise(noise)
        again = choose_modes(data, found.fit.poles, band_hz)
        if again is None:
            return data, None
        names = tuple(found.candidates[k] for k in again.candidates)
        found = ChosenModes(fit=again.fit, candidates=names)
    wider = enlarged_by_student(found.fit, noise_of_fit(data, found.fit))
    return data, dataclasses.replace(found, fit=wider)


def noise_of_fit(data: SpectralData, fit: PoleFit) -> NoiseModel:
    """Model the noise by what a fit leaves over."""
    strongest = int(np.argmax(np.abs(fit.residues).sum(axis=(0, 2))))
    shapes = fit.residues[:, strongest]
    return model_noise(data.s, fit.residuals, fit.leverage, fit.poles, shapes)


def enlarged_by_student(fit: PoleFit, noise: NoiseModel) -> PoleFit:
    r"""Enlarge standard deviations for noise that was estimated from few lines.

    Noise that shakes a mode is known from the lines within its peak alone, less those that the
    fit used up. The factor makes 1.96 standard deviations an interval of 95 % under Student's
    law.
    """
    share = np.mean(np.abs(noise.common) ** 2 / noise.sd[:, :, None] ** 2, axis=1)
    left = 1.0 - fit.leverage.mean(axis=1)
    factors = []
    for k in range(len(fit.poles)):
        weight = fit.information[:, k]
        peak = float(weight @ share[:, k])
        lines = 1.0 / np.sum(weight**2) * float(weight @ left)
        # Of the information on a pole the share c has noise of few degrees of freedom, the rest
        # noise of many lines: 1 / nu = c^2 / nu_p + (1 - c)^2 / nu_t (Welch-Satterthwaite).
        reciprocal = peak**2 / max(2.0 * lines, 2.0) + (1.0 - peak) ** 2 / (2 * ROWS_PER_KNOT)
        factors.append(stdtrit(1.0 / reciprocal, 0.975) / GAUSSIAN)
    both = np.concatenate([factors, factors])
    return dataclasses.replace(fit, covariance=fit.covariance * np.outer(both, both))


def evidence(data: SpectralData, fit: PoleFit) -> Float[np.ndarray, " mode"]:
    """Decrease of chi-square by each mode, less what as many parameters need.

    Negative for a mode that is not needed.
    """
    wald = np.sum(2.0 * np.abs(fit.residues) ** 2 / fit.residue_sd**2, axis=(0, 1))
    entries, inputs, _ = fit.residues.shape
    parameters = 2 + 2 * entries * inputs
    rows = 2 * data.values.size
    return np.asarray(wald - EVIDENCE * parameters * np.log(rows))


def _few_enough(
    data: SpectralData, poles: np.ndarray, names: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Leave out the broadest candidates where there are more than the rows can hold."""
    blocks = data.inputs.shape[1] + data.ends.shape[1]
    most = max(1, (2 * len(data.s) - 8 * blocks) // (4 * blocks + 4))
    kept = np.sort(np.argsort(-poles.real)[:most])
    return poles[kept], names[kept]


def _unlike_modes(fit: PoleFit, gain: np.ndarray, band_hz: tuple[float, float]) -> np.ndarray:
    frequency, damping, _ = pole_quantities(fit.poles)
    modes = len(fit.poles)
    half = np.abs(fit.poles.real)
    sd = np.sqrt(np.diag(fit.covariance))[modes:]
    bad = (damping <= 0) | (damping > MOST_DAMPING) | (gain < 0) | (sd > MOST_SD * half)
    bad |= (frequency < band_hz[0]) | (frequency > band_hz[1])
    shapes = fit.residues.reshape(-1, modes)
    distance = SPLIT if len(shapes) >= FEWEST_ENTRIES else SAME
    for one in range(modes):
        for other in range(one):
            near = abs(fit.poles[one] - fit.poles[other]) < distance * min(
                half[one], half[other]
            )
            if near and mac(shapes[:, one], shapes[:, other]) > ALIKE:
                bad[one if gain[one] < gain[other] else other] = True
    return np.asarray(bad)
