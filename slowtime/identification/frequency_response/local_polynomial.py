r"""Local polynomial estimate of frequency responses from one continuous record.

Near a line k frequency response and transient (the leakage of a record that is not periodic)
are smooth. With polynomials of degree 2 for both over the lines k - n to k + n,

.. math:: Y(k + r) = \Big(\sum_{p=0}^{2} G_p r^p\Big) U(k + r) + \sum_{p=0}^{2} t_p r^p
          + N(k + r) ,

least squares give :math:`G_0`, its error, and the noise from what is left.

References
----------
.. [1] R. Pintelon, J. Schoukens, G. Vandersteen, K. Barbe, "Estimation of nonparametric noise
   and FRF models for multivariable systems, part I: theory", MSSP 24 (2010).
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

DEGREE = 2
"""Degree of the polynomials [1]; as in [1]_."""

SPARE = 8
"""Complex residuals beyond the unknowns of a line [1]: the noise then has an error of 18 %."""

CHUNK = 4096
"""Lines that are solved at once."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalEstimate:
    """Estimate at each line that was asked for.

    Parameters
    ----------
    sd
        Standard deviation of their complex errors.
    noise
        Standard deviation of the complex noise of the outputs.
    """

    response: Complex[np.ndarray, "line output input"]
    sd: Float[np.ndarray, "line output input"]
    noise: Float[np.ndarray, "line output"]


def local_polynomial(
    inputs: Complex[np.ndarray, "line input"], outputs: Complex[np.ndarray, "line output"]
) -> LocalEstimate:
    """Frequency responses at every line of the transforms of one record.

    Transforms are at neighbouring lines, without a window. Raises `ValueError` where there are
    too few.
    """
    unknowns = (DEGREE + 1) * (inputs.shape[1] + 1)
    half = -(-(unknowns + SPARE - 1) // 2)
    width = 2 * half + 1
    if len(inputs) < width:
        raise ValueError(
            f"{len(inputs)} lines were given, at least {width} are needed for "
            f"{inputs.shape[1]} inputs. Give a wider band or a longer record."
        )
    first = np.clip(np.arange(len(inputs)) - half, 0, len(inputs) - width)
    parts = [
        _lines(inputs, outputs, first[at : at + CHUNK], np.arange(len(inputs))[at : at + CHUNK])
        for at in range(0, len(inputs), CHUNK)
    ]
    return LocalEstimate(
        response=np.concatenate([part[0] for part in parts]),
        sd=np.concatenate([part[1] for part in parts]),
        noise=np.concatenate([part[2] for part in parts]),
    )


def _lines(
    inputs: np.ndarray, outputs: np.ndarray, first: np.ndarray, line: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = inputs.shape[1]
    unknowns = (DEGREE + 1) * (count + 1)
    half = -(-(unknowns + SPARE - 1) // 2)
    rows = first[:, None] + np.arange(2 * half + 1)
    away = (rows - line[:, None]) / half
    powers = away[:, :, None] ** np.arange(DEGREE + 1)
    drives = np.concatenate([inputs[rows], np.ones((*rows.shape, 1))], axis=2)
    # Unknown of input i and power p stands at (i, p); those of power 0 are wanted.
    design = (drives[..., None] * powers[:, :, None, :]).reshape(*rows.shape, unknowns)
    scale = np.maximum(np.linalg.norm(design, axis=1), 1e-300)
    q, r = np.linalg.qr(design / scale[:, None, :])
    measured = outputs[rows]
    inner = q.conj().transpose(0, 2, 1) @ measured
    left = measured - q @ inner
    noise = np.sum(np.abs(left) ** 2, axis=1) / (rows.shape[1] - unknowns)
    inverse = np.linalg.pinv(r)
    solved = (inverse @ inner) / scale[:, :, None]
    variance = np.sum(np.abs(inverse) ** 2, axis=2) / scale**2
    wanted = np.arange(count) * (DEGREE + 1)
    response = solved[:, wanted].transpose(0, 2, 1)
    sd = np.sqrt(noise[:, :, None] * variance[:, None, wanted])
    return response, sd, np.sqrt(noise)
