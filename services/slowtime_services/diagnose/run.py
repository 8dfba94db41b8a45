"""Diagnosis of records under a budget of work, with its file model."""

import dataclasses
import time
from collections.abc import Mapping, Sequence

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime.discrepancy.large_models import is_large
from slowtime.discrepancy.progress import Progress, Stop
from slowtime.discrepancy.search import DEFAULT_OPTIONS, SearchOptions
from slowtime.discrepancy.time_limit import TimeLimit, limited
from slowtime.discrepancy.workers import shared_among
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.work import metered
from slowtime_schemas.files.diagnosis import DiagnosisFile, SearchEnd
from slowtime_services.engines.forks import ForkedWorkers, can_fork

from .campaign import gather
from .channel_roles import Roles
from .compile_ahead import compile_ahead
from .compile_time import compiling_s
from .document import document_of
from .record_checks import refuse_large_models, refuse_nonsense
from .sources import Source

PATIENCE_S = 70.0
"""[s] Processor time of a reference machine that a model gets. Source: chosen on hidden cases;
those that it left unknown were not named with eight times as much either (decision 0029)."""
MASSES = 3
"""[degrees of freedom] Up to which that is enough; more get more in proportion."""
MORE = 2.0
"""[1] Times as much that a model gets at most. Source: a decision of the interface."""
LARGE = 5.0
"""[1] Times as much that a large model gets, which is reduced. Source: a forgotten support of a
chain of 200 masses was not yet compared with its neighbours when twice as much was spent."""
WORK_PER_S = 2.3e8
"""[units of work/s] That the reference machine does (`slowtime.dynamics.work`). Source: paired
diagnoses of 55 hidden cases: none is left unknown that budgets in seconds named; with 1.6e8,
one was. One case in twenty takes 1.4 times the processor time that those took."""
LATE = 0.7
"""[share of the budget] After which only the likeliest candidates are still tried. Source:
chosen on hidden cases."""
LAST_STOP = 2.0
"""[1] Times the patience in processor time after which the clock ends a diagnosis whatever work
is left: on a machine half as fast as the reference, or where time goes into what is not
counted. Source: a decision between a promised end and the same answer on every machine."""
CLOCK = (
    "The time limit ended the diagnosis: it took more than {limit:g} s of processor time. "
    "With a higher --patience, or on a faster computer, more effects may be found."
)
ENDED = "The search was ended on request: this is what was found by then."


def diagnose_records(
    description: Description,
    records: Sequence[Source],
    holdout: Sequence[Source] = (),
    *,
    roles: Roles | None = None,
    kinds: Mapping[str, Kind] | None = None,
    options: SearchOptions = DEFAULT_OPTIONS,
    unchecked: bool = False,
    progress: Progress | None = None,
    stop: Stop | None = None,
    enough: Stop | None = None,
    patience_s: float | None = None,
    jobs: int = 1,
) -> tuple[Diagnosis, DiagnosisFile]:
    """Find the effects that a model lacks to explain records.

    Parameters
    ----------
    roles
        What to read for a channel of the model that the records call otherwise.
    kinds
        Effects that may be named; the catalogue where not given.
    options
        How thoroughly effects are searched for, and by which steps.
    unchecked
        Records are taken as they are, even where their sizes make no sense.
    progress
        Told the stage in words and the share done.
    stop
        Once set, `slowtime.discrepancy.progress.Cancelled` is raised.
    enough
        Once set, what was found by then is the answer.
    patience_s
        Budget of work, in seconds of a reference machine. Once it is used up, what is being
        fitted is given up, and what was found by then is the answer; in the last part of it
        only the likeliest are tried. Work is counted, not timed, so that the same records give
        the same answer on any machine. At `LAST_STOP` times as many seconds of processor time
        all that follows, such as a force surface, is ended too, and a note says what was left
        out. As `patience_for` has it where not given.
    jobs
        Processes that share the work. The answer does not depend on it. It is done by one where
        this process cannot be forked.

    Raises
    ------
    RecordError
        (a ValueError) where records do not fit the model.
    """
    begun, spent = time.monotonic(), time.thread_time() - compiling_s()
    allowed_s = patience_for(description) if patience_s is None else patience_s

    def is_last_stop() -> bool:
        return time.thread_time() - compiling_s() - spent > LAST_STOP * allowed_s

    if description.inputs:
        refuse_large_models(description, kinds)
    given = gather(description, records, holdout, roles)
    workers = ForkedWorkers(jobs) if jobs > 1 and can_fork() else None
    if workers is not None:
        compile_ahead(workers)
    if not unchecked:
        refuse_nonsense(given.campaign, given.origins, kinds)
    limit = TimeLimit(is_last_stop, min(allowed_s / PATIENCE_S, 1.0))
    with metered() as meter, shared_among(workers), limited(limit):
        found = diagnose(
            given.campaign,
            kinds=kinds,
            options=options,
            progress=progress,
            stop=stop,
            enough=enough,
            late=lambda: meter.spent > LATE * WORK_PER_S * allowed_s or is_last_stop(),
            over=lambda: meter.spent > WORK_PER_S * allowed_s or is_last_stop(),
        )
    used_s, ended = time.monotonic() - begun, None
    clocked: tuple[str, ...] = (limit.note,) if limit.note else ()
    if found.exhausted:
        ended = SearchEnd(by="budget", budget_s=allowed_s, used_s=used_s)
    if is_last_stop():
        clocked += (CLOCK.format(limit=LAST_STOP * allowed_s),)
        ended = SearchEnd(by="clock", budget_s=allowed_s, used_s=used_s)
    if enough is not None and enough.is_set():
        clocked += (ENDED,)
        ended = SearchEnd(by="request", budget_s=allowed_s, used_s=used_s)
    found = dataclasses.replace(found, notes=(*found.notes, *clocked), seconds=used_s)
    document = document_of(
        found,
        records=[source.name for source in records],
        holdout=[source.name for source in holdout],
        notes=given.notes,
        measured=[source.record for source in (*records, *holdout)],
        ended=ended,
    )
    return found, document


def patience_for(description: Description) -> float:
    """Return the budget [s of the reference machine] that a model gets where none is given."""
    if is_large(description):
        return PATIENCE_S * LARGE
    return PATIENCE_S * min(max(1.0, len(description.dofs) / MASSES), MORE)
