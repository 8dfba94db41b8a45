"""Compares models with raw samples that are asked from edges at intervals.

What it learns is kept as an event, so that a server that starts again goes on from it.
"""

import collections
import concurrent.futures
import dataclasses
import hashlib
import json
import logging
import math
import multiprocessing
import signal
import threading
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from slowtime.discrepancy.records import MIN_SAMPLES
from slowtime.dynamics.effects import catalogue
from slowtime_schemas.answers.diagnoses import GapState
from slowtime_schemas.files.model import ModelFile
from slowtime_services.bus import BusClosedError, Sample
from slowtime_services.files import Record
from slowtime_services.operating_system import lower_priority
from slowtime_services.plugins.discovery import exception_text
from slowtime_services.replay import block_of
from twin_server.diagnose import SamplePiece, part, pieces_of, within
from twin_server.diagnose import gap as measuring
from twin_server.persist import Store, TwinRow
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError
from twin_server.settings import GapSettings

logger = logging.getLogger(__name__)

PATIENCE_S = 120.0
"""Time that one comparison may take [s]; the first one compiles."""

LEARNT = "gap_learnt"


class Comparison(NamedTuple):
    """Result of comparing the models of a twin with one record.

    Parameters
    ----------
    nominal, in_use
        Gap of the model before anything was adopted, and of that with it [1].
    limit
        Gap beyond which the record speaks against a model [1].
    disagrees
        Whether the model in use disagrees with the last records.
    """

    nominal: float
    in_use: float
    limit: float
    disagrees: bool


@dataclasses.dataclass(slots=True)
class _TwinGap:
    """State of the comparison of one twin.

    Parameters
    ----------
    key
        Of the nominal model that it is about.
    records
        The newest ones, to which that model's constants are fitted.
    tuned
        The model, its constants fitted within tolerance.
    failed
        The model in use, where an effect of its own failed: it is not run again.
    """

    key: str
    kept: collections.deque[dict[str, Any]]
    records: collections.deque[Record]
    learning: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    tuned: str = ""
    usual: measuring.GapBaseline | None = None
    until_ns: int = -1
    against: int = 0
    disagrees: bool = False
    failed: str = ""


