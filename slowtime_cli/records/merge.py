"""The verb `merge`: merges the modes of several sensor set-ups."""

import math
from collections.abc import Sequence
from pathlib import Path

from slowtime_api.mode_sets.merging import MergedModes, merge, merge_signals
from slowtime_api.signals import Signals
from slowtime_cli.shared.record_input import note_reading, read_any
from slowtime_cli.shared.terminal import counting, note, show
from slowtime_services.files import ReadingOptions

from .modes_file import write_modes_file


def merge_setups(
    files: Sequence[Path],
    references: tuple[str, ...] | None,
    before: bool,
    rate_hz: float | None,
    band_hz: tuple[float, float] | None,
    out: Path | None,
) -> None:
    """Merge modes files, or records before their modes are identified.

    Raises
    ------
    ValueError
        Where set-ups share no reference channel.
    """
    if before:
        assert band_hz is not None
        signals = [_read(path, rate_hz) for path in files]
        with counting("Identifying"):
            found = merge_signals(
                signals, band_hz, references=references, names=[path.name for path in files]
            )
    else:
        found = merge(list(files), references=references)
    for said in found.notes:
        note(said)
    if out is not None:
        write_modes_file(out, found.document(), None, "")
    _show(found)


def _read(path: Path, rate_hz: float | None) -> Signals:
    record = read_any(path, ReadingOptions(rate_hz=rate_hz))
    note_reading(record)
    return Signals.from_record(record)


def _show(found: MergedModes) -> None:
    """Print modes, each with the number of its set-ups and of its channels."""
    cells = []
    for mode, setups, channels in found.table():
        f, z = mode.frequency_hz, mode.damping_ratio
        damped = math.isfinite(z.value)
        cells.append(
            (
                f"{f.value:.4f} ± {f.sd:.4f}",
                f"{100 * z.value:.3f} ± {100 * z.sd:.3f}" if damped else "",
                f"{setups} of {found.setups}",
                str(channels),
                ", ".join(mode.flags),
            )
        )
    heads = ("frequency [Hz]", "damping [%]", "set-ups [1]", "channels [1]", "mistrust")
    show("Modes of the structure", heads, cells, plain=found.rows())
