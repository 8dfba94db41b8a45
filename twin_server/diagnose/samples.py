"""Raw blocks joined to records for a diagnosis, cut at gaps, epochs and runs."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from slowtime.signals.block import Block
from slowtime.signals.clock.joint_correction import JointCorrection, joint_correction
from slowtime_services.files import Record, in_si
from slowtime_services.replay import measured_rate


class NoSamplesError(ValueError):
    """No samples to diagnose; the text says what to do."""


class SamplePiece(NamedTuple):
    """Samples in a row, of one epoch or of one continuous run."""

    record: Record
    epoch: int | None

    @property
    def seconds(self) -> float:
        """Length of it [s]."""
        return len(self.record.samples) / self.record.rate_hz


def pieces_of(blocks: Iterable[Block]) -> list[SamplePiece]:
    """Join blocks that follow each other; a gap, a new epoch or another rate begins a piece.

    Pieces of one nominal rate have one measured rate, where the corrections of their blocks
    agree; else each has that of its own blocks.
    """
    runs = list(_runs(blocks))
    by_rate = {
        rate: _joint(block for run in runs if run[0].rate_hz == rate for block in run)
        for rate in {run[0].rate_hz for run in runs}
    }
    pieces = []
    for run in runs:
        joint = by_rate[run[0].rate_hz]
        if joint is not None and not joint.is_constant:
            joint = _joint(run)
        pieces.append(_concatenate(run, joint))
    return pieces


def _joint(blocks: Iterable[Block]) -> JointCorrection | None:
    return joint_correction((block.clock, len(block.samples)) for block in blocks)


def _runs(blocks: Iterable[Block]) -> Iterator[list[Block]]:
    run: list[Block] = []
    for block in blocks:
        if run and not _goes_on(run[-1], block):
            yield run
            run = []
        run.append(block)
    if run:
        yield run


def _goes_on(last: Block, block: Block) -> bool:
    return (
        block.first_index == last.next_index
        and block.epoch == last.epoch
        and block.rate_hz == last.rate_hz
        and block.channels == last.channels
        and block.units == last.units
    )


def _concatenate(run: list[Block], joint: JointCorrection | None) -> SamplePiece:
    first = run[0]
    rate_hz, notes = measured_rate(first.rate_hz, joint)
    record = Record(
        samples=np.concatenate([block.samples for block in run]),
        rate_hz=rate_hz,
        channels=first.channels,
        units=first.units,
        start_ns=first.start_ns,
        notes=notes,
    )
    return SamplePiece(in_si(record), first.epoch)


def within(
    pieces: Iterable[SamplePiece], start_ns: int | None, end_ns: int | None
) -> list[SamplePiece]:
    """Cut pieces to a span of the sensor's time; those outside are left out."""
    found = []
    for piece in pieces:
        begins = piece.record.start_ns or 0
        rate = piece.record.rate_hz
        count = len(piece.record.samples)
        first = 0 if start_ns is None else -(-(start_ns - begins) * rate // 1e9)
        last = count if end_ns is None else -(-(end_ns - begins) * rate // 1e9)
        cut = part(piece, int(max(0, min(first, count))), int(max(0, min(last, count))))
        if len(cut.record.samples):
            found.append(cut)
    return found


def held_back(
    pieces: list[SamplePiece], seconds: float
) -> tuple[list[SamplePiece], list[SamplePiece]]:
    """Part pieces in those to learn from and the last `seconds`, to judge by.

    Whole pieces where that leaves something to learn from; the one it falls in is cut.

    Parameters
    ----------
    pieces
        Records in the order of their time.
    seconds
        Duration to hold out [s].

    Returns
    -------
    Pieces to learn from, and held-out pieces.
    """
    judged: list[SamplePiece] = []
    learnt, left = list(pieces), seconds
    while learnt and left > 1e-9:
        last = learnt.pop()
        if last.seconds <= left + 1e-9:
            judged.append(last)
            left -= last.seconds
            continue
        cut = len(last.record.samples) - round(left * last.record.rate_hz)
        learnt.append(part(last, 0, cut))
        judged.append(part(last, cut, len(last.record.samples)))
        left = 0.0
    if not learnt:
        total = sum(piece.seconds for piece in pieces)
        raise NoSamplesError(
            f"holdout_s={seconds:g} leaves nothing for fitting: there are {total:.1f} s "
            "of samples. Hold back less, or give more samples."
        )
    return learnt, judged[::-1]


def part(piece: SamplePiece, first: int, last: int) -> SamplePiece:
    """Cut rows `first` to `last` out of a piece."""
    record = piece.record
    begins = (record.start_ns or 0) + round(first * 1e9 / record.rate_hz)
    cut = Record(
        samples=record.samples[first:last],
        rate_hz=record.rate_hz,
        channels=record.channels,
        units=record.units,
        start_ns=begins,
        notes=record.notes,
    )
    return SamplePiece(cut, piece.epoch)


def bounded(blocks: Iterable[Block], max_samples: int, max_seconds: float) -> Iterator[Block]:
    """Pass blocks on until there are too many.

    Parameters
    ----------
    blocks
        Blocks of samples.
    max_samples
        Largest number of samples, over all channels.
    max_seconds
        Largest duration [s].

    Yields
    ------
    The same blocks.

    Raises
    ------
    NoSamplesError
        Naming the limits.
    """
    total, seconds = 0, 0.0
    for block in blocks:
        total += block.samples.size
        seconds += len(block.samples) / block.true_rate_hz
        if total > max_samples or seconds > max_seconds + 1e-6:
            raise NoSamplesError(
                f"More than {max_samples:,} numbers, or {max_seconds:g} s, of samples were "
                "asked for. Give a shorter span, or raise diagnose.max_samples and "
                "diagnose.max_raw_s of the server."
            )
        yield block
