"""The verb `identify` on a long file, which is read in pieces."""

import contextlib
import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult, join_stabilisation
from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Mode
from slowtime.identification.options import IdentifyOptions
from slowtime.identification.recursive import RecursiveModes
from slowtime.signals.block import Block, RateCorrection
from slowtime.signals.clock.joint_correction import joint_correction
from slowtime_cli.shared.declared import gathered
from slowtime_cli.shared.record_input import note_reading, overridden_by_flags
from slowtime_cli.shared.terminal import counting, note, plural
from slowtime_services.files import (
    ReadingOptions,
    Record,
    RecordError,
    RecordStream,
    accelerations,
    mixed_units,
    open_record,
    streams,
)
from slowtime_services.modal import read_geometry
from slowtime_services.modal.losses import wider
from slowtime_services.modal.stream_losses import StreamLosses
from slowtime_services.replay import measured_rate, raw_blocks

from . import identify as identifying
from . import mode_tables
from .modes_file import write_modes_file

LONG_BYTES = 256 * 2**20
"""Size from which on a file is read as a stream, unless asked otherwise: read whole, one hour
of 16 channels takes six times its size."""

LOWEST_SHARE, HIGHEST_SHARE = 1e-3, 0.45
"""Band that is looked at without --band-hz, in shares of the rate: what is lower would cost
memory, 70 of its cycles."""

METHOD = "recursive"
"""Method that is named in files of modes."""

TEST_FLAGS = (
    "inputs", "excitation", "estimator", "block_s", "decay_s", "driving_points", "frf",
)  # fmt: skip
"""Options of records with measured inputs."""

SINGLE_RECORD_FLAGS = (
    "window_s", "hop_s", "gaps", "method", "second", "start_sd_ms", "rate_sd_ppm",
)  # fmt: skip
"""Options of records without."""

PROGRESS_REPORTS = 24
"""Times that modes are solved for and shown while a file is read [1]."""

MIN_REPORT_S = 600.0
"""Least duration of samples between two such reports [s]."""


def identify(record_path: Path, stream: bool | None, **flags: Any) -> None:
    """Find natural frequencies and damping: of a long file as a stream, else of the whole."""
    test = {name: flags.pop(name) for name in TEST_FLAGS}
    kind = flags.pop("frf_kind")
    if test["inputs"] is None and not stream:
        # Imported here, for most records are in time.
        from . import identify_responses

        if identify_responses.identify(record_path, kind, flags, test):
            return
    if test["inputs"] is not None:
        # Imported here, for most records have no measured input.
        from . import identify_inputs

        for name in SINGLE_RECORD_FLAGS:
            flags.pop(name)
        identify_inputs.identify(record_path=record_path, **flags, **test)
        return
    if stream is None:
        stream = _is_long(record_path, flags)
    if not stream:
        options = gathered(IdentifyOptions, flags)
        identifying.identify(record_path=record_path, options=options, **flags)
        return
    with _opened(record_path, gathered(ReadingOptions, flags)) as opened:
        _identify(record_path, opened, flags)


def _is_long(path: Path, flags: dict[str, Any]) -> bool:
    """Whether a file is long, can be read in pieces, and is asked for no more than modes."""
    whole = flags["window_s"] or flags["report"] or flags["second"] or flags["select"]
    whole = whole or flags["method"] not in ("auto", "modes") or flags["gaps"] != "use"
    kind = path.suffix.lower() == ".mcap" or streams(path)
    if whole or not kind or path.stat().st_size < LONG_BYTES:
        return False
    size = path.stat().st_size / 2**20
    note(f"{path.name} has {size:.0f} MiB and is read as a stream. --whole reads it at once.")
    return True


@contextlib.contextmanager
def _opened(path: Path, given: ReadingOptions) -> Iterator[RecordStream]:
    """Open a file or a recording."""
    if path.suffix.lower() != ".mcap":
        said = {one.name: getattr(given, one.name) for one in dataclasses.fields(given)}
        with open_record(path, **said, skip_missing=True) as opened:
            yield opened
        return
    blocks = (block for _, block in raw_blocks(path))
    first = next(blocks, None)
    if first is None:
        raise RecordError(
            f"{path.name} holds no raw blocks of slowtime. To read a recording of another "
            "program, give --whole."
        )
    head = overridden_by_flags(_record(first), path, given)
    quiet = dataclasses.replace(given, rate_hz=None)

    def all_blocks() -> Iterator[tuple[Block, float]]:
        for block in itertools.chain([first], blocks):
            if block.rate_hz != first.rate_hz or block.channels != first.channels:
                raise RecordError(
                    f"{path.name}: sampling rate or channels change within it, so its "
                    "blocks do not form one record. Give a recording of a single set-up."
                )
            told = overridden_by_flags(_record(block), path, quiet)
            yield (
                dataclasses.replace(
                    block,
                    samples=told.samples,
                    channels=told.channels,
                    units=told.units,
                    rate_hz=head.rate_hz,
                    clock=block.clock if given.rate_hz is None else None,
                ),
                0.0,
            )

    yield RecordStream(head, path.stat().st_size, all_blocks())


