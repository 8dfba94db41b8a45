"""The diagnosis of a model by records, and its document."""

import dataclasses
import time
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime.discrepancy.progress import Progress, Stop
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind
from slowtime_schemas.diagnosis_file import DiagnosisFile

from .campaign import gather
from .channel_roles import Roles
from .compile_time import compiling_s
from .document import document_of
from .record_checks import refuse_nonsense
from .sources import Source

PATIENCE_S, MASSES, MORE = 70.0, 3, 2.0
"""Processor time after which no more laws are tried; degrees of freedom up to which it is that,
and how many times as much it is at most for more, in proportion."""
LATE_SHARE = 0.7
"""Share of the allowed processor time [1] after which only the likeliest laws are still
tried."""


def diagnose_records(
    description: Description,
    records: Sequence[Source],
    holdout: Sequence[Source] = (),
    *,
    roles: Roles | None = None,
    kinds: Mapping[str, Kind] | None = None,
    quick: bool = False,
    unchecked: bool = False,
    progress: Progress | None = None,
    stop: Stop | None = None,
    patience_s: float | None = None,
) -> tuple[Diagnosis, DiagnosisFile]:
    """Say what a model lacks to explain records.

    Parameters
    ----------
    roles
        What to read for a channel of the model that the records call otherwise.
    kinds
        Effects that may be named; the catalogue where not given.
    quick
        Fewer rivals are refitted, and one effect is looked for.
    unchecked
        Records are taken as they are, even where their sizes make no sense.
    progress
        Told the stage in words and the share done.
    stop
        Once set, `slowtime.discrepancy.progress.Cancelled` is raised.
    patience_s
        Of the processor, but for compiling, which the first run on a machine does; once it is
        used up, what is being fitted is given up, and what was found by then is the answer. In
        the last part of it only the likeliest are tried. As `patience_for` has it where not
        given.

    Raises
    ------
    RecordError
        (a ValueError) where records do not fit the model.
    """
    begun, spent = time.monotonic(), time.thread_time() - compiling_s()
    allowed_s = patience_for(description) if patience_s is None else patience_s

    def used() -> float:
        return time.thread_time() - compiling_s() - spent

    given = gather(description, records, holdout, roles)
    if not unchecked:
        refuse_nonsense(given.campaign, given.origins, kinds)
    found = diagnose(
        given.campaign,
        kinds=kinds,
        quick=quick,
        progress=progress,
        stop=stop,
        late=lambda: used() > LATE_SHARE * allowed_s,
        over=lambda: used() > allowed_s,
    )
    found = dataclasses.replace(found, seconds=time.monotonic() - begun)
    document = document_of(
        found,
        records=[source.name for source in records],
        holdout=[source.name for source in holdout],
        notes=given.notes,
    )
    return found, document


def patience_for(description: Description) -> float:
    """Give the seconds of processor time that a model gets where none are given."""
    return PATIENCE_S * min(max(1.0, len(description.dofs) / MASSES), MORE)
