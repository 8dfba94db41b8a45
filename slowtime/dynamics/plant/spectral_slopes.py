r"""Derivatives of a linear plant's readings, by spectra: for plants of many coordinates.

A constant :math:`\theta` changes the motion as a force would,

.. math:: M s'' + C s' + K s = - (\partial_\theta M \, a + \partial_\theta C \, \dot q
          + \partial_\theta K \, q) ,

with the acceleration a in space. Its periodic response follows from the modes, line by line;
that begins with a state which the real one does not have, so its free decay is subtracted.
Between samples the force is interpolated in the band, so that derivatives differ from those of
the motion computed by its aliases: by some thousandths where the motion is sampled finely, and
by more at the ends of a record.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Complex, Float
from scipy.fft import next_fast_len

from slowtime.dynamics.description import Description, Matrix
from slowtime.dynamics.effects import Effect, Hidden, Kind
from slowtime.dynamics.elements import ROTATION
from slowtime.dynamics.work import count_work

from .matrices import MatrixParts
from .parameter_names import Name
from .sensing import SensorReadout, sensor_readouts
from .simulation_run import PlantRun
from .system_cache import is_linear

LEAST_COORDINATES = 26
"""[coordinates] Of a reduced model, from which on derivatives are computed by spectra. Source:
with fewer, time stepping with exact derivatives is as fast."""
JOIN_SAMPLES = 64
"""[samples] Behind a record, in which its end is joined to its beginning. Source: of a chain of
200 masses, derivatives are then right to a part in a thousand within a record, and to 3 % at
the median over whole ones, for the ends; without, to a tenth."""
MAX_MODE_CONDITION = 1e8
"""[1] Condition number of the modal matrix up to which modes are used. Source: leaves eight
digits, more than derivatives need."""

Slopes = Float[np.ndarray, "time sensor slope"]
Square = Float[np.ndarray, "state state"]


def has_spectral_slopes(
    description: Description,
    effects: Sequence[Effect],
    kinds: Mapping[str, Kind],
    matrices: MatrixParts,
    free: Sequence[Name],
) -> bool:
    """Whether all is linear, driven by forces or the base alone, and read by plain sensors."""
    # Of reduced models only, whose motion is sampled finely: their modes end at the band of the
    # records.
    return (
        any(isinstance(part, Matrix) for part in description.elements)
        and len(matrices.names) >= LEAST_COORDINATES
        and not matrices.moved
        and not matrices.gauges
        and all(isinstance(kinds[one.kind].action, Hidden) for one in effects)
        and all(is_linear(name, matrices) for name in free)
    )


def spectral_slopes(
    description: Description,
    kinds: Sequence[Kind],
    matrices: MatrixParts,
    values: Mapping[Name, float],
    run: PlantRun,
    rate_hz: float,
    free: Sequence[Name],
) -> Slopes | None:
    """Differentiate a run's readings to free parameters and to the first state.

    The run is that of the plant at these values, without derivatives. None where modes do not
    span all motion.
    """
    count = len(matrices.names)
    mass, damping, stiffness = matrices.at(values, list(kinds))[:, :count, :count]
    inverse = np.linalg.inv(mass)
    state = np.block(
        [[np.zeros((count, count)), np.eye(count)], [-inverse @ stiffness, -inverse @ damping]]
    )
    poles, modes = np.linalg.eig(state)
    if not np.linalg.cond(modes) < MAX_MODE_CONDITION:
        return None
    readouts = sensor_readouts(description, matrices.names)
    rows = _rows(readouts, state)
    decays = _free_decays(modes, np.exp(poles / rate_hz), rows, len(run.times))
    samples = len(run.times)
    length = next_fast_len(samples + JOIN_SAMPLES, real=True)
    forces = _forces(matrices, list(kinds), values, run, free, length)
    pushed = np.linalg.inv(modes)[:, count:] @ inverse
    s = 2j * np.pi * np.fft.rfftfreq(length, 1 / rate_hz)
    # An undamped mode may have its pole on a line; one part in 1e9 moves it away.
    gains = 1 / (s[:, None] - poles * (1 + 1e-9) + 1e-300)
    factors = np.array([one.factor for one in readouts])
    orders = np.array([one.order for one in readouts])
    read = _coordinates(readouts, count) @ modes[:count]
    response = (gains[:, None, :] * read) @ pushed
    response *= (factors * s[:, None] ** orders)[:, :, None]
    found = np.concatenate(
        [_forced(response, forces, length)[:samples], decays * factors[:, None]], axis=2
    )
    begun = _first_states(modes, gains, pushed, forces, length)
    found[:, :, : len(free)] -= found[:, :, len(free) :] @ begun
    count_work(int(found.size * len(state)))
    return found


def _coordinates(
    readouts: Sequence[SensorReadout], count: int
) -> Float[np.ndarray, "sensor coordinate"]:
    found = np.zeros((len(readouts), count))
    for row, one in zip(found, readouts, strict=True):
        if one.coordinate is not None:
            row[one.coordinate] = 1.0
    return found


def _rows(
    readouts: Sequence[SensorReadout], state: Square
) -> Float[np.ndarray, "sensor state"]:
    """Row that each sensor reads of a free state."""
    count = len(state) // 2
    motion = np.concatenate([np.eye(2 * count), state[count:]])
    found = np.zeros((len(readouts), 2 * count))
    for row, one in zip(found, readouts, strict=True):
        if one.coordinate is not None:
            row[:] = motion[one.order * count + one.coordinate]
    return found


def _free_decays(
    modes: Complex[np.ndarray, "state mode"],
    steps: Complex[np.ndarray, " mode"],
    rows: Float[np.ndarray, "sensor state"],
    samples: int,
) -> Slopes:
    """Compute readings from each unit first state, by rows (time, sensor, state)."""
    step = ((modes * steps) @ np.linalg.inv(modes)).real
    found = np.empty((samples, *rows.shape))
    now = rows
    for k in range(samples):
        found[k] = now
        now = now @ step
    return found


def _forces(
    matrices: MatrixParts,
    kinds: list[Kind],
    values: Mapping[Name, float],
    run: PlantRun,
    free: Sequence[Name],
    length: int,
) -> Complex[np.ndarray, "frequency coordinate parameter"]:
    """Spectra of the forces that stand for a unit of each parameter."""
    count = len(matrices.names)
    carried = np.array([not name.endswith(ROTATION) for name in matrices.names], dtype=float)
    motion = [run.rates[:, count : 2 * count], run.states[:, count : 2 * count],
              run.states[:, :count]]  # fmt: skip
    lines = [np.fft.rfft(_closed(one, length), axis=0) for one in motion]
    base = np.fft.rfft(_closed(run.base[:, None], length)[:, 0])
    found = np.zeros((len(base), count, len(free)), dtype=complex)
    for i, name in enumerate(free):
        slope = matrices.slope(name, values, kinds)
        for one, along in zip(slope, lines, strict=True):
            own = one[:count, :count]
            if own.any():
                found[:, :, i] -= along @ own.T
        load = slope[0, :count, :count] @ carried + slope[0, :count, count]
        if load.any() and base.any():
            found[:, :, i] -= np.multiply.outer(base, load)
    return found


def _closed(
    series: Float[np.ndarray, "time column"], length: int
) -> Float[np.ndarray, "longer column"]:
    """Continue series smoothly to where they began: periodic, and without a jump."""
    # Both ends are continued by odd reflection, and one fades into the other. What comes after
    # the record changes nothing within it.
    more = length - len(series)
    ahead = 2 * series[-1] - series[-2 : -2 - more : -1]
    back = 2 * series[0] - series[more:0:-1]
    share = (np.arange(1, more + 1) / (more + 1))[:, None]
    fade = share**3 * (10 - 15 * share + 6 * share**2)
    return np.concatenate([series, (1 - fade) * ahead + fade * back])


def _forced(
    response: Complex[np.ndarray, "frequency sensor coordinate"],
    forces: Complex[np.ndarray, "frequency coordinate parameter"],
    samples: int,
) -> Slopes:
    """Periodic readings that forces make."""
    return np.asarray(np.fft.irfft(response @ forces, samples, axis=0))


def _first_states(
    modes: Complex[np.ndarray, "state mode"],
    gains: Complex[np.ndarray, "frequency mode"],
    pushed: Complex[np.ndarray, "mode coordinate"],
    forces: Complex[np.ndarray, "frequency coordinate parameter"],
    samples: int,
) -> Float[np.ndarray, "state parameter"]:
    """First state of the periodic motion that forces make."""
    twice = np.full(len(gains), 2.0)
    twice[0] = 1.0
    if samples % 2 == 0:
        twice[-1] = 1.0
    weighted = (gains * twice[:, None]).T @ forces.reshape(len(forces), -1)
    moved = np.einsum("mc,mcp->mp", pushed, weighted.reshape(*pushed.shape, -1))
    return np.asarray((modes @ moved).real / samples)
