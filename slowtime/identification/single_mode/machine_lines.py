"""Separate modes of a record whose machine lines are removed first."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.identification import checks
from slowtime.identification.estimates import Identified, Measured
from slowtime.identification.free_decay.estimation import FRONT_SHARE
from slowtime.identification.harmonics.beside_lines import FLAG, MachineLines
from slowtime.identification.harmonics.detection import LEAST_DAMPING, PeakClass, find_harmonics
from slowtime.identification.harmonics.families import HarmonicFamily
from slowtime.identification.harmonics.periodic_force import without_periodic_force
from slowtime.identification.harmonics.tones import remove_lines
from slowtime.identification.options import OneByOne

from .estimation import all_modes

DECIDABLE_BINS = 0.1
"""Half-bandwidth of the least damped mode above which a record distinguishes it from a line
[bins]."""

LINE = "harmonic"
"""Method name of a machine line in the results; its damping ratio is 0."""


@dataclasses.dataclass(frozen=True, slots=True)
class ModesAndLines:
    """Modes, ascending; lines of machines; and the speeds that these are multiples of."""

    modes: tuple[Identified, ...]
    lines: tuple[Identified, ...]
    families: tuple[HarmonicFamily, ...]


def modes_and_machine_lines(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    method: OneByOne = "auto",
) -> ModesAndLines:
    """Find separate modes after the removal of machine lines; see `all_modes`.

    A record that begins with a blow is left as it is: its decays are no lines, however slow.

    Parameters
    ----------
    samples, rate_hz, band_hz, method
        As in `all_modes`.

    Returns
    -------
    Modes, lines, and families of lines.
    """
    columns = checks.series(samples, rate_hz)
    if _struck(columns):
        return ModesAndLines(
            all_modes(columns, rate_hz, band_hz=band_hz, method=method), (), ()
        )
    found, families = find_harmonics(columns, rate_hz)
    everywhere, periods = without_periodic_force(found, rate_hz / len(columns))
    families = families if periods == 1 else ()
    low, high = checks.band(band_hz, rate_hz, len(columns))
    tones = tuple(line.frequency_hz for line in everywhere)
    cleaned = remove_lines(columns, rate_hz, tones) if tones else columns
    duration = len(columns) / rate_hz
    machines = MachineLines(tones, families, duration)
    modes: list[Identified] = []
    lines = [_line(v, duration) for v in everywhere if low <= v.frequency_hz.value <= high]
    for mode in all_modes(cleaned, rate_hz, band_hz=band_hz, method=method):
        if everywhere and is_undamped(mode, duration):
            continue
        verdict = machines.judge(mode.frequency_hz, mode.damping_ratio)
        if verdict == "harmonic":
            lines.append(
                dataclasses.replace(
                    mode, damping_ratio=Measured(0.0, 0.0), correlation=0.0, method=LINE
                )
            )
        elif verdict == "doubtful":
            modes.append(dataclasses.replace(mode, flags=(*mode.flags, FLAG)))
        else:
            modes.append(mode)
    lines.sort(key=lambda line: line.frequency_hz.value)
    return ModesAndLines(tuple(modes), tuple(lines), families)


def _line(verdict: PeakClass, duration_s: float) -> Identified:
    """Put the line of a machine as a mode without damping."""
    return Identified(
        frequency_hz=verdict.frequency_hz,
        damping_ratio=Measured(0.0, 0.0),
        correlation=0.0,
        snr_db=verdict.snr_db,
        amplitude=verdict.amplitude,
        method=LINE,
        span_s=(0.0, duration_s),
    )


def is_undamped(mode: Identified, duration_s: float) -> bool:
    """Whether the damping of a mode is significantly below that of any structure.

    Parameters
    ----------
    mode
        Fitted mode.
    duration_s
        Duration of the record [s].

    Returns
    -------
    True if it is undamped.
    """
    damping = mode.damping_ratio
    decidable = LEAST_DAMPING * mode.frequency_hz.value * duration_s > DECIDABLE_BINS
    return decidable and damping.value + 2 * damping.sd < LEAST_DAMPING


def _struck(columns: Float[np.ndarray, "time channel"]) -> bool:
    power = np.sum((columns - columns.mean(axis=0)) ** 2, axis=1)
    return bool(power[: len(power) // 2].sum() > FRONT_SHARE * power.sum())
