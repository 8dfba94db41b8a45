"""Modes from a record of hammer blows.

The averaged frequency responses give the candidates and are shown. The modes are fitted to the
record itself, from the first useful blow to the last, cut where a blow was rejected: what the
structure still rings with when the next blow comes is then part of the response, and needs no
window. With an exponential window, where one is asked for, the averaged responses themselves
are fitted.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.identification.frequency_response.estimators import Estimator
from slowtime.identification.frequency_response.hammer import hammer_response
from slowtime.identification.frequency_response.hits import Hit
from slowtime.identification.frequency_response.response import FrequencyResponse, Kind

from .assembly import ModalTest, assemble_test
from .identification import MOST_ORDER, candidate_poles, identify_responses, rough_noise
from .segments import Segment, fit_segments, transforms


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class HammerSettings:
    """How a record of blows is evaluated.

    `decay_rate` is that of an exponential window [1/s]; 0 for none.
    """

    kind: Kind = "acceleration"
    estimator: Estimator = "h1"
    decay_rate: float = 0.0


def identify_blows(
    force: Float[np.ndarray, " time"],
    responses: Float[np.ndarray, "time output"],
    rate_hz: float,
    hits: tuple[Hit, ...],
    *,
    band_hz: tuple[float, float],
    settings: HammerSettings | None = None,
    driving_points: Sequence[tuple[int, int]] = (),
) -> ModalTest:
    """Identify all modes of a structure from blows of one hammer at one place.

    Parameters
    ----------
    hits
        Blows, as `find_hits` gives them; those refused are left out.
    band_hz
        Where modes are looked for [Hz].
    driving_points
        Pairs of output and input (0) that are one place and direction.

    Raises
    ------
    ValueError
        Where no blow is of use.
    """
    settings = settings or HammerSettings()
    response = hammer_response(
        force,
        responses,
        rate_hz,
        hits,
        kind=settings.kind,
        estimator=settings.estimator,
        decay_rate=settings.decay_rate,
    ).within(*band_hz)
    if settings.decay_rate > 0:
        return identify_responses(response, driving_points=driving_points)
    known = bool(np.isfinite(response.sd).all())
    sd = response.sd if known else rough_noise(response.response)
    response = dataclasses.replace(response, sd=sd)
    poles, candidates = candidate_poles(response, MOST_ORDER, seed=0)
    segments = segments_of(force, responses, hits)
    noise = _noise(response, segments, rate_hz, band_hz)
    chosen, fit = fit_segments(
        segments, rate_hz, band_hz, settings.kind, noise, [poles], candidates
    )
    return assemble_test(response, chosen, fit, driving_points)


def segments_of(
    force: Float[np.ndarray, " time"],
    responses: Float[np.ndarray, "time output"],
    hits: tuple[Hit, ...],
) -> list[Segment]:
    """Stretches of a record with useful blows alone, the force 0 between them.

    There is one segment for each run of useful blows.
    """
    windowed = np.zeros(len(force))
    for hit in hits:
        pulse = slice(*hit.pulse)
        windowed[pulse] = force[pulse] - np.median(force)
    level = np.median(responses, axis=0)
    runs: list[list[int]] = []
    before_refused = True
    for hit in hits:
        if hit.refused:
            if not before_refused and runs:
                runs[-1][1] = min(runs[-1][1], max(hit.first, runs[-1][0] + 1))
            before_refused = True
        elif before_refused:
            runs.append([hit.first, hit.last])
            before_refused = False
        else:
            runs[-1][1] = hit.last
    return [
        Segment(windowed[first:last, None], responses[first:last] - level)
        for first, last in runs
    ]


def _noise(
    response: FrequencyResponse,
    segments: list[Segment],
    rate_hz: float,
    band_hz: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Noise of the transforms: errors of the responses times the root of the input power."""
    parts = [transforms(segment, rate_hz, band_hz) for segment in segments]
    power = float(np.mean(np.concatenate([np.abs(part[1]) ** 2 for part in parts])))
    return response.frequency_hz, response.sd[:, :, 0] * np.sqrt(power)
