r"""Amplitudes of orders: a record resampled to equal steps of shaft angle.

An order is a multiple of the speed of a shaft. In samples at equal angles it has a constant
frequency whatever the speed does, and a transform over whole revolutions has no leakage.

References
----------
.. [1] K. R. Fyfe, E. D. S. Munck, "Analysis of computed order tracking", MSSP 11 (1997).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.signals.interpolation import at_instants

from .tacho import Rotation

REVOLUTIONS = 16
"""Revolutions of a block by default [1]: orders that differ by 1/8 are told apart."""

PROBES = (-4, -3, -2, 2, 3, 4)
"""[1 / revolutions of a block] Distance from an order of those at which its noise is read."""

PIECES = 64
"""Largest number of orders at once [1]: beyond, the unknowns of a block outgrow its samples."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orders:
    """Complex amplitudes of orders, block by block.

    Parameters
    ----------
    order
        Multiples of the speed [1].
    time_s
        Middle of each block [s].
    speed_hz
        Mean speed of each block [Hz].
    amplitude
        Peak amplitude, in the unit of each channel; the phase is that of a cosine at the
        first pulse of the tacho.
    sd
        Standard deviation of the complex error, by the residual at orders beside.
    """

    order: Float[np.ndarray, " order"]
    time_s: Float[np.ndarray, " block"]
    speed_hz: Float[np.ndarray, " block"]
    amplitude: Complex[np.ndarray, "block order channel"]
    sd: Float[np.ndarray, "block order channel"]


def resample_to_angle(
    samples: Float[np.ndarray, "time channel"], rate_hz: float, rotation: Rotation
) -> tuple[Float[np.ndarray, "angle channel"], int]:
    """Resample a record to equal steps of shaft angle.

    Parameters
    ----------
    samples
        Equally spaced in time.
    rate_hz
        Sampling rate [Hz].
    rotation
        Angle of the shaft.

    Returns
    -------
    Samples from the first pulse on, and their number in a revolution: as many as at the
    lowest speed, so that nothing folds back.
    """
    slowest = float(rotation.speed_hz(rotation.time_s).min())
    per_revolution = int(2 ** math.ceil(math.log2(rate_hz / slowest)))
    count = int(rotation.revolutions[-1] * per_revolution)
    at = rotation.times(np.arange(count) / per_revolution) * rate_hz
    return at_instants(samples.T, at).T, per_revolution


def track_orders(
    samples: Float[np.ndarray, "time channel"],
    rate_hz: float,
    rotation: Rotation,
    orders: Sequence[float],
    *,
    revolutions: int = REVOLUTIONS,
) -> Orders:
    """Fit the amplitudes of orders to a record, block by block.

    Parameters
    ----------
    samples
        Equally spaced in time.
    rate_hz
        Sampling rate [Hz].
    rotation
        Angle of the shaft.
    orders
        Multiples of the speed; those close to each other need many revolutions.
    revolutions
        Of a block; blocks overlap by half.

    Returns
    -------
    Amplitudes.

    Raises
    ------
    ValueError
        Where the record has fewer revolutions than a block, or orders cannot be told apart.
    """
    wanted = np.asarray(sorted(orders), dtype=float)
    _check(wanted, rotation, revolutions, rate_hz)
    angle, per_revolution = resample_to_angle(samples, rate_hz, rotation)
    size = revolutions * per_revolution
    turn = np.arange(size) / per_revolution
    waves = np.exp(2j * np.pi * np.outer(turn, wanted))
    design = np.concatenate([waves.real, -waves.imag, np.ones((size, 1))], axis=1)
    inverse = np.linalg.pinv(design)
    beside = wanted[:, None] + np.array(PROBES) / revolutions
    probes = np.exp(-2j * np.pi * turn[:, None, None] * beside) * (2 / size)
    starts = np.arange(0, len(angle) - size + 1, size // 2)
    amplitude, sd = [], []
    for start in starts:
        block = angle[start : start + size]
        found = inverse @ block
        left = block - design @ found
        count = len(wanted)
        turned = np.exp(-2j * np.pi * wanted * start / per_revolution)[:, None]
        amplitude.append((found[:count] + 1j * found[count : 2 * count]) * turned)
        power = np.abs(np.einsum("tkp,tc->kpc", probes, left)) ** 2
        sd.append(np.sqrt(power.mean(axis=1)))
    edges = np.stack([starts, starts + size]) / per_revolution
    time = rotation.times(edges)
    return Orders(
        order=wanted,
        time_s=time.mean(axis=0),
        speed_hz=revolutions / np.diff(time, axis=0)[0],
        amplitude=np.stack(amplitude),
        sd=np.stack(sd),
    )


def _check(wanted: np.ndarray, rotation: Rotation, revolutions: int, rate_hz: float) -> None:
    turned = float(rotation.revolutions[-1])
    if not 1 <= len(wanted) <= PIECES or wanted[0] <= 0:
        raise ValueError(
            f"Orders {wanted.tolist()} were given. Allowed are 1 to {PIECES} positive ones."
        )
    if not 1 <= revolutions <= turned:
        raise ValueError(
            f"{revolutions=} of a block were asked for, and the shaft turned {turned:.4g} "
            "times. Give fewer, or a longer record."
        )
    if len(wanted) > 1 and np.diff(wanted).min() * revolutions < 1:
        raise ValueError(
            f"Orders {np.diff(wanted).min():g} apart cannot be told apart in {revolutions} "
            f"revolutions. Give at least {math.ceil(1 / np.diff(wanted).min())}."
        )
    fastest = float(rotation.speed_hz(rotation.time_s).max())
    if wanted[-1] * fastest > 0.45 * rate_hz:
        raise ValueError(
            f"Order {wanted[-1]:g} is at {wanted[-1] * fastest:.4g} Hz at the highest speed, "
            f"beyond 0.45 of the sampling rate of {rate_hz:g} Hz. Leave it out, or sample "
            "faster."
        )
