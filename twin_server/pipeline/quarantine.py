"""Lists, releases and drops messages that were set aside."""

import functools
from typing import Any

from slowtime_services.bus import Sample
from slowtime_services.clock import Clock, SystemClock
from twin_server.persist import AsideRow, Store
from twin_server.serve import ProblemError

from .ingestion.estimation import NotEstimatedError, note_event, reestimate
from .ingestion.pipeline import Pipeline
from .ingestion.rows import address
from .progress.quarantine import DROPPED, RELEASED, listed


class QuarantineDesk:
    """What people decide about messages that were set aside.

    Parameters
    ----------
    clock
        Dates what they decide.
    """

    def __init__(self, pipeline: Pipeline, store: Store, clock: Clock | None = None) -> None:
        self._pipeline, self._store = pipeline, store
        self._clock = clock or SystemClock()

    def listed(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the messages of a twin that are aside, the newest first."""
        return listed(self._store.aside(twin_id))

    def release(self, twin_id: str, number: int, principal: str) -> None:
        """Try a message again, and give it its estimate.

        Raises
        ------
        ProblemError
            If there is none, or it fails again.
        """
        row = self._row(twin_id, number)
        self._pipeline.call(lambda: self._release(row, principal))

    def drop(self, twin_id: str, number: int, principal: str) -> None:
        """Delete a message; its place in the history stays without an estimate."""
        row = self._row(twin_id, number)
        aside = self._pipeline.setting_aside

        def drop() -> None:
            self._store.drop_aside(row)
            aside.quarantine.load()

        self._pipeline.call(drop)
        self._note(row, DROPPED, f"was dropped by {principal or 'somebody'}")

    def _row(self, twin_id: str, number: int) -> AsideRow:
        for row in self._store.aside(twin_id, number):
            if not row.dropped:
                return row
        there = [row.ordinal for row in self._store.aside(twin_id) if not row.dropped]
        raise ProblemError(
            404,
            "no-such-message",
            f"Message {number} of {twin_id} was given. Aside: "
            f"{', '.join(map(str, there[:20])) or 'none'}.",
        )

    def _release(self, row: AsideRow, principal: str) -> None:
        """Release a message, in the thread of the pipeline."""
        aside = self._pipeline.setting_aside
        if row.accepted:
            self._estimate_anew(row)
        aside.attempts.forget(row.message)
        self._store.release_aside(row.number)
        aside.quarantine.load()
        if not row.accepted:
            self._pipeline.ingest([Sample(row.key, row.message, None, True)])
        self._note(row, RELEASED, f"was released by {principal or 'somebody'}")

    def _estimate_anew(self, row: AsideRow) -> None:
        pipeline, key = self._pipeline, address(row.twin)
        twin = pipeline.twin(row.twin)
        if twin is None:
            return
        event = note_event(
            *key, "estimated_anew", "info",
            f"All states are estimated anew, with message {row.sequence} of boot {row.boot}.",
            {"boot": row.boot, "sequence": row.sequence}, self._clock.now_ns(),
        )  # fmt: skip
        estimating = functools.partial(pipeline.setting_aside.estimating, released=row)
        try:
            new = reestimate(
                self._store, key, twin.registration, event, estimating,
                lambda: self._store.release_aside(row.number),
            )  # fmt: skip
        except NotEstimatedError as error:
            raise ProblemError(409, "fails-again", str(error)) from error
        pipeline.replace(row.twin, new)

    def _note(self, row: AsideRow, kind: str, what: str) -> None:
        details = {"boot": row.boot, "sequence": row.sequence, "why": row.why}
        sentence = f"Message {row.sequence} of boot {row.boot}, which was set aside, {what}."
        self._pipeline.note(row.twin, kind, "info", sentence, details)
