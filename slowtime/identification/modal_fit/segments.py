r"""Fit of modes to the transforms of segments of records, without leakage.

The transforms of each segment obey

.. math:: Y(\omega) = H(j \omega) U(\omega) + T(j \omega) + N(\omega) ,

where T, which has the poles of H, is what the structure rings with at the start and at the end
of the segment. The noise, unmeasured excitation among it, is estimated from what the fit
leaves over, smoothed over lines, and may be common to the outputs.

References
----------
.. [1] R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed.
   (2012), sections 6.3.2 and 9.11.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from slowtime.identification.frequency_response.response import Kind
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import StablePole

from .assembly import Candidates
from .maximum_likelihood import PoleFit
from .mode_choice import choose_modes, reweighted
from .spectral_data import SpectralData

MOST_LINES = 3000
"""Lines from which on those far from all candidates are thinned out."""

NEAR = 20.0
"""[half-bandwidths] Distance from a candidate within which all lines are kept: beyond, there is
a thousandth of what a record tells of the pole."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """Samples of inputs and outputs without a gap, without offsets."""

    inputs: Float[np.ndarray, "time input"]
    outputs: Float[np.ndarray, "time output"]


def transforms(
    segment: Segment, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[
    Float[np.ndarray, " line"],
    Complex[np.ndarray, "line input"],
    Complex[np.ndarray, "line output"],
]:
    """Return transforms of a segment within a band, over the root of its length.

    White noise then has the same size in segments of any length.
    """
    count = len(segment.inputs)
    frequency = fft.rfftfreq(count, 1 / rate_hz)
    lines = (frequency >= band_hz[0]) & (frequency <= band_hz[1]) & (frequency > 0)
    u, y = (fft.rfft(x, axis=0)[lines] for x in (segment.inputs, segment.outputs))
    return frequency[lines], u / np.sqrt(count), y / np.sqrt(count)


def fit_segments(
    segments: Sequence[Segment],
    rate_hz: float,
    band_hz: tuple[float, float],
    kind: Kind,
    noise: tuple[Float[np.ndarray, " line"], Float[np.ndarray, "line output"]],
    poles: Sequence[Poles],
    candidates: Sequence[StablePole],
) -> tuple[Candidates, PoleFit | None]:
    """Choose and fit modes among candidates.

    The first guess of the noise is given by frequencies and standard deviations of the
    transforms there. The fit is None where there is no mode.
    """
    data = _data(segments, rate_hz, band_hz, kind, noise)
    start = np.array([c.pole for c in candidates], dtype=complex)
    data = _thinned(data, start)
    found = choose_modes(data, start, band_hz)
    if found is not None:
        data, found = reweighted(data, found, band_hz)
    chosen = [] if found is None else [candidates[k] for k in found.candidates]
    return Candidates(poles, chosen, data, True), None if found is None else found.fit


def _data(
    segments: Sequence[Segment],
    rate_hz: float,
    band_hz: tuple[float, float],
    kind: Kind,
    noise: tuple[np.ndarray, np.ndarray],
) -> SpectralData:
    """Rows of all segments in order of frequency, as noise is smoothed over neighbours."""
    parts = [transforms(segment, rate_hz, band_hz) for segment in segments]
    frequency = np.concatenate([part[0] for part in parts])
    which = np.concatenate([np.full(len(part[0]), k) for k, part in enumerate(parts)])
    order = np.argsort(frequency, kind="stable")
    ends = (which[order, None] == np.arange(len(parts))).astype(complex)
    sd = [np.interp(frequency[order], noise[0], column) for column in noise[1].T]
    return SpectralData(
        s=2j * np.pi * frequency[order],
        values=np.concatenate([part[2] for part in parts])[order],
        sd=np.stack(sd, axis=1),
        inputs=np.concatenate([part[1] for part in parts])[order],
        ends=ends,
        kind=kind,
    )


def _thinned(data: SpectralData, poles: np.ndarray) -> SpectralData:
    """Keep the lines near candidates, and of the others as many as are enough."""
    lines = len(data.s)
    if lines <= MOST_LINES:
        return data
    away = np.abs(data.s.imag[:, None] - poles.imag) / np.abs(poles.real)
    kept = (away < NEAR).any(axis=1)
    kept[:: max(1, lines // (MOST_LINES // 2))] = True
    return dataclasses.replace(
        data,
        s=data.s[kept],
        values=data.values[kept],
        sd=data.sd[kept],
        inputs=data.inputs[kept],
        ends=data.ends[kept],
    )
