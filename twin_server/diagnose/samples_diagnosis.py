"""A diagnosis in fast time: recorded raw blocks and a model, compared by free run."""

import dataclasses
import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import MIN_SAMPLES
from slowtime.discrepancy.search import SearchOptions
from slowtime.signals.block import Block
from slowtime.signals.repeated_samples import find_hold
from slowtime.signals.value_checks import hold_note, value_notes
from slowtime_services.diagnose import Source, campaign_of, document_of, write_results
from slowtime_services.models import description_of
from slowtime_services.plugins.effect_kinds import known
from slowtime_services.replay import raw_blocks

from .samples import NoSamplesError, SamplePiece, bounded, held_back, pieces_of, within
from .task import Task


def diagnose_samples(
    task: Task,
    folder: Path,
    progress: Callable[[str, float], None],
    stop: threading.Event,
) -> None:
    """Do it, and write the files.

    Parameters
    ----------
    task
        The task of this process.
    folder
        Folder that receives the results.
    progress
        Called with the stage in words and the share done, from 0 to 1.
    stop
        Set to end early.

    Raises
    ------
    ValueError
        Where model and samples do not go together; the text says what to do.
    """
    began = time.monotonic()
    assert task.model is not None
    progress("reading samples", 0.0)
    kinds = known(task.effects) if task.effects else None
    learnt, judged = _pieces(task)
    campaign, notes = campaign_of(
        description_of(task.model), _sources(learnt), _sources(judged)
    )
    found = diagnose(
        campaign,
        options=SearchOptions(quick=task.order.quick),
        progress=progress,
        stop=stop,
        kinds=kinds,
    )
    found = dataclasses.replace(found, seconds=time.monotonic() - began)
    document = document_of(
        found,
        records=[source.name for source in _sources(learnt)],
        holdout=[source.name for source in _sources(judged)],
        notes=(*notes, *_value_notes((*learnt, *judged)), *task.notes),
        measured=[piece.record for piece in (*learnt, *judged)],
    )
    progress("writing the report", 0.99)
    write_results(folder, found, document)


def _value_notes(pieces: Sequence[SamplePiece]) -> tuple[str, ...]:
    """Say once of each value that is no measurement, in any piece."""
    said: list[str] = []
    for piece in pieces:
        samples = np.asarray(piece.record.samples, dtype=float)
        said += value_notes(samples, piece.record.channels, piece.record.rate_hz)
        hold = find_hold(samples)
        said += [] if hold is None else [hold_note(hold)]
    return tuple(dict.fromkeys(said))


def _pieces(task: Task) -> tuple[list[SamplePiece], list[SamplePiece]]:
    order = task.order
    span = (None, None) if order.recordings is None else order.recordings.span_ns
    learnt = _read(task, task.recordings, span)
    if order.holdout_s is not None:
        learnt, judged = held_back(learnt, order.holdout_s)
    elif order.holdout is not None:
        judged = _read(task, task.holdout, order.holdout.span_ns)
    else:
        judged = []
    return _long_enough(learnt), _long_enough(judged) if judged else []


def _read(
    task: Task, paths: Sequence[Path], span: tuple[int | None, int | None]
) -> list[SamplePiece]:
    blocks = itertools.chain.from_iterable(_blocks(task, path, span) for path in paths)
    pieces = pieces_of(bounded(blocks, task.max_samples, task.max_seconds))
    found = within(pieces, *span)
    if not found:
        raise NoSamplesError(
            f"There are no raw samples of {task.site}.{task.asset} in that span of "
            f"{', '.join(path.name for path in paths)}. Give another span, or other "
            "recordings; raw samples are recorded where the edge has publish.raw=on."
        )
    return found


def _blocks(task: Task, path: Path, span: tuple[int | None, int | None]) -> Iterator[Block]:
    start, end = span
    for _, block in raw_blocks(path, site=task.site, asset=task.asset):
        if (start is None or block.end_ns > start) and (end is None or block.start_ns < end):
            yield block


def _long_enough(pieces: list[SamplePiece]) -> list[SamplePiece]:
    kept = [piece for piece in pieces if len(piece.record.samples) >= MIN_SAMPLES]
    if not kept:
        longest = max(len(piece.record.samples) for piece in pieces)
        raise NoSamplesError(
            f"No {MIN_SAMPLES} consecutive samples without a gap are available, but at "
            f"most {longest}. Ask for a longer span."
        )
    return kept


def _sources(pieces: Sequence[SamplePiece]) -> list[Source]:
    return [
        Source(
            f"record {number}" if piece.epoch is None else f"epoch {piece.epoch}",
            piece.record,
        )
        for number, piece in enumerate(pieces, start=1)
    ]
