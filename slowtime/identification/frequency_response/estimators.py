r"""Estimators H1, H2 and Hv of frequency responses from averaged spectral matrices.

With one-sided averages over blocks of :math:`S_{xx}` (inputs), :math:`S_{yx}` and
:math:`S_{yy}` (outputs),

.. math:: H_1 = S_{yx} S_{xx}^{-1}, \qquad
          H_2 = S_{yy} S_{xy}^{-1} \; \text{(one input)} ,

H1 being exact with noise in the outputs alone, H2 with noise in the input alone. Hv is total
least squares with noise of equal relative size in all channels: the vector
:math:`(H_v, -1)^H` is the eigenvector of the least eigenvalue of the joint matrix of inputs
and one output.

References
----------
.. [1] J. S. Bendat, A. G. Piersol, "Random Data", 4th ed. (2010), sections 6.1, 7.2 and 9.2
   (random errors of estimates).
.. [2] G. T. Rocklin, J. Crowley, H. Vold, "A comparison of H1, H2, and Hv frequency response
   functions", IMAC 3 (1985).
.. [3] R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed.
   (2012), section 2.7.
"""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

Estimator = Literal["h1", "h2", "hv"]

COHERENT_INPUTS = 0.98
"""Median coherence of one input with the others [1] from which they cannot be told apart: the
errors of the frequency responses are then seven times those of independent inputs."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralMatrices:
    """Averages over blocks of products of transforms.

    Parameters
    ----------
    inputs
        :math:`S_{xx}`, Hermitian.
    cross
        :math:`S_{yx}`: output times conjugate input.
    outputs
        :math:`S_{yy}` of each output.
    averages
        Effective number of independent blocks.
    """

    inputs: Complex[np.ndarray, "line input input"]
    cross: Complex[np.ndarray, "line output input"]
    outputs: Float[np.ndarray, "line output"]
    averages: float


def spectral_matrices(
    inputs: Complex[np.ndarray, "block line input"],
    outputs: Complex[np.ndarray, "block line output"],
    *,
    averages: float | None = None,
) -> SpectralMatrices:
    """Average products of transforms over blocks.

    `averages` is the effective number of independent blocks, where they overlap; by default
    all.
    """
    count = len(inputs)
    return SpectralMatrices(
        inputs=np.einsum("bfi,bfj->fij", inputs, inputs.conj()) / count,
        cross=np.einsum("bfo,bfi->foi", outputs, inputs.conj()) / count,
        outputs=np.sum(np.abs(outputs) ** 2, axis=0) / count,
        averages=float(count if averages is None else averages),
    )


def estimate_response(
    spectra: SpectralMatrices, estimator: Estimator = "h1"
) -> Complex[np.ndarray, "line output input"]:
    """Frequency responses of all outputs and inputs.

    H2 is for one input only. Raises `ValueError` where inputs are coherent, fewer blocks than
    inputs were averaged, or H2 is asked for with several inputs.
    """
    count = spectra.inputs.shape[1]
    if estimator not in ("h1", "h2", "hv"):
        raise ValueError(f"estimator={estimator!r} is unknown. Allowed: 'h1', 'h2', 'hv'.")
    if estimator == "h2" and count > 1:
        raise ValueError(
            f"H2 was asked for with {count} inputs; it is defined for one. Choose 'h1' or 'hv'."
        )
    if spectra.averages < count:
        raise ValueError(
            f"{spectra.averages:g} blocks were averaged, which cannot tell {count} inputs "
            "apart. Give a longer record or shorter blocks."
        )
    check_inputs(spectra)
    if estimator == "h1":
        return _right_solve(spectra.cross, spectra.inputs)
    if estimator == "h2":
        return np.asarray(spectra.outputs[:, :, None] / spectra.cross.conj())
    return _total_least_squares(spectra)


def input_coherence(spectra: SpectralMatrices) -> Float[np.ndarray, "line input"]:
    r"""Multiple coherence of each input with all others, :math:`1 - 1 / (S_{ii} S^{ii})`.

    It is 0 for a single input.
    """
    power = np.einsum("fii->fi", spectra.inputs).real
    size = np.sqrt(np.maximum(power, 1e-300))
    scaled = spectra.inputs / (size[:, :, None] * size[:, None, :])
    scaled = scaled + 1e-12 * np.eye(scaled.shape[1])
    inverse = np.einsum("fii->fi", np.linalg.inv(scaled)).real
    return np.asarray(np.clip(1.0 - 1.0 / np.maximum(inverse, 1.0), 0.0, 1.0))


def check_inputs(spectra: SpectralMatrices) -> None:
    """Refuse inputs that cannot be told apart.

    Raises `ValueError` where an input is coherent with the others.
    """
    median = np.median(input_coherence(spectra), axis=0)
    worst = int(np.argmax(median))
    if median[worst] > COHERENT_INPUTS:
        raise ValueError(
            f"Input {worst + 1} of {len(median)} is coherent with the others: median coherence "
            f"{median[worst]:.3f}, allowed are {COHERENT_INPUTS}. Drive the shakers with "
            "independent signals, or leave out all inputs but one."
        )


def multiple_coherence(
    spectra: SpectralMatrices,
) -> Float[np.ndarray, "line output"]:
    r"""Share of each output that the inputs explain linearly [1].

    .. math:: \gamma^2 = \frac{S_{yx} S_{xx}^{-1} S_{xy}}{S_{yy}}
    """
    h1 = _right_solve(spectra.cross, spectra.inputs)
    explained = np.einsum("foi,foi->fo", h1, spectra.cross.conj()).real
    return np.asarray(np.clip(explained / np.maximum(spectra.outputs, 1e-300), 0.0, 1.0))


def random_error(
    spectra: SpectralMatrices, noise: Float[np.ndarray, "line output"] | None = None
) -> Float[np.ndarray, "line output input"]:
    r"""Return standard deviation of the complex random error of H1.

    .. math:: \sigma_{oi}^2 = \frac{S_{nn,o}}{K} \, [S_{xx}^{-1}]_{ii}, \qquad
              S_{nn,o} = \frac{K}{K - N_i} (1 - \gamma_o^2) S_{yy,o} ;

    for one input the modulus then has the error :math:`\sqrt{1 - \gamma^2} / (|\gamma|
    \sqrt{2 K})` of [1]_, table 9.6.

    The power of the noise of each output is by default that of the coherence; not a number
    where no more blocks than inputs were averaged.
    """
    inverse = np.einsum("fii->fi", np.linalg.pinv(spectra.inputs, hermitian=True)).real
    power = output_noise(spectra) if noise is None else noise
    variance = power[:, :, None] * np.maximum(inverse, 0.0)[:, None, :] / spectra.averages
    return np.asarray(np.sqrt(variance))


def output_noise(spectra: SpectralMatrices) -> Float[np.ndarray, "line output"]:
    """Power of each output that the inputs do not explain, without bias.

    Not a number where no more blocks than inputs were averaged.
    """
    free = spectra.averages - spectra.inputs.shape[1]
    if free <= 0:
        return np.full_like(spectra.outputs, np.nan)
    left = (1.0 - multiple_coherence(spectra)) * spectra.outputs
    return np.asarray(left * spectra.averages / free)


def _right_solve(cross: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Cross spectra times the inverse of those of the inputs."""
    solved = np.linalg.solve(inputs.transpose(0, 2, 1), cross.transpose(0, 2, 1))
    return np.asarray(solved.transpose(0, 2, 1))


def _total_least_squares(spectra: SpectralMatrices) -> np.ndarray:
    """Hv: each output in turn with all inputs, channels scaled to equal power at each line."""
    lines, outputs, inputs = spectra.cross.shape
    found = np.empty((lines, outputs, inputs), dtype=complex)
    of_inputs = np.sqrt(np.einsum("fii->fi", spectra.inputs).real)
    for output in range(outputs):
        joint = np.empty((lines, inputs + 1, inputs + 1), dtype=complex)
        joint[:, :inputs, :inputs] = spectra.inputs
        joint[:, inputs, :inputs] = spectra.cross[:, output]
        joint[:, :inputs, inputs] = spectra.cross[:, output].conj()
        joint[:, inputs, inputs] = spectra.outputs[:, output]
        scale = np.concatenate(
            [of_inputs, np.sqrt(spectra.outputs[:, output])[:, None]], axis=1
        )
        scale = np.maximum(scale, 1e-300)
        _, vectors = np.linalg.eigh(joint / (scale[:, :, None] * scale[:, None, :]))
        least = vectors[:, :, 0] / scale
        found[:, output] = -(least[:, :inputs] / least[:, inputs:]).conj()
    return found
