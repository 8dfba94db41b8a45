"""Measured spectra that a modal model is fitted to: frequency responses, or transforms."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.frequency_response.response import Kind

from .noise import NoiseModel


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralData:
    r"""Rows of frequencies, and what each entry measured at them.

    .. math:: Y_e(s) = \sum_i U_i(s) H_{ei}(s) + \sum_j V_j(s) T_{ej}(s) + N_e(s) ,

    with frequency responses H and the transforms T of what the record still rings with at its
    end (or already at its start), which have the same poles. Frequency responses themselves
    are the case U = 1, with one entry for each pair of output and input.

    Parameters
    ----------
    s
        Laplace variable of each row, not 0 [rad/s].
    values
        Y.
    sd
        Standard deviation of the complex noise N, :math:`\sqrt{E |N|^2}`.
    inputs
        U.
    ends
        V; no column where records begin and end at rest.
    kind
        What the responses are.
    line_correlation
        Of the noise of a row and of the rows after it, from lag 0 on [1]: of windowed records
        neighbouring rows share noise. Rows are then neighbouring lines.
    common
        Noise that entries have in common, as amplitudes whose products over entries are the
        covariance; None where this is to be estimated from the residuals.
    """

    s: Complex[np.ndarray, " row"]
    values: Complex[np.ndarray, "row entry"]
    sd: Float[np.ndarray, "row entry"]
    inputs: Complex[np.ndarray, "row input"]
    ends: Complex[np.ndarray, "row end"]
    kind: Kind
    line_correlation: Complex[np.ndarray, " lag"] = dataclasses.field(
        default_factory=lambda: np.ones(1, dtype=complex)
    )

    common: Complex[np.ndarray, "row entry mode"] | None = None

    def with_noise(self, noise: NoiseModel) -> "SpectralData":
        """Give the same data with another noise."""
        return dataclasses.replace(self, sd=noise.sd, common=noise.common)
