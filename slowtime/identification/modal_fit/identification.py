"""Modes from measured inputs: candidates by pLSCF, modes and errors by maximum likelihood."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.frequency_response.line_smoothing import smoothed_power
from slowtime.identification.frequency_response.response import FrequencyResponse
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import StablePole

from .assembly import Candidates, ModalTest, assemble_test
from .mode_choice import choose_modes, reweighted
from .polyreference import polyreference_poles
from .sharp_peaks import peak_candidates
from .spectral_data import SpectralData
from .stable_poles import stable_poles

MOST_ORDER = 40
"""Highest order of pLSCF [1]: each order is a mode and input of its own in the band."""

LINES_PER_ORDER = 6
"""Lines of the band for each order, at least [1]."""

LEAST_NOISE = 1e-4
"""[1] Noise of a response over its median modulus, at least, with which candidates are looked
for. Source: below it, rounding decides which poles of high orders are stable."""


def identify_responses(
    response: FrequencyResponse,
    *,
    band_hz: tuple[float, float] | None = None,
    order: int = MOST_ORDER,
    driving_points: Sequence[tuple[int, int]] = (),
    seed: int = 0,
) -> ModalTest:
    """Identify all modes in frequency response functions.

    Parameters
    ----------
    response
        Frequency responses, with their errors where these are known; otherwise errors are
        told by what the model leaves over.
    band_hz
        Where modes are looked for [Hz]; by default all lines.
    order
        Highest order of pLSCF.
    driving_points
        Pairs of output and input that are one place and direction.
    """
    if band_hz is not None:
        response = response.within(*band_hz)
    known = bool(np.isfinite(response.sd).all())
    sd = response.sd if known else rough_noise(response.response)
    response = dataclasses.replace(response, sd=sd)
    rough = _dithered(response, seed)
    poles, candidates = candidate_poles(rough, order, seed)
    candidates = sorted(
        [*candidates, *peak_candidates(rough, candidates)], key=lambda one: one.frequency_hz
    )
    data = data_of(response)
    band = (float(response.frequency_hz[0]), float(response.frequency_hz[-1]))
    found = choose_modes(data, np.array([c.pole for c in candidates], dtype=complex), band)
    if found is not None and not known:
        data, found = reweighted(data, found, band)
        response = dataclasses.replace(response, sd=data.sd.reshape(sd.shape))
    of_modes = [] if found is None else [candidates[k] for k in found.candidates]
    return assemble_test(
        response,
        Candidates([poles], of_modes, data, not known),
        None if found is None else found.fit,
        driving_points,
    )


def _dithered(response: FrequencyResponse, seed: int) -> FrequencyResponse:
    """Add noise to a response that has next to none, for the candidates alone."""
    # Without noise, orders above that of the structure leave singular equations, of which
    # rounding makes poles that do not repeat from order to order.
    least = LEAST_NOISE * float(np.median(np.abs(response.response)))
    added = np.sqrt(np.maximum(least**2 - response.sd**2, 0.0))
    drawn = np.random.default_rng(seed).standard_normal((2, *response.response.shape))
    return dataclasses.replace(
        response,
        response=response.response + added * (drawn[0] + 1j * drawn[1]) / np.sqrt(2),
        sd=np.hypot(response.sd, added),
    )


def candidate_poles(
    response: FrequencyResponse, order: int, seed: int
) -> tuple[Poles, list[StablePole]]:
    """Poles of all orders by pLSCF, and those that are stable.

    The decay of an exponential window is taken out of the poles.
    """
    lines = len(response.frequency_hz)
    order = max(2, min(order, lines // LINES_PER_ORDER))
    poles = polyreference_poles(
        response.frequency_hz,
        response.response,
        response.sd,
        order=order,
        rng=np.random.default_rng(seed),
    )
    poles = dataclasses.replace(poles, pole=poles.pole + response.decay_rate)
    band = {"low_hz": response.frequency_hz[0], "high_hz": response.frequency_hz[-1]}
    return poles, stable_poles(poles, **band)


def data_of(response: FrequencyResponse) -> SpectralData:
    """Frequency responses as data of a fit, an entry for each pair of output and input."""
    lines = len(response.frequency_hz)
    ends = np.zeros((lines, 0), complex) if response.end is None else response.end[:, None]
    return SpectralData(
        s=response.s,
        values=response.response.reshape(lines, -1),
        sd=response.sd.reshape(lines, -1),
        inputs=np.ones((lines, 1), dtype=complex),
        ends=ends,
        kind=response.kind,
        line_correlation=response.line_correlation,
    )


def rough_noise(
    response: Complex[np.ndarray, "line output input"],
) -> Float[np.ndarray, "line output input"]:
    """Noise of frequency responses of unknown errors, from their roughness."""
    # The third difference over lines removes what is smooth; the rest is noise, and the
    # sharpest part of resonances.
    lines = len(response)
    rough = np.diff(response.reshape(lines, -1), n=3, axis=0) / np.sqrt(20.0)
    power = np.abs(np.concatenate([rough[:1], rough, rough[-1:], rough[-1:]])) ** 2
    smooth = smoothed_power(power, np.ones_like(power))
    floor = 1e-6 * np.abs(response).reshape(lines, -1).max(axis=0)
    return np.asarray(np.sqrt(smooth + floor**2).reshape(response.shape))
