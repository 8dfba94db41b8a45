"""Modes from one continuous record of inputs and outputs: shakers, or motion of the ground."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.identification.frequency_response.estimators import Estimator
from slowtime.identification.frequency_response.line_smoothing import smoothed_power
from slowtime.identification.frequency_response.local_polynomial import (
    LocalEstimate,
    local_polynomial,
)
from slowtime.identification.frequency_response.response import FrequencyResponse, Kind
from slowtime.identification.frequency_response.shaker import shaker_response
from slowtime.identification.subspace.input_output import input_output_poles
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import StablePole, find_stable_poles
from slowtime.signals.spectra import detrended

from .assembly import ModalTest, assemble_test
from .identification import MOST_ORDER, candidate_poles
from .segments import Segment, fit_segments, transforms

Source = Literal["both", "polyreference", "subspace"]
"""Where candidates come from. pLSCF serves wide bands, subspaces low coherence."""

SAME = 1.0
"""[half-bandwidths] Distance from one source's candidate to another's that is the same."""


def identify_record(
    inputs: Float[np.ndarray, "time input"],
    outputs: Float[np.ndarray, "time output"],
    rate_hz: float,
    *,
    kind: Kind,
    band_hz: tuple[float, float],
    source: Source = "both",
    estimator: Estimator = "h1",
    driving_points: Sequence[tuple[int, int]] = (),
) -> ModalTest:
    """Identify all modes of a structure from a continuous record.

    Parameters
    ----------
    inputs, outputs
        Samples, both behind the same anti-alias filter.
    source
        Candidates by pLSCF, by input-output subspaces, or both; the modes are fitted alike.
    estimator
        Of the averaged frequency responses in the result.
    driving_points
        Pairs of output and input that are one place and direction.

    Raises
    ------
    ValueError
        Where inputs are coherent, or the record is too short.
    """
    segment = Segment(detrended(inputs), detrended(outputs))
    averaged = shaker_response(
        segment.inputs, segment.outputs, rate_hz, kind=kind, estimator=estimator
    ).within(*band_hz)
    frequency, u, y = transforms(segment, rate_hz, band_hz)
    local = local_polynomial(u, y)
    noise = np.sqrt(smoothed_power(local.noise**2, np.ones_like(local.noise)))
    found = []
    if source != "polyreference":
        found.append(subspace_candidates(segment, rate_hz, band_hz))
    if source != "subspace":
        measured = _response(frequency, local, kind)
        found.append(candidate_poles(measured, MOST_ORDER, seed=0))
    poles, candidates = _joined(found)
    chosen, fit = fit_segments(
        [segment], rate_hz, band_hz, kind, (frequency, noise), poles, candidates
    )
    return assemble_test(averaged, chosen, fit, driving_points)


def _joined(
    found: Sequence[tuple[Poles, list[StablePole]]],
) -> tuple[list[Poles], list[StablePole]]:
    """Join the candidates of all sources, those of the first where two are the same."""
    candidates: list[StablePole] = []
    before = 0
    for poles, stable in found:
        known = [(one.pole, abs(one.pole.real)) for one in candidates]
        candidates += [
            dataclasses.replace(one, members=one.members + before, index=one.index + before)
            for one in stable
            if all(
                abs(one.pole - pole) > SAME * max(half, abs(one.pole.real))
                for pole, half in known
            )
        ]
        before += len(poles.order)
    return [poles for poles, _ in found], sorted(candidates, key=lambda one: one.frequency_hz)


def _response(frequency_hz: np.ndarray, local: LocalEstimate, kind: Kind) -> FrequencyResponse:
    return FrequencyResponse(
        frequency_hz=frequency_hz,
        response=local.response,
        sd=local.sd,
        coherence=np.full(local.noise.shape, np.nan),
        averages=1,
        kind=kind,
    )


def subspace_candidates(
    segment: Segment, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[Poles, list[StablePole]]:
    """Poles of input-output subspace models of all orders, and those that are stable."""
    poles = input_output_poles(segment.inputs, segment.outputs, rate_hz, highest_hz=band_hz[1])
    return poles, find_stable_poles(poles, low_hz=band_hz[0], high_hz=band_hz[1])
