"""The verb `merge`: merges the modes of several sensor set-ups."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.merging import MergedMode, SetUp, merge
from slowtime.identification.modes import Mode
from slowtime_cli.shared.terminal import note, show
from slowtime_schemas.files.modes import FoundMode, ModesFile
from slowtime_services.documents.bounds import RESULT, DocumentError
from slowtime_services.documents.document_files import read_checked_json

from .merge_before import merged_records
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
        _merge_records(files, references, rate_hz, band_hz, out)
        return
    read = [_read(path) for path in files]
    setups = [SetUp(modes=_modes(one), channels=one.channels) for one in read]
    found = merge(setups, references)
    if not found:
        raise click.UsageError(
            "The set-ups have no structural mode in common. Check the modes file of each "
            "set-up."
        )
    channels = max((mode.channels for mode in found), key=len)
    whole = [mode for mode in found if mode.channels == channels]
    for mode in found:
        if mode.channels != channels:
            note(
                f"{mode.mode.frequency_hz.value:.4g} Hz was found in "
                f"{len(mode.setups)} of {len(files)} set-ups, and is left out of the file."
            )
    if out is not None:
        write_modes_file(out, _body(read, whole, channels), None, "")
    _show([(one.mode, len(one.setups), len(one.channels)) for one in found], files)


def _merge_records(
    files: Sequence[Path],
    references: tuple[str, ...] | None,
    rate_hz: float | None,
    band_hz: tuple[float, float],
    out: Path | None,
) -> None:
    """Identify all records at once, print the modes and write them."""
    found, heading = merged_records(files, references, rate_hz, band_hz)
    if not found.modes:
        raise click.UsageError(
            "No mode stands out from the noise. Give longer records, or another --band-hz."
        )
    if out is not None:
        span = (0.0, heading["duration_s"])
        body = heading | {"modes": [_merged(mode, span) for mode in found.modes]}
        write_modes_file(out, body, None, "")
    count = len(heading["channels"])
    rows = [(mode, len(files), count) for mode in found.modes]
    rows += [(one.mode, len(one.setups), len(one.channels)) for one in found.partial]
    _show(sorted(rows, key=lambda row: row[0].frequency_hz.value), files)


def modes_of_file(path: Path) -> tuple[tuple[str, ...], list[Mode]]:
    """Read channels and modes with shapes of a modes file of a whole record.

    Raises
    ------
    click.UsageError
        Where it is another file, or has no shapes.
    """
    found = _read(path)
    return tuple(found.channels), _modes(found)


def _read(path: Path) -> ModesFile:
    try:
        found = read_checked_json(path, ModesFile, RESULT)
    except DocumentError as error:
        raise click.UsageError(
            f"{path.name} is not a valid modes file ({error!s:.400}). Give what "
            "`slowtime identify "
            "RECORD --method modes --out modes.json` wrote."
        ) from None
    if found.modes is None:
        raise click.UsageError(
            f"{path.name} holds modes for each window of a record. Give modes of whole records."
        )
    if all(mode.shape is None for mode in found.modes):
        raise click.UsageError(
            f"{path.name} holds no shapes. Identify with --method modes and several channels."
        )
    return found


def _modes(found: ModesFile) -> list[Mode]:
    return [_mode(mode) for mode in found.modes or () if mode.shape is not None]


def _mode(mode: FoundMode) -> Mode:
    assert mode.shape is not None
    return Mode(
        frequency_hz=Measured(mode.frequency_hz.value, mode.frequency_hz.sd),
        damping_ratio=Measured(mode.damping_ratio.value, mode.damping_ratio.sd),
        correlation=mode.correlation,
        shape=np.array(mode.shape.re) + 1j * np.array(mode.shape.im),
        shape_sd=np.array(mode.shape.sd),
        kind=mode.kind,
        quality=1.0 if mode.quality is None else mode.quality,
        flags=tuple(mode.flags),
    )


def _body(
    read: Sequence[ModesFile], whole: Sequence[MergedMode], channels: tuple[str, ...]
) -> dict[str, Any]:
    span = (0.0, max(one.duration_s for one in read))
    return {
        "slowtime_modes": 1,
        "record": " + ".join(one.record for one in read)[:200],
        "rate_hz": min(one.rate_hz for one in read),
        "channels": list(channels),
        "duration_s": span[1],
        "modes": [_merged(one.mode, span) for one in whole],
    }


def _merged(mode: Mode, span: tuple[float, float]) -> dict[str, Any]:
    return {
        "frequency_hz": {"value": mode.frequency_hz.value, "sd": mode.frequency_hz.sd},
        "damping_ratio": {"value": mode.damping_ratio.value, "sd": mode.damping_ratio.sd},
        "correlation": mode.correlation,
        "shape": {
            "re": mode.shape.real.tolist(),
            "im": mode.shape.imag.tolist(),
            "sd": mode.shape_sd.tolist(),
        },
        "kind": mode.kind,
        "quality": mode.quality,
        "snr_db": None,
        "method": "merged",
        "span_s": list(span),
        "flags": list(mode.flags),
    }


def _show(found: Sequence[tuple[Mode, int, int]], files: Sequence[Path]) -> None:
    """Print modes, each with the number of its set-ups and of its channels."""
    rows, plain = [], []
    for mode, setups, channels in found:
        f, z = mode.frequency_hz, mode.damping_ratio
        damped = math.isfinite(z.value)
        flags = ", ".join(mode.flags)
        rows.append(
            (
                f"{f.value:.4f} ± {f.sd:.4f}",
                f"{100 * z.value:.3f} ± {100 * z.sd:.3f}" if damped else "",
                f"{setups} of {len(files)}",
                str(channels),
                flags,
            )
        )
        plain.append(
            {
                "frequency_hz": f.value,
                "frequency_sd": f.sd,
                "damping_ratio": z.value if damped else None,
                "damping_sd": z.sd if damped else None,
                "setups": setups,
                "channels": channels,
                "flags": flags,
            }
        )
    heads = ("frequency [Hz]", "damping [%]", "set-ups [1]", "channels [1]", "mistrust")
    show("Modes of the structure", heads, rows, plain=plain)
