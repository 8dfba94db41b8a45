"""Identification of modes from a record: the method is chosen by the kind of record."""

import dataclasses
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.estimates import Identified
from slowtime.identification.free_decay.along_decay import along_decay
from slowtime.identification.methods import by_method
from slowtime.identification.modes import Mode
from slowtime.identification.options import (
    ALL_CHANNELS,
    AllChannels,
    IdentifyOptions,
    OneByOne,
    Selection,
)
from slowtime.identification.single_mode.estimation import all_modes
from slowtime.identification.single_mode.excitation import Excitation, excitation
from slowtime.identification.single_mode.machine_lines import (
    ModesAndLines,
    modes_and_machine_lines,
)
from slowtime_services.files import Record

from .losses import completed, widened
from .selection_file import read_selection

F = TypeVar("F", Identified, Mode)
Samples = np.ndarray[Any, Any]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordModes:
    """What a record tells of its modes.

    Parameters
    ----------
    single
        Modes of single channels, with lines of machines; empty where `whole` is given.
    whole
        Modes of all channels together; None where they were identified one by one.
    method
        Method that was asked for; `modes` where all channels were used unasked.
    force
        What the record says of its excitation.
    record
        The record, its missing samples dealt with.
    part
        Samples that were used, the longest part without a gap [time, channel].
    selection
        Edits of the automatic choice; None for none.
    note
        What was done about missing samples; empty where nothing was missing.
    """

    single: ModesAndLines
    whole: ModalResult | None
    method: str
    force: Excitation
    record: Record
    part: Samples
    selection: Selection | None
    note: str

    @property
    def duration_s(self) -> float:
        """Duration of the samples that were used [s]."""
        return len(self.part) / self.record.rate_hz


def identify_record(record: Record, options: IdentifyOptions) -> RecordModes:
    """Identify modes one by one, or of all channels together.

    With the method ``auto``, a record of many channels that is not explained by free decays is
    taken as the response to an unknown steady random force. Where the force plainly was none
    (`Excitation.flags`), only free decays are returned.

    Parameters
    ----------
    record
        Record, with gaps.
    options
        Band, method, treatment of gaps, choice by hand.

    Returns
    -------
    Modes, with standard deviations that hold the loss of samples.

    Raises
    ------
    ValueError
        Where the record is too short for the band, the band is outside what was measured, or an
        edit names no mode or pole.
    """
    chosen = options.select
    selection = (
        chosen
        if chosen is None or isinstance(chosen, Selection)
        else read_selection(Path(chosen))
    )
    given = completed(record, options.gaps)
    samples = np.asarray(given.record.samples, dtype=float)
    first, last, _ = max(stretches(given.record), key=lambda one: one[1] - one[0])
    part, rate_hz = samples[first:last], record.rate_hz
    force = excitation(part, rate_hz)
    if force.flags and options.method == "auto":
        decays = all_modes(part, rate_hz, band_hz=options.band_hz)
        single = ModesAndLines(tuple(mode for mode in decays if is_decay(mode)), (), ())
        whole = None
    else:
        single, whole = _by_method(part, rate_hz, options, selection)
    along = tuple(_along(mode, part, rate_hz) for mode in single.modes)
    inflation = given.inflation(0, len(part))
    single, whole = widened(
        dataclasses.replace(single, modes=along), whole, inflation, given.flags
    )
    if whole is not None:
        whole = dataclasses.replace(
            whole, modes=tuple(_flagged(mode, force) for mode in whole.modes)
        )
    if options.method != "auto":
        single = dataclasses.replace(
            single, modes=tuple(_flagged(mode, force) for mode in single.modes)
        )
    return RecordModes(
        single=single,
        whole=whole,
        method="modes" if whole is not None and options.method == "auto" else options.method,
        force=force,
        record=given.record,
        part=part,
        selection=selection,
        note=given.note,
    )


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
    part: Samples, rate_hz: float, options: IdentifyOptions, selection: Selection | None
) -> tuple[ModesAndLines, ModalResult | None]:
    """Modes by the method requested, or by the one that suits the record."""
    band_hz = options.band_hz
    if options.method in ALL_CHANNELS:
        joint = cast(AllChannels, options.method)
        return ModesAndLines((), (), ()), by_method(
            part, rate_hz, method=joint, band_hz=band_hz, selection=selection
        )
    method = cast(OneByOne, options.method)
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
