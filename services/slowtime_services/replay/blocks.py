"""Blocks of samples of a recording."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slowtime.signals.block import Block, RateCorrection
from slowtime.signals.clock.joint_correction import JointCorrection, joint_correction
from slowtime_schemas.raw import decode_raw
from slowtime_schemas.raw_header import RawHeader
from slowtime_schemas.streams import RAW, parse_key
from slowtime_services.files import Gap, Record, find_column, read_record

from .recording_reader import ForeignRecordingError, RecordingError, contents, read_recording


def block_of(payload: bytes) -> tuple[RawHeader, Block]:
    """Decode one raw block; its samples are a read-only view, in the type they were sent.

    Raises
    ------
    ValueError
        If the payload is not a raw block.
    """
    header, body = decode_raw(payload)
    clock = header.clock
    return header, Block(
        samples=np.frombuffer(body, header.dtype).reshape(header.samples, len(header.channels)),
        rate_hz=header.rate_hz,
        first_index=header.first_index,
        start_ns=header.t_ns,
        channels=header.channels,
        units=header.units,
        epoch=header.epoch,
        slow_time=header.slow_time,
        covariates=header.covariates,
        truth=header.truth or {},
        clock=None if clock is None else RateCorrection(relative=clock.relative, sd=clock.sd),
    )


def raw_blocks(
    path: Path | str, *, site: str | None = None, asset: str | None = None
) -> Iterator[tuple[RawHeader, Block]]:
    """Yield the recorded blocks of one asset, or of all, in the order they arrived.

    Raises
    ------
    RecordingError
        If the file cannot be read, or has no samples of that asset.
    """
    path = Path(path)
    keys = _raw_keys(path, site, asset)
    return (
        _checked(path, message.payload)
        for message in read_recording(path, streams=[RAW])
        if message.key in keys
    )


def record_of(path: Path | str, *, channels: tuple[str, ...] | None = None) -> Record:
    """Join the recorded blocks of the one asset of a file into a record.

    Its rate is the measured one where blocks carry the correction of their clock, as that of
    features is.

    Raises
    ------
    RecordingError
        If there are several assets, or blocks that do not belong together.
    """
    path = Path(path)
    keys = _raw_keys(path, None, None)
    if len(keys) > 1:
        raise RecordingError(
            f"{path} has samples of {len(keys)} assets: {', '.join(sorted(keys))}. Give a "
            "recording of one."
        )
    blocks = [block for _, block in raw_blocks(path)]
    first = blocks[0]
    same = all(b.rate_hz == first.rate_hz and b.channels == first.channels for b in blocks)
    if not same:
        raise RecordingError(
            f"{path}: rate or channels change within it, so that its blocks are no one record. "
            "Give a recording of one set-up."
        )
    joint = joint_correction((block.clock, len(block.samples)) for block in blocks)
    rate_hz, notes = measured_rate(first.rate_hz, joint)
    record = Record(
        samples=np.concatenate([block.samples for block in blocks]),
        rate_hz=rate_hz,
        channels=first.channels,
        units=first.units,
        start_ns=first.start_ns,
        gaps=tuple(_gaps(path, blocks)),
        notes=notes,
    )
    return record if channels is None else _only(record, channels)


def measured_rate(
    nominal_hz: float, joint: JointCorrection | None
) -> tuple[float, tuple[str, ...]]:
    """Return the sampling rate that a clock model has measured, and a note on it.

    Parameters
    ----------
    nominal_hz
        Rate that the device promises [Hz].
    joint
        Correction of the blocks; None where the nominal rate is all that is known.

    Returns
    -------
    The measured rate [Hz], and the note; the nominal rate and no note without a correction.
    """
    if joint is None:
        return nominal_hz, ()
    correction = joint.correction
    rate_hz = nominal_hz * (1.0 + correction.relative)
    if not correction.relative and not correction.sd and joint.is_constant:
        return rate_hz, ()
    note = (
        f"Sampled at {rate_hz:.7g} Hz, as measured with a standard deviation of "
        f"{rate_hz * correction.sd:.2g} Hz; the nominal rate is {nominal_hz:g} Hz."
    )
    if not joint.is_constant:
        low, high = nominal_hz * (1.0 + joint.lowest), nominal_hz * (1.0 + joint.highest)
        note += (
            f" The measured rate was between {low:.7g} and {high:.7g} Hz, which is more than "
            "its uncertainty; the mean is used. Cut the record into parts for the rate of each."
        )
    return rate_hz, (note,)


def record_or_foreign(path: Path | str) -> Record:
    """Join the recorded blocks of a file; of another program's recording, its accelerations.

    Raises
    ------
    ValueError
        As `record_of` and `slowtime_services.files.read_record` do.
    """
    try:
        return record_of(path)
    except ForeignRecordingError:
        return read_record(path, skip_missing=True)


def _raw_keys(path: Path, site: str | None, asset: str | None) -> set[str]:
    found = {key for key, count in contents(path, streams=[RAW]).counts.items() if count}
    keys = {
        key for key in found if (of := parse_key(key)[1:]) == (site or of[0], asset or of[1])
    }
    if not keys:
        raise RecordingError(
            f"{path} has no samples of {site or 'any site'}, {asset or 'any asset'}. It has "
            f"samples of: {', '.join(sorted(found)) or 'nobody'}."
        )
    return keys


def _checked(path: Path, payload: bytes) -> tuple[RawHeader, Block]:
    try:
        return block_of(payload)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from error


def _gaps(path: Path, blocks: list[Block]) -> Iterator[Gap]:
    rows = 0
    for before, block in itertools.pairwise(blocks):
        rows += len(before.samples)
        missing = block.first_index - before.next_index
        if missing < 0:
            raise RecordingError(
                f"{path}: a block begins at sample {block.first_index}, before the one ahead "
                f"of it ends ({before.next_index}). Give a recording of one run."
            )
        if missing:
            yield Gap(row=rows, missing=missing)


def _only(record: Record, names: tuple[str, ...]) -> Record:
    columns = [find_column(name, record.channels) for name in names]
    return Record(
        samples=record.samples[:, columns],
        rate_hz=record.rate_hz,
        channels=tuple(record.channels[c] for c in columns),
        units=tuple(record.units[c] for c in columns),
        start_ns=record.start_ns,
        gaps=record.gaps,
        notes=record.notes,
    )