class GapMonitor:
    """Thread that measures the gap of each model at intervals.

    Parameters
    ----------
    raw_samples
        Asks the edge of a twin for its last seconds.
    workers
        Makes what computes; a process of its own, where not given.
    effects
        Installed parts that may be imported there.
    compared
        Told of each comparison once the usual gap is learnt.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        store: Store,
        settings: GapSettings,
        raw_samples: Callable[[str, float], list[Sample]],
        workers: Callable[[], concurrent.futures.Executor] | None = None,
        effects: tuple[str, ...] = (),
        compared: Callable[[str, Comparison], None] = lambda _twin_id, _found: None,
    ) -> None:
        self._compared = compared
        self._pipeline, self._store, self._settings = pipeline, store, settings
        self._raw_samples, self._make = raw_samples, workers or _one_process
        self._effects = effects
        self._workers: concurrent.futures.Executor | None = None
        self._gaps: dict[str, _TwinGap] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="gap", daemon=True)

    def start(self) -> None:
        """Begin to compare, where settings ask for it."""
        if self._settings.every_s:
            self._thread.start()

    def stop(self) -> None:
        """Compare nothing more."""
        self._stop.set()
        self._drop_workers()
        if self._thread.is_alive():
            self._thread.join()

    def gap(self, twin_id: str) -> Mapping[str, Any]:
        """Return the state and the readings of the gap of a twin."""
        twin = self._pipeline.twin(twin_id)
        with self._lock:
            mind = self._gaps.get(twin_id)
            readings = [] if mind is None else list(mind.kept)
        registration = None if twin is None else twin.registration
        state = self._state(registration, mind)
        usual = None if mind is None else mind.usual
        return {
            "id": twin_id,
            "measure": "nrmse",
            "state": state,
            "sentence": _sentence(state, readings),
            "learnt": 0 if usual is None else usual.readings,
            "expected": None if usual is None else usual.expected,
            "limit": None if usual is None else usual.limit,
            "readings": readings,
        }

    def disagrees(self, twin_id: str) -> bool:
        """Whether the model of a twin disagrees with raw samples."""
        with self._lock:
            mind = self._gaps.get(twin_id)
        return mind is not None and mind.usual is not None and mind.disagrees

    def _state(self, registration: Registration | None, mind: _TwinGap | None) -> GapState:
        if registration is None or not self._settings.every_s or not _comparable(registration):
            return "off"
        if mind is None or not (mind.kept or mind.records or mind.usual):
            return "waiting"
        if mind.usual is None:
            return "learning"
        return "disagreeing" if mind.disagrees else "watching"

    def _run(self) -> None:
        while not self._stop.wait(self._settings.every_s):
            for row in self._rows():
                if self._stop.is_set():
                    return
                try:
                    self._mind(row.id)
                except (BusClosedError, concurrent.futures.CancelledError):
                    return
                except (concurrent.futures.BrokenExecutor, TimeoutError):
                    if self._stop.is_set():
                        return
                    logger.exception("A comparison of %s was abandoned.", row.id)
                    self._drop_workers()
                except ProblemError as error:
                    logger.debug("%s", error)
                except ValueError as error:
                    logger.warning("%s cannot be compared: %s", row.id, error)
                except Exception:
                    if not self._stop.is_set():
                        logger.exception("A comparison of %s failed; continuing.", row.id)

    def _rows(self) -> list[TwinRow]:
        """All twins; none where the store fails, which is asked again after the interval."""
        try:
            return self._store.twins()
        except Exception:
            if not self._stop.is_set():
                logger.exception("The twins to compare cannot be read; continuing.")
            return []

    def _mind(self, twin_id: str) -> None:
        """Compare one twin once, where there is something new."""
        twin = self._pipeline.twin(twin_id)
        if twin is None or not _comparable(twin.registration):
            self._gaps.pop(twin_id, None)
            return
        if not self._pipeline.is_alive(twin_id):
            return
        registration = twin.registration
        assert registration.model is not None
        nominal = registration.nominal_model
        assert nominal is not None
        mind = self._of(twin_id, nominal)
        piece = self._newest(twin_id, mind)
        if piece is None:
            return
        mind.until_ns = _end_ns(piece)
        if not mind.tuned:
            mind.records.append(piece.record)
            if len(mind.records) < self._settings.tune:
                return
            records = list(mind.records)
            mind.tuned = self._compute(measuring.tune, nominal.model_dump_json(), records)
            mind.records.clear()
        else:
            records = [piece.record]
        models = [mind.tuned]
        in_use = registration.model.model_dump_json()
        if any(one.clock == "fast" for one in registration.adopted):
            models += [in_use] * (mind.failed != in_use)
        for record in records:
            found = self._measured(twin_id, mind, models, record)
            self._take(twin_id, mind, record, found)

    def _measured(
        self, twin_id: str, mind: _TwinGap, models: list[str], record: Record
    ) -> measuring.GapSample:
        """Measure; an own effect that fails or hangs costs the comparison of its model only."""
        try:
            return self._compare(models, record)
        except Exception as error:
            if self._stop.is_set() or len(models) == 1 or not _is_own(models[-1]):
                raise
            self._drop_workers()
            mind.failed = models.pop()
            why = (
                exception_text(error) if str(error) else f"it took longer than {PATIENCE_S:g} s"
            )
            self._pipeline.note(
                twin_id, "effect_failed", "warning",
                f"The adopted model cannot be run ({why}). Its nominal model is compared "
                "instead. Repair the plug-in that provides its effect and restart the "
                "server, or undo the diagnosis.",
                {},
            )  # fmt: skip
            return self._compare(models, record)

    def _compare(self, models: list[str], record: Record) -> measuring.GapSample:
        refit = self._settings.refit
        return self._compute(measuring.measure, models, record, refit)  # type: ignore[no-any-return]

    def _of(self, twin_id: str, nominal: ModelFile) -> _TwinGap:
        key = hashlib.sha256(nominal.model_dump_json().encode()).hexdigest()[:16]
        mind = self._gaps.get(twin_id)
        if mind is not None and mind.key == key:
            return mind
        mind = _TwinGap(
            key,
            collections.deque(maxlen=self._settings.kept),
            collections.deque(maxlen=self._settings.tune),
        )
        events = self._store.events(twin_id, limit=10_000, newest=True)
        for row in reversed(events):
            body = json.loads(row.body)
            if body["kind"] == LEARNT and body["details"]["key"] == key:
                mind.tuned = json.dumps(body["details"]["tuned"])
                mind.usual = measuring.GapBaseline(**body["details"]["usual"])
                break
        with self._lock:
            self._gaps[twin_id] = mind
        return mind

    def _newest(self, twin_id: str, mind: _TwinGap) -> SamplePiece | None:
        """Request newer samples, and return the last record that is long enough."""
        seconds = self._settings.seconds
        samples = self._raw_samples(twin_id, seconds)
        pieces = pieces_of(block_of(sample.payload)[1] for sample in samples)
        fresh = within(pieces, mind.until_ns + 1, None)
        for piece in reversed(fresh):
            whole = piece.epoch is not None or piece.seconds >= 0.5 * seconds
            if whole and len(piece.record.samples) >= MIN_SAMPLES:
                excess = len(piece.record.samples) - round(seconds * piece.record.rate_hz)
                return piece if excess <= 0 else _last(piece, excess)
        return None

    def _compute(self, function: Callable[..., Any], *arguments: Any) -> Any:
        if self._workers is None:
            self._workers = self._make()
        return self._workers.submit(function, *arguments, self._effects).result(PATIENCE_S)

    def _take(
        self, twin_id: str, mind: _TwinGap, record: Record, found: measuring.GapSample
    ) -> None:
        """Keep one reading; learn from it, or judge by it."""
        nominal, in_use = found.gaps[0], found.gaps[-1]
        limit = math.inf if mind.usual is None else mind.usual.limit_at(found.level)
        beyond = in_use > limit
        with self._lock:
            mind.kept.append(
                {
                    "t_ns": record.start_ns,
                    "nominal": nominal,
                    "in_use": in_use,
                    "disagrees": beyond,
                }
            )
        if mind.usual is None:
            mind.learning.append((nominal, found.level))
            if len(mind.learning) >= self._settings.learn:
                self._learnt(twin_id, mind)
            return
        mind.against = mind.against + 1 if beyond != mind.disagrees else 0
        if mind.against >= measuring.IN_A_ROW:
            mind.against, mind.disagrees = 0, beyond
            self._tell(twin_id, mind, in_use)
        self._compared(twin_id, Comparison(nominal, in_use, limit, mind.disagrees))

    def _learnt(self, twin_id: str, mind: _TwinGap) -> None:
        settings = self._settings
        mind.usual = measuring.learn(mind.learning, settings.readings_between_false_alarms)
        usual = mind.usual
        self._pipeline.note(
            twin_id,
            LEARNT,
            "info",
            f"Learnt from {usual.readings} records the usual difference between model and "
            f"structure: the error of the free-run simulation is {usual.expected:.1%}; "
            f"{measuring.IN_A_ROW} in a row beyond "
            f"{usual.limit:.1%} will be a disagreement.",
            {
                "key": mind.key,
                "tuned": json.loads(mind.tuned),
                "usual": dataclasses.asdict(usual),
            },
        )

    def _tell(self, twin_id: str, mind: _TwinGap, in_use: float) -> None:
        assert mind.usual is not None
        usual = mind.usual
        details = {"gap": in_use, "expected": usual.expected, "limit": usual.limit}
        if not mind.disagrees:
            self._pipeline.note(
                twin_id, "agreement", "info",
                f"The model explains what arrives again: its free run is wrong by "
                f"{in_use:.1%}, and {usual.expected:.1%} is usual.",
                details,
            )  # fmt: skip
            return
        between = self._settings.readings_between_false_alarms
        seconds = measuring.IN_A_ROW * self._settings.seconds
        self._pipeline.note(
            twin_id,
            "disagreement",
            "warning",
            f"The model no longer explains what arrives: its free run is wrong by "
            f"{in_use:.1%}, and {usual.expected:.1%} is usual. By chance that is seen once in "
            f"{between:,.0f} records. Ask what is missing: POST "
            f"/api/v1/twins/{twin_id}/diagnoses, or the button on the page.",
            details | {"suggests": {"raw": {"duration_s": seconds}}},
        )

    def _drop_workers(self) -> None:
        workers, self._workers = self._workers, None
        if workers is None:
            return
        for process in list(getattr(workers, "_processes", None) or {}):
            workers._processes[process].kill()  # type: ignore[attr-defined]  # no gentler way
        workers.shutdown(wait=False, cancel_futures=True)


def _comparable(registration: Registration) -> bool:
    model = registration.model
    return model is not None and bool(model.inputs) and bool(model.sensors)


def _is_own(model: str) -> bool:
    """Whether a model has an effect that is none of the catalogue's."""
    used = {entry["effect"] for entry in json.loads(model)["effects"]}
    return bool(used - catalogue().keys())


def _end_ns(piece: SamplePiece) -> int:
    return (piece.record.start_ns or 0) + round(piece.seconds * 1e9) - 1


def _last(piece: SamplePiece, excess: int) -> SamplePiece:
    return part(piece, excess, len(piece.record.samples))


def _one_process() -> concurrent.futures.Executor:
    return concurrent.futures.ProcessPoolExecutor(
        1, multiprocessing.get_context("spawn"), initializer=_in_the_background
    )


def _in_the_background() -> None:
    """Ignore signals, and run at a low priority."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lower_priority(10)


def _sentence(state: GapState, readings: list[dict[str, Any]]) -> str:
    now = f"{readings[-1]['in_use']:.1%}" if readings else ""
    return {
        "off": "Nothing is compared: the model of this twin lists no inputs, or none is given.",
        "waiting": "Nothing has arrived yet that a model could be compared with.",
        "learning": "How far model and structure are apart anyway is still being learnt.",
        "watching": f"The model explains what arrives: its free run is wrong by {now}.",
        "disagreeing": (
            f"The model does not explain what arrives: its free run is wrong by {now}."
        ),
    }[state]
