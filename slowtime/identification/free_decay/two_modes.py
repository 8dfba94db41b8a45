r"""Whether two viscous modes explain a slow flow better than one mode with a law of its own.

The slow flow of two viscous modes is

.. math:: z(t) = c_1 e^{s_1 t} + c_2 e^{s_2 t} ,

which beats, and whose amplitude imitates damping that depends on amplitude.

References
----------
.. [1] Y. Hua and T. K. Sarkar, "Matrix pencil method for estimating parameters of exponentially
   damped/undamped sinusoids in noise", IEEE Transactions on Acoustics, Speech, and Signal
   Processing 38 (1990) 814-824.
"""

import math

import numpy as np
import scipy.optimize
from jaxtyping import Complex, Float

from .envelope import Envelope

PARAMETERS = 8
"""[1] Real parameters of two complex exponentials."""
MIN_TURN = 0.1
"""[1] Turns of the two against each other along the decay, at least. Source: two exponentials
of one frequency imitate any law of damping; fitted to friction and drag, they turn by 0.03."""
MAX_GROWTH = 0.05
"""[1] Of the logarithm of the amplitude of either along the decay: modes do not grow."""


def misfit_of_two_modes(envelope: Envelope) -> float:
    """Fit two decaying exponentials to the slow flow.

    Gives the sum of squares of what they leave of the flow, over its errors [1]; infinite where
    the fit is not one of two modes of different frequencies.
    """
    flow = envelope.amplitude * np.exp(1j * np.pi * envelope.half_cycles)
    times = envelope.times_s - envelope.times_s[0]
    span, step = float(times[-1]), float(times[1] - times[0])
    mean_turn = np.pi * float(envelope.half_cycles[-1]) / span
    flow = flow * np.exp(-1j * mean_turn * times)
    start = _pencil(flow) / step
    if len(start) < 2 or len(flow) * 2 <= PARAMETERS:
        return math.inf

    def left(parameters: Float[np.ndarray, "4"]) -> Float[np.ndarray, " value"]:
        poles = (parameters[:2] + 1j * parameters[2:]) / span
        waves = np.exp(np.minimum(np.outer(times, poles).real, 50.0)) * np.exp(
            1j * np.outer(times, poles.imag)
        )
        weighted = waves / envelope.amplitude_sd[:, None]
        target = flow / envelope.amplitude_sd
        rest = target - weighted @ np.linalg.lstsq(weighted, target, rcond=None)[0]
        return np.concatenate([rest.real, rest.imag])

    given = np.concatenate([start.real, start.imag]) * span
    given[:2] = np.minimum(given[:2], 0.0)
    bounds = ([-np.inf] * 4, [MAX_GROWTH] * 2 + [np.inf] * 2)
    found = scipy.optimize.least_squares(left, given, bounds=bounds, x_scale="jac")
    turned = abs(float(found.x[2] - found.x[3])) / (2 * np.pi)
    return 2 * float(found.cost) if turned > MIN_TURN else math.inf


def _pencil(flow: Complex[np.ndarray, " point"]) -> Complex[np.ndarray, " pole"]:
    """Logarithms of the two ratios of successive points, by the matrix pencil method."""
    columns = max(len(flow) // 2, 2)
    hankel = np.lib.stride_tricks.sliding_window_view(flow, columns)
    if min(hankel.shape) < 3:
        return np.zeros(0, complex)
    _, _, right = np.linalg.svd(hankel, full_matrices=False)
    basis = right[:2].T
    ratios = np.linalg.eigvals(np.linalg.pinv(basis[:-1]) @ basis[1:])
    return np.asarray(np.log(ratios[np.abs(ratios) > 0]))
