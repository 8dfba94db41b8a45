r"""Frequency responses from hammer blows, averaged.

The force window is 1 over the pulse and 0 elsewhere: between blows the force cell measures
noise. An exponential window :math:`e^{-\sigma t}`, where it is asked for, multiplies force and
responses alike, so that the windowed response is exactly that of a structure whose poles are
moved by :math:`-\sigma`: :math:`H_w(j \omega) = H(j \omega + \sigma)`. Frequencies and damping
are then corrected without approximation, by fitting at :math:`s = j \omega + \sigma`.

Without an exponential window the block may end before the structure is at rest. What it still
rings with has the poles of the structure as well, and is fitted together with the response
(`FrequencyResponse.end`), so that it biases nothing.

References
----------
.. [1] W. Fladung, R. Rost, "Application and correction of the exponential window for frequency
   response functions", MSSP 11 (1997).
.. [2] R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed.
   (2012), section 6.3.2.
"""

import numpy as np
import scipy.fft as fft
from jaxtyping import Float

from .estimators import (
    Estimator,
    estimate_response,
    multiple_coherence,
    output_noise,
    random_error,
    spectral_matrices,
)
from .hits import Hit
from .line_smoothing import smoothed_power
from .response import FrequencyResponse, Kind

LEAST_CORRELATION = 0.02
"""[1] Correlation of the noise of two lines below which it is left out."""


def hammer_response(
    force: Float[np.ndarray, " time"],
    responses: Float[np.ndarray, "time output"],
    rate_hz: float,
    hits: tuple[Hit, ...],
    *,
    kind: Kind = "acceleration",
    estimator: Estimator = "h1",
    decay_rate: float = 0.0,
) -> FrequencyResponse:
    """Average the frequency responses of all blows that are of use.

    Parameters
    ----------
    hits
        Blows, as `find_hits` gives them; those refused are left out.
    decay_rate
        Of the exponential window [1/s]; 0 for none.

    Raises
    ------
    ValueError
        Where no blow is of use, or the window grows.
    """
    used = [hit for hit in hits if not hit.refused]
    if not used:
        reasons = "; ".join(f"{hit.at_s:.3f} s: {hit.refused}" for hit in hits)
        raise ValueError(
            f"None of {len(hits)} blows is of use ({reasons}). Record blows without bounces "
            "or overloads, further apart."
        )
    if not (np.isfinite(decay_rate) and decay_rate >= 0):
        raise ValueError(
            f"{decay_rate=} is not a valid decay of a window. Give 0 or more [1/s]."
        )
    u, y = _transforms(force, responses, rate_hz, used, decay_rate)
    spectra = spectral_matrices(u, y)
    noise = output_noise(spectra)
    if len(used) > 1:
        noise = smoothed_power(noise, np.ones_like(noise))
    length = used[0].last - used[0].first
    mean = u[:, :, 0].mean(axis=0)
    lines = slice(1, None)
    return FrequencyResponse(
        frequency_hz=fft.rfftfreq(length, 1 / rate_hz)[lines],
        response=estimate_response(spectra, estimator)[lines],
        sd=random_error(spectra, noise)[lines],
        coherence=multiple_coherence(spectra)[lines],
        averages=len(used),
        kind=kind,
        decay_rate=decay_rate,
        end=(1.0 / mean)[lines] if decay_rate == 0 else None,
        line_correlation=_line_correlation(length / rate_hz, decay_rate),
    )


def _transforms(
    force: np.ndarray,
    responses: np.ndarray,
    rate_hz: float,
    used: list[Hit],
    decay_rate: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return transforms of the windowed blocks, time counted from the start of each block."""
    offset = np.median(responses, axis=0)
    rest = np.median(force)
    u, y = [], []
    for hit in used:
        rows = np.arange(hit.first, hit.last)
        window = np.exp(-decay_rate * np.arange(len(rows)) / rate_hz)
        pulse = (rows >= hit.pulse[0]) & (rows < hit.pulse[1])
        u.append(fft.rfft((force[rows] - rest) * pulse * window)[:, None])
        y.append(fft.rfft((responses[rows] - offset) * window[:, None], axis=0))
    return np.stack(u), np.stack(y)


def _line_correlation(duration_s: float, decay_rate: float) -> np.ndarray:
    """Correlation of white noise under the window at lines that are some apart."""
    if decay_rate == 0:
        return np.ones(1, dtype=complex)
    reach = 2.0 * decay_rate * duration_s
    lags = np.arange(200)
    # Transform of the squared window over its area; 1 - exp(-reach) cancels.
    correlation = reach / (reach - 2j * np.pi * lags)
    return np.asarray(correlation[np.abs(correlation) > LEAST_CORRELATION])
