"""The result of a modal test: modes, constants, diagram, measured and fitted responses."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex

from slowtime.identification.automatic.modal_result import ModalResult, join_stabilisation
from slowtime.identification.frequency_response.response import FrequencyResponse
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.poles import Poles
from slowtime.identification.subspace.stabilisation import StablePole

from .basis import response_columns
from .maximum_likelihood import PoleFit
from .modal_constants import ModalConstants, modal_constants, modes_of_fit
from .spectral_data import SpectralData

MISFIT = 1.2
"""[1] Chi-square over its expectation beyond which the model does not explain the responses
within their noise. Standard deviations are then enlarged by its root, and modes flagged."""

MISFIT_FLAG = "misfit"
"""Flag of modes of a model that leaves more than the noise."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalTest:
    """Modes of a structure with measured inputs.

    Parameters
    ----------
    constants
        Residues, participation and modal masses, one for each mode.
    chi_square_ratio
        Chi-square of the fit over its expectation; 1 if the model holds within the noise.
    candidates, fit
        Poles and data that the modes were chosen from, and their fit; None where there is none.
    driving_points
        Pairs of output and input that are one place and direction.
    """

    result: ModalResult
    constants: tuple[ModalConstants, ...]
    response: FrequencyResponse
    fitted: Complex[np.ndarray, "line output input"] | None
    chi_square_ratio: float
    candidates: "Candidates"
    fit: PoleFit | None
    driving_points: Sequence[tuple[int, int]]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Poles of all orders of each source, and the stable pole of each mode.

    The members of a stable pole are counted over all sources. With `is_noise_fitted`, the noise
    of the spectra is that of the residuals.
    """

    poles: Sequence[Poles]
    chosen: Sequence[StablePole]
    data: SpectralData
    is_noise_fitted: bool


def assemble_test(
    response: FrequencyResponse,
    candidates: Candidates,
    fit: PoleFit | None,
    driving_points: Sequence[tuple[int, int]],
) -> ModalTest:
    """Put modes, diagram and indicator functions into one result."""
    modes: tuple[Mode, ...] = ()
    constants: tuple[ModalConstants, ...] = ()
    ratio, fitted, given = float("nan"), None, fit
    if fit is not None:
        ratio = fit.chi_square / max(fit.freedom, 1)
        doubtful = ratio > MISFIT
        if doubtful:
            fit = _enlarged(fit, ratio)
        shape = (response.response.shape[1], response.response.shape[2], len(fit.poles))
        residues, sd = fit.residues.reshape(shape), fit.residue_sd.reshape(shape)
        quality = [min(one.share, 1.0) for one in candidates.chosen]
        flags = (MISFIT_FLAG,) if doubtful else ()
        modes = modes_of_fit(fit, residues, sd, quality=quality, flags=flags)
        constants = modal_constants(fit, residues, sd, driving_points)
        fitted = model_response(response, fit)
    values = np.linalg.svd(response.response, compute_uv=False)
    diagram = join_stabilisation(
        list(candidates.poles),
        [one.members for one in candidates.chosen],
        list(range(len(candidates.chosen))),
    )
    return ModalTest(
        result=ModalResult(
            modes=modes,
            stabilisation=diagram,
            spectrum_hz=response.frequency_hz,
            singular_values=values**2,
        ),
        constants=constants,
        response=response,
        fitted=fitted,
        chi_square_ratio=ratio,
        candidates=candidates,
        fit=given,
        driving_points=driving_points,
    )


def _enlarged(fit: PoleFit, ratio: float) -> PoleFit:
    return dataclasses.replace(
        fit,
        covariance=fit.covariance * ratio,
        residue_sd=fit.residue_sd * np.sqrt(ratio),
    )


def model_response(
    response: FrequencyResponse, fit: PoleFit
) -> Complex[np.ndarray, "line output input"]:
    """Frequency responses of a fit at the lines of a measurement."""
    poles = fit.poles
    columns = response_columns(response.s, poles, response.kind)
    real = np.concatenate([fit.residues.real, fit.residues.imag, fit.terms], axis=2)
    found = np.einsum("rc,eic->rei", columns, real)
    return np.asarray(found.reshape(response.response.shape))
