"""Sets messages aside: their rows and events, their release and their drop."""

from collections.abc import Iterable, Sequence

from slowtime_schemas.streams import FEATURES, parse_key
from slowtime_services.bus import Sample
from twin_server.collect import Arrival, Ordered, Refusals
from twin_server.persist import AsideRow, EventRow, Store
from twin_server.pipeline.progress import (
    ASIDE_BEFORE,
    Attempts,
    EstimateBatch,
    Isolated,
    Progress,
    Quarantine,
    Suspicion,
    WorkBudget,
    estimate_apart,
)
from twin_server.pipeline.progress.quarantine import KIND, sentence
from twin_server.settings import ProgressSettings

from .estimation import BatchEstimate, note_event

ENDED = "the server ended or stood still while it worked on it"
"""Why a message is set aside without being tried."""


class QuarantineFullError(RuntimeError):
    """A message would have to be set aside, and there is no room for it."""


class SettingAside:
    """What a pipeline needs to set messages aside.

    Parameters
    ----------
    settings
        The budget of a step, and how much is kept.
    refusals
        Where messages for which there is no room are counted.
    """

    def __init__(self, store: Store, settings: ProgressSettings, refusals: Refusals) -> None:
        self._store, self._refusals = store, refusals
        self.progress = Progress()
        self.budget = WorkBudget(settings, self.progress)
        self.attempts = Attempts(store.attempts, self.progress)
        self.quarantine = Quarantine(store, settings)

    def divided(self, samples: Sequence[Sample]) -> tuple[Sequence[Sample], list[Sample]]:
        """Divide messages into those that are worked together, and those that are suspected."""
        if not self.attempts.some:
            return samples, []
        usual: list[Sample] = []
        suspected: list[Sample] = []
        for sample in samples:
            suspicion = self.attempts.suspicion(sample.payload)
            (suspected if suspicion else usual).append(sample)
        return usual, suspected

    def refuses(self, sample: Sample, now_ns: int) -> bool:
        """Whether a message is not worked at all; then it is set aside."""
        if self.attempts.suspicion(sample.payload) < Suspicion.UNTRIED:
            return False
        try:
            stream, site, asset = parse_key(sample.key)
        except ValueError:
            return True  # of no asset, so nobody misses it
        features = stream is FEATURES
        if features and self.attempts.suspicion(sample.payload) < Suspicion.REFUSED:
            return False  # it gets its place in the history, without an estimate
        twin_id = f"{site}.{asset}"
        if self.quarantine.has_room(twin_id, len(sample.payload)):
            row = AsideRow(
                0, twin_id, "", 0, now_ns, sample.key, ENDED, False, False, sample.payload
            )
            self._store.set_aside([row])
            self.quarantine.load()
        return True

    def admitted(self, arrivals: Iterable[Arrival]) -> list[Arrival]:
        """Leave out features of assets of which no more can be set aside; edges keep them."""
        taken: list[Arrival] = []
        for arrival in arrivals:
            twin_id = arrival.features.twin_id
            if self.quarantine.is_full(twin_id):
                self._refuse(twin_id)
            else:
                taken.append(arrival)
        return taken

    def estimating(
        self,
        batch: EstimateBatch,
        payloads: Sequence[bytes],
        *,
        released: AsideRow | None = None,
    ) -> Isolated:
        """Estimate a batch; what was set aside stays so, but for what is being released."""
        aside, alone = set(), set()
        of_twins = [f"{f.site}.{f.asset}" for f in batch.features[:1]]
        if len(batch.twins) > 1:
            of_twins = [f.twin_id for f in batch.features]
        places = any(map(self.quarantine.has_any, of_twins))
        for row, features in enumerate(batch.features if places else ()):
            if self.quarantine.has_place(features.twin_id, features.boot, features.sequence):
                aside.add(row)
        for row, payload in enumerate(payloads if self.attempts.some else ()):
            suspicion = self.attempts.suspicion(payload)
            if suspicion >= Suspicion.UNTRIED:
                aside.add(row)
            elif suspicion is Suspicion.ALONE:
                alone.add(row)
        if released is not None:
            aside -= {
                row
                for row, features in enumerate(batch.features)
                if (features.boot, features.sequence) == (released.boot, released.sequence)
            }
        return estimate_apart(
            batch,
            self.budget,
            aside=aside,
            alone=alone,
            noted=lambda row: self.attempts.noted([payloads[row]]),
            advance=self.progress.advance,
        )

    def rows(
        self, ordered: Sequence[Ordered], fresh: BatchEstimate, now_ns: int
    ) -> tuple[list[AsideRow], list[EventRow]]:
        """Make rows and events of features that have no estimate.

        Raises
        ------
        QuarantineFullError
            If there is no room for one of them.
        """
        rows, events = [], []
        for place, why in fresh.failed.items():
            features, payload = ordered[place].features, ordered[place].payload
            twin_id, key = features.twin_id, FEATURES.key(features.site, features.asset)
            if not self.quarantine.has_room(twin_id, len(payload)):
                self._refuse(twin_id)
                raise QuarantineFullError(f"Nothing more of {twin_id} can be set aside.")
            row = AsideRow(
                0, twin_id, features.boot, features.sequence, now_ns, key,
                ENDED if why == ASIDE_BEFORE else why, True, False, payload,
            )  # fmt: skip
            rows.append(row)
            details = {"boot": row.boot, "sequence": row.sequence, "why": row.why}
            events.append(
                note_event(
                    features.site, features.asset, KIND, "warning", sentence(row), details,
                    now_ns,
                )
            )  # fmt: skip
        return rows, events

    def failed(self, arrival: Arrival, error: Exception, now_ns: int) -> EventRow | None:
        """Set features aside that cannot be given a place; return their event, if any."""
        features = arrival.features
        twin_id = features.twin_id
        if not self.quarantine.has_room(twin_id, len(arrival.payload)):
            return None
        row = AsideRow(
            0, twin_id, features.boot, features.sequence, now_ns,
            FEATURES.key(features.site, features.asset),
            f"the server failed on it: {error!r:.300}",
            False, False, arrival.payload,
        )  # fmt: skip
        self._store.set_aside([row])
        self.quarantine.load()
        details = {"boot": row.boot, "sequence": row.sequence, "why": row.why}
        return note_event(
            features.site, features.asset, KIND, "warning", sentence(row), details, now_ns
        )

    def _refuse(self, twin_id: str) -> None:
        self._refusals.refuse(
            "quarantine_full",
            f"{twin_id} has as many messages aside as are allowed, and no more of it is taken "
            "in. Its edge agent keeps them. Release or drop some: slowtime twin quarantine "
            "list.",
        )
