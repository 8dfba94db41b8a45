"""Judges modes that stand where machines have their lines.

A line that wanders leaves a residue when it is removed, and a multiple of a speed may be too
weak to be detected by itself. Both resemble a mode of little damping: no estimator of modes can
tell, for it knows of no machine.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from slowtime.identification.estimates import Measured

from .detection import FALSE_ALARM_AT_A_MULTIPLE, LEAST_DAMPING, MULTIPLE_BINS
from .families import HarmonicFamily

Verdict = Literal["mode", "doubtful", "harmonic"]

FLAG = "beside_a_line"
"""Flag of modes that the residue of a line may be."""

BESIDE_BINS = 3.0
"""Distance of a line from a mode's half-power band within which the mode is flagged [bins].
Source: three bins away the main lobe of a tapered tone ends."""


@dataclasses.dataclass(frozen=True, slots=True)
class MachineLines:
    """Lines of machines in a record.

    Parameters
    ----------
    lines_hz
        Frequencies of all lines found [Hz].
    families
        Speeds of machines that these are multiples of.
    """

    lines_hz: Sequence[Measured]
    families: Sequence[HarmonicFamily]
    duration_s: float

    def judge(self, frequency_hz: Measured, damping_ratio: Measured) -> Verdict:
        """Judge what was fitted as a mode.

        Returns
        -------
        `harmonic` where a multiple of a machine's speed is within the errors and damping may be
        none; `doubtful` where a line, or such a multiple, is in the half-power band or next to
        it; otherwise `mode`. A multiple counts only where a mode anywhere else would be so near
        one with a probability below `FALSE_ALARM_AT_A_MULTIPLE`.
        """
        value = frequency_hz.value
        multiple = self._nearest_multiple(value)
        doubt = 2 * float(np.hypot(frequency_hz.sd, multiple.sd))
        on_multiple = abs(value - multiple.value) < MULTIPLE_BINS / self.duration_s + doubt
        # Written so that NaN is no evidence of a line.
        if on_multiple and damping_ratio.value - 2 * damping_ratio.sd <= LEAST_DAMPING:
            return "harmonic"
        half_width = 0.0 if np.isnan(damping_ratio.value) else damping_ratio.value * value
        reach = half_width + BESIDE_BINS / self.duration_s
        places = (*self.lines_hz, multiple)
        beside = any(abs(place.value - value) <= reach for place in places)
        return "doubtful" if beside else "mode"

    def _nearest_multiple(self, frequency_hz: float) -> Measured:
        """Multiple of a speed that is not so near by chance; infinite if there is none."""
        nearest = Measured(np.inf, 0.0)
        for family in self.families:
            base = family.base_hz
            order = max(1, round(frequency_hz / base.value))
            multiple = Measured(order * base.value, order * base.sd)
            off = abs(frequency_hz - multiple.value)
            rare = 2 * off / base.value < FALSE_ALARM_AT_A_MULTIPLE
            if rare and off < abs(frequency_hz - nearest.value):
                nearest = multiple
        return nearest