def _record(block: Block) -> Record:
    """Make a record of one block."""
    return Record(
        samples=block.samples,
        rate_hz=block.rate_hz,
        channels=block.channels,
        units=block.units,
        start_ns=block.start_ns,
    )


def _identify(path: Path, opened: RecordStream, flags: dict[str, Any]) -> None:
    """Identify a stream from its first block to its last.

    Samples are counted at the nominal rate; frequencies are corrected at the end, when the
    rate is known best.
    """
    head, rate = opened.head, opened.head.rate_hz
    note_reading(head)
    channels = accelerations(head.channels, head.units)
    columns = [head.channels.index(name) for name in channels]
    band = flags["band_hz"] or (LOWEST_SHARE * rate, HIGHEST_SHARE * rate)
    every_s = max(MIN_REPORT_S, _guessed_s(opened) / PROGRESS_REPORTS)
    recursive = RecursiveModes(rate_hz=rate, band_hz=band, every_s=every_s)
    state = recursive.start()
    modes: tuple[Mode, ...] = ()
    clocks: list[tuple[RateCorrection | None, int]] = []
    first, end, due, done = None, 0, every_s, 0.0
    losses = StreamLosses(head)
    with counting("Identifying") as tell:

        def rows() -> Iterator[tuple[int, np.ndarray[Any, Any]]]:
            nonlocal first, done
            for block, share in opened.blocks:
                done = share
                first = block.first_index if first is None else first
                clocks.append((block.clock, len(block.samples)))
                values = np.asarray(block.samples[:, columns], dtype=float)
                yield block.first_index - first, values

        for begin, samples in losses.drawn(rows()):
            end = begin + len(samples)
            state, modes = recursive.step(state, samples, first_index=begin)
            if end / rate >= due:
                due += every_s
                note(f"{end / rate / 3600:.2f} h read: {_listed(modes)}.")
            tell(f"{100 * done:.0f} %, {plural(len(modes), 'mode')} so far")
        modes = recursive.solved(state)
    true_hz, said = measured_rate(rate, joint_correction(clocks))
    opened.end_notes.extend(said)
    opened = dataclasses.replace(opened, head=dataclasses.replace(head, rate_hz=true_hz))
    modes = _scaled(modes, true_hz / rate)
    modes = tuple(wider(mode, losses.inflation, losses.flags) for mode in modes)
    opened.end_notes.extend([losses.note] if losses.note else [])
    _tell(path, opened, channels, end / true_hz, state.lost, modes, flags)


def _scaled(modes: tuple[Mode, ...], ratio: float) -> tuple[Mode, ...]:
    """Scale frequencies from the nominal rate to the true one."""
    return tuple(
        dataclasses.replace(
            mode,
            frequency_hz=Measured(
                mode.frequency_hz.value * ratio, mode.frequency_hz.sd * ratio
            ),
        )
        for mode in modes
    )


def _guessed_s(opened: RecordStream) -> float:
    """Estimate the duration of a record from the sizes of file and samples [s]."""
    row = opened.head.samples.nbytes / max(1, len(opened.head.samples))
    return float(opened.size / row / opened.head.rate_hz)


def _listed(modes: Sequence[Mode]) -> str:
    """Frequencies with their errors, of the lowest few."""
    few = ", ".join(
        f"{mode.frequency_hz.value:.4f} ± {mode.frequency_hz.sd:.4f} Hz" for mode in modes[:4]
    )
    more = ", …" if len(modes) > 4 else ""
    return f"{plural(len(modes), 'mode')}{': ' if modes else ''}{few}{more}"


def _tell(
    path: Path,
    opened: RecordStream,
    channels: tuple[str, ...],
    seconds: float,
    lost: int,
    modes: tuple[Mode, ...],
    flags: dict[str, Any],
) -> None:
    """Print the modes as for a record that is read whole."""
    out, geometry, head = flags["out"], flags["geometry"], opened.head
    left_out = (f"{plural(lost, 'sample')} missing were left out.",) if lost else ()
    said = (*left_out, *opened.end_notes)
    for text in said:
        note(text)
    if not modes:
        note(
            "no mode stands out from the noise. Give a longer record, or a band with --band-hz."
        )
    chosen = [head.units[head.channels.index(name)] for name in channels]
    mixed = mixed_units(channels, chosen) if len(channels) > 1 else ""
    if mixed:
        identifying.note_mixed_units(mixed)
    models = identifying.reference_modes(flags["model"], channels, mixed)
    if str(out) != "-":
        nothing = np.zeros(0)
        shown = ModalResult(
            modes=modes,
            stabilisation=join_stabilisation([], [], []),
            spectrum_hz=nothing,
            singular_values=nothing[:, None],
        )
        mode_tables.show_modes(shown, models, path.name, method=METHOD)
    if out is None:
        return
    span = 0.0, seconds
    result = {
        "slowtime_modes": 1,
        "record": path.name,
        "rate_hz": head.rate_hz,
        "channels": list(channels),
        "duration_s": seconds,
        "assumptions": [*head.assumptions, *head.notes, *said],
        "modes": [
            identifying.without_shape(
                mode_tables.as_json(mode, models, span, method=METHOD), mixed
            )
            for mode in modes
        ],
    }
    write_modes_file(out, result, read_geometry(geometry) if geometry else None, chosen[0])
