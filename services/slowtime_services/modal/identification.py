"""Identification of modes from a record: the method is chosen by the kind of record."""

import dataclasses
from typing import Any, Literal, TypeVar

import numpy as np

from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.estimates import Identified
from slowtime.identification.free_decay.along_decay import along_decay
from slowtime.identification.methods import by_method
from slowtime.identification.modes import Mode
from slowtime.identification.selection import Selection
from slowtime.identification.single_mode.estimation import all_modes
from slowtime.identification.single_mode.excitation import Excitation
from slowtime.identification.single_mode.machine_lines import (
    ModesAndLines,
    modes_and_machine_lines,
)
from slowtime_services.files import Record

F = TypeVar("F", Identified, Mode)
Samples = np.ndarray[Any, Any]
Method = Literal["auto", "modes", "bayes", "efdd", "fdd", "ambient", "free_decay", "peak"]
ALL_CHANNELS = ("modes", "bayes", "efdd", "fdd")
"""Methods that find the modes of all channels together, with shapes."""


def identify_part(
    samples: Samples,
    rate_hz: float,
    band_hz: tuple[float, float] | None,
    method: Any,
    force: Excitation,
    selection: Selection | None = None,
) -> tuple[ModesAndLines, ModalResult | None]:
    """Identify modes one by one, or of all channels together.

    With the method ``auto``, a record of many channels that is not explained by free decays is
    taken as the response to an unknown steady random force. Where the force plainly was none
    (`Excitation.flags`), only free decays are returned.

    Parameters
    ----------
    samples
        Record without gaps [time, channel].
    rate_hz
        Sampling rate [Hz].
    band_hz
        Band of the modes [Hz]; None for all that the record can show.
    method
        ``"auto"``, ``"modes"``, ``"bayes"``, ``"efdd"``, ``"fdd"``, ``"ambient"``,
        ``"free_decay"`` or ``"peak"``.
    force
        What the record says of its excitation.
    selection
        A person's edits of the automatic choice, of methods ``modes`` and ``bayes``.

    Returns
    -------
    Modes of single channels with lines of machines, and the result over all channels or None;
    where the second is given, the first is empty.
    """
    nothing = ModesAndLines((), (), ())
    if force.flags and method == "auto":
        found = all_modes(samples, rate_hz, band_hz=band_hz)
        decays = tuple(_along(m, samples, rate_hz) for m in found if is_decay(m))
        return dataclasses.replace(nothing, modes=decays), None
    single, whole = _by_method(samples, rate_hz, band_hz, method, selection)
    single = dataclasses.replace(
        single, modes=tuple(_along(mode, samples, rate_hz) for mode in single.modes)
    )
    if force.flags and whole is not None:
        modes = tuple(_flagged(mode, force) for mode in whole.modes)
        whole = dataclasses.replace(whole, modes=modes)
    if force.flags:
        single = dataclasses.replace(
            single, modes=tuple(_flagged(m, force) for m in single.modes)
        )
    return single, whole


def is_decay(mode: Identified) -> bool:
    """Return whether a mode was read off a free decay, with a damping that is significant."""
    damping = mode.damping_ratio
    return mode.method == "free_decay" and damping.value > 2 * damping.sd


def _along(mode: Identified, samples: Samples, rate_hz: float) -> Identified:
    """State the damping of a free decay with its range, where it depends on amplitude."""
    return along_decay(mode, samples, rate_hz)[0] if is_decay(mode) else mode


def _flagged(mode: F, force: Excitation) -> F:
    """Add flags of the force to those of a mode, once."""
    new: tuple[str, ...] = tuple(f for f in force.flags if f not in mode.flags)
    return dataclasses.replace(mode, flags=(*mode.flags, *new))


def _by_method(
    part: Samples,
    rate_hz: float,
    band_hz: tuple[float, float] | None,
    method: Any,
    selection: Selection | None,
) -> tuple[ModesAndLines, ModalResult | None]:
    """Modes by the method requested, or by the one that suits the record."""
    if method in ALL_CHANNELS:
        return ModesAndLines((), (), ()), by_method(
            part, rate_hz, method=method, band_hz=band_hz, selection=selection
        )
    if method == "auto" and part.shape[1] == 1:
        return modes_and_machine_lines(part, rate_hz, band_hz=band_hz), None
    modes = ModesAndLines(all_modes(part, rate_hz, band_hz=band_hz, method=method), (), ())
    decays = bool(modes.modes) and all(mode.method == "free_decay" for mode in modes.modes)
    if method != "auto" or decays:
        return modes, None
    whole = identify_modes(part, rate_hz, band_hz=band_hz)
    return (modes, None) if not whole.modes else (ModesAndLines((), (), ()), whole)


def stretches(record: Record) -> list[tuple[int, int, int]]:
    """Return first row, last row and missing rows before, of each part without a gap."""
    starts = [0, *(gap.row for gap in record.gaps), len(record.samples)]
    lost = np.cumsum([0, *(gap.missing for gap in record.gaps)])
    return [
        (a, b, int(missing))
        for a, b, missing in zip(starts[:-1], starts[1:], lost, strict=True)
    ]
