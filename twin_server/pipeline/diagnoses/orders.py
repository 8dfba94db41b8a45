"""Queues ordered diagnoses, keeps their results, and adopts or reverts augmented models."""

import contextlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from slowtime.dynamics.effects import catalogue
from slowtime_schemas.files.model import ModelFile
from slowtime_schemas.streams import RAW as RAW_STREAM
from slowtime_schemas.streams import request_key
from slowtime_services.bus import Bus, Sample, TwoVersionBus
from slowtime_services.clock import Clock, SystemClock
from slowtime_services.models.model_reader import parse_model
from slowtime_services.plugins.discovery import PluginError
from slowtime_services.plugins.installed_effects import installed_kinds
from slowtime_services.record import RecordingWriter
from slowtime_services.replay import block_of
from slowtime_services.reports import charts_in
from twin_server.diagnose import RAW, Ended, JobId, Jobs, Task, write_task
from twin_server.diagnose.gap import IN_A_ROW
from twin_server.fairness import OverQuotaError, Processors, Quota
from twin_server.identity.principals import Principal
from twin_server.orders import Adopted, DiagnosisOrder
from twin_server.persist import DiagnosisRow, Store
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.pipeline.ingestion.rows import address
from twin_server.pipeline.monitoring.gap import GapMonitor
from twin_server.pipeline.recording_folder import RecordingFolder
from twin_server.registration.nominal import Covariates
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError
from twin_server.serve.http.quotas import over_quota
from twin_server.settings import DiagnoseSettings, GapSettings

from .automatic import AutomaticDiagnoses
from .history_file import covariates_of, history_of, reference_of

RETRY_AFTER_S = 30
"""What a client is told to wait where too many diagnoses wait [s]: about what one takes."""

DIED = "The server ended while it was at it. Ask for it again."
_FOLLOWED = ("temperature", "load")


class Because(NamedTuple):
    """Kind, message and details of the event that says why a registration has changed."""

    kind: str
    message: str
    details: Mapping[str, Any]


class Diagnoses:
    """Orders, results and adopted models of diagnoses.

    Parameters
    ----------
    command
        That makes one diagnosis of the folder that is added to it.
    processors
        Pause diagnoses in favour of other sites.
    recordings
        Whose samples may be diagnosed; by default those of the settings' folder.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        store: Store,
        settings: DiagnoseSettings,
        gaps: GapSettings,
        command: Sequence[str],
        *,
        bus: Bus | None = None,
        clock: Clock | None = None,
        processors: Processors | None = None,
        recordings: RecordingFolder | None = None,
    ) -> None:
        self._pipeline, self._store, self._settings = pipeline, store, settings
        self._bus = None if bus is None else TwoVersionBus(bus)
        self._clock = clock or SystemClock()
        self._kept = recordings or RecordingFolder(settings.recordings)
        self._jobs = Jobs(command, settings, self._end, processors)
        self._automatic = AutomaticDiagnoses(
            self, self._registration, pipeline.note, IN_A_ROW * gaps.seconds
        )
        self._minder = GapMonitor(
            pipeline, store, gaps, self.raw_samples,
            effects=settings.effects, compared=self._automatic.compared,
        )  # fmt: skip

    def start(self) -> None:
        """Mark unfinished diagnoses as failed, and start the workers."""
        for row in self._store.diagnoses():
            if row.state in ("queued", "running"):
                now = self._clock.now_ns()
                self._store.end_diagnosis(
                    row._replace(state="failed", error=DIED, ended_ns=now)
                )
        self._jobs.start()
        self._minder.start()

    def stop(self) -> None:
        """End diagnoses in progress."""
        self._minder.stop()
        self._jobs.stop()

    @property
    def quota(self) -> Quota:
        """Diagnoses that wait or run."""
        return self._jobs.quota

    def gap(self, twin_id: str) -> Mapping[str, Any]:
        """Return the gap of the twin's models."""
        return self._minder.gap(twin_id)

    def disagrees(self, twin_id: str) -> bool:
        """Whether the model of a twin disagrees with raw samples."""
        return self._minder.disagrees(twin_id)

    def order(
        self,
        twin_id: str,
        registration: Registration,
        order: DiagnosisOrder,
        principal: Principal,
    ) -> int:
        """Take an order: samples are asked for at once, the rest waits for its turn."""
        try:
            holding = self._jobs.reserve(f"diagnosis of {twin_id}")
        except OverQuotaError as error:
            raise over_quota(error, RETRY_AFTER_S, "too-many-diagnoses") from error
        folder = Path(tempfile.mkdtemp(prefix="slowtime-diagnosis-"))
        try:
            write_task(folder, self._prepared(folder, twin_id, registration, order, principal))
            number = self._store.add_diagnosis(
                DiagnosisRow(
                    0, twin_id, self._clock.now_ns(), None, "queued", order.model_dump_json()
                ),
                self._settings.max_kept,
            )
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            holding.release()
            raise
        self._jobs.submit(JobId(twin_id, number), folder, holding)
        return number

    def all_of(self, twin_id: str) -> list[dict[str, Any]]:
        """Return all diagnoses of a twin, the newest first, with a summary of each result."""
        return [
            self._diagnosis_document(row) for row in reversed(self._store.diagnoses(twin_id))
        ]

    def one(self, twin_id: str, number: int) -> dict[str, Any] | None:
        """One diagnosis; None where there is none of that number."""
        rows = self._store.diagnoses(twin_id, number)
        return self._diagnosis_document(rows[0]) if rows else None

    def file(self, twin_id: str, number: int, name: str) -> bytes | None:
        """Return a result file; None if it does not exist."""
        if name in ("report.html", "charts.json"):
            page = self._store.diagnosis_page(twin_id, number)
            return page if name == "report.html" or page is None else _charts(page)
        if name == "augmented.yaml":
            model = self._store.diagnosis_model(twin_id, number)
        else:
            rows = self._store.diagnoses(twin_id, number)
            model = rows[0].report if rows else None
        return None if model is None else model.encode()

    def cancel(self, twin_id: str, number: int) -> bool:
        """End one that waits or runs; False where it has ended already."""
        return self._jobs.cancel(JobId(twin_id, number))

    def adopt(self, twin_id: str, registration: Registration, number: int) -> None:
        """Adopt the result of a diagnosis into the registration of the twin.

        Its history is estimated anew, as by any other registration.
        """
        report = self._report(twin_id, number)
        clock = "slow" if report.get("clock") == "slow" else "fast"
        effects = tuple(effect["effect"] for effect in report["effects"])
        one = Adopted(
            diagnosis=number,
            clock=clock,
            effects=effects,
            sentence=report["sentence"],
            model_before=registration.model if clock == "fast" else None,
            covariates_before=(
                registration.covariates.model_dump(mode="json")
                if clock == "slow" and registration.covariates is not None
                else None
            ),
        )
        if any(other.diagnosis == number for other in registration.adopted):
            raise ProblemError(
                409,
                "adopted-already",
                f"Diagnosis {number} has been adopted already. Undo it, or start a new "
                "diagnosis.",
            )
        changed = (
            {"covariates": self._followed(twin_id, registration, report)}
            if clock == "slow"
            else {"model": self._augmented(twin_id, number, report)}
        )
        given = registration.to_dict() | changed
        given["adopted"] = [*given["adopted"], one.model_dump(mode="json")]
        message = f"Adopted diagnosis {number}: {one.sentence}"
        because = Because("adopted", message, {"diagnosis": number})
        self._register(twin_id, registration, given, because)

    def undo(self, twin_id: str, registration: Registration, number: int) -> None:
        """Undo the latest adoption."""
        last = registration.adopted[-1] if registration.adopted else None
        if last is None or last.diagnosis != number:
            said = f"diagnosis {last.diagnosis}" if last else "none"
            raise ProblemError(
                409,
                "not-the-last-adopted",
                f"Undoing diagnosis {number} was asked for. The one adopted last is: {said}. "
                "Undo that one first.",
            )
        given = registration.to_dict()
        given["adopted"] = given["adopted"][:-1]
        if last.clock == "fast":
            assert last.model_before is not None
            given["model"] = last.model_before.model_dump(mode="json")
        else:
            given["covariates"] = last.covariates_before
        message = f"Undone: diagnosis {number} is no part of the twin any more."
        because = Because("undone", message, {"diagnosis": number})
        self._register(twin_id, registration, given, because)

    def _register(
        self, twin_id: str, before: Registration, given: dict[str, Any], because: Because
    ) -> None:
        """Register a twin anew, unless it was registered by somebody else meanwhile."""
        try:
            registration = Registration.model_validate(given)
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]["msg"]
            raise ProblemError(
                409,
                "not-adoptable",
                "With this diagnosis, the registration of the twin would not be valid: "
                f"{fault} Correct the registration first.",
            ) from error

        def register() -> None:
            twin = self._pipeline.twin(twin_id)
            if twin is None or twin.registration != before:
                raise ProblemError(
                    409,
                    "changed-meanwhile",
                    f"The registration of {twin_id} was changed meanwhile, and with it what "
                    "this would be added to or taken from. Look at it, and ask again.",
                )
            self._pipeline.register(twin_id, registration, *because)

        self._pipeline.call(register)

    def _report(self, twin_id: str, number: int) -> dict[str, Any]:
        rows = self._store.diagnoses(twin_id, number)
        row = rows[0] if rows else None
        report: dict[str, Any] = {} if row is None else json.loads(row.report or "{}")
        if row is None or row.state != "done" or not report["effects"]:
            verdict = report.get("verdict", "no verdict").replace("_", " ")
            raise ProblemError(
                409,
                "nothing-to-adopt",
                f"Diagnosis {number} found no effect: {verdict}. Adopt one that did; the "
                f"diagnoses of a twin are listed at /api/v1/twins/{twin_id}/diagnoses.",
            )
        return report

    def _augmented(self, twin_id: str, number: int, report: dict[str, Any]) -> dict[str, Any]:
        if report["verdict"] in ("sensor_fault", "input_fault"):
            word = report["verdict"].replace("_", " ")
            raise ProblemError(
                409,
                "nothing-to-adopt",
                f"Diagnosis {number} found a {word}, which must be repaired and cannot be "
                "adopted.",
            )
        text = self._store.diagnosis_model(twin_id, number) or ""
        named = {effect["effect"] for effect in report["effects"]}
        own = self._checked(number, named - catalogue().keys())
        return parse_model(text, "augmented.yaml", own=own).model_dump(mode="json")

    def _checked(self, number: int, own: set[str]) -> frozenset[str]:
        """Refuse effects that the operator's parts do not hold; none is imported here."""
        held: set[str] = set()
        faults: list[str] = []
        for name in self._settings.effects if own else ():
            try:
                held.update(installed_kinds(name))
            except PluginError as error:
                faults.append(str(error))
        if missing := ", ".join(sorted(own - held)):
            parts = ", ".join(self._settings.effects) or "none"
            raise ProblemError(
                409,
                "effect-not-there",
                " ".join(
                    (
                        f"Diagnosis {number} found {missing}, which slowtime does not know. "
                        f"This server may load effects from: {parts}. An operator must "
                        "name the plug-in that provides it in diagnose.effects of the "
                        "server's settings.",
                        *faults,
                    )
                ),
            )
        return frozenset(own)

    def _followed(
        self, twin_id: str, registration: Registration, report: dict[str, Any]
    ) -> dict[str, Any]:
        """Covariates that the twin is to learn and take out, as a diagnosis has named them."""
        names = [
            effect["covariate"]
            for effect in report["effects"]
            if effect["covariate"] and effect["family"] in _FOLLOWED
        ]
        if not names:
            found = ", ".join(effect["effect"] for effect in report["effects"])
            raise ProblemError(
                409,
                "nothing-to-adopt",
                f"It found {found}, which follows no temperature and no load. Changes in "
                "time are what the twin estimates and forecasts, so there is nothing to "
                "compensate.",
            )
        before = registration.covariates
        kept = () if before is None else before.names
        together = tuple(dict.fromkeys((*kept, *names)))
        most = self._settings.max_history
        learnt = covariates_of(self._store, twin_id, together, most)
        at = None if registration.nominal is None else reference_of(
            self._store, twin_id, together, most
        )  # fmt: skip
        if before is not None and before.reference is not None:
            at = (at or {}) | before.reference
        taken = Covariates(names=together, train_epochs=learnt, reference=at)
        return taken.model_dump(mode="json")

    def _diagnosis_document(self, row: DiagnosisRow) -> dict[str, Any]:
        report = json.loads(row.report) if row.report else None
        told: dict[str, Any] = {
            "number": row.number,
            "id": row.twin,
            "asked_ns": row.asked_ns,
            "ended_ns": row.ended_ns,
            "state": row.state,
            "stage": "",
            "progress": 1.0 if row.state == "done" else 0.0,
            "seconds": 0.0,
            "request": json.loads(row.request),
            "error": row.error,
            "report": report,
            "adopted": self._is_adopted(row),
        }
        job = JobId(row.twin, row.number)
        now = self._jobs.progress(job) if row.ended_ns is None else None
        if now is not None:
            told |= {
                "state": now.state,
                "stage": now.stage,
                "progress": now.share,
                "seconds": now.seconds,
            }
        return told

    def _is_adopted(self, row: DiagnosisRow) -> bool:
        twin = self._pipeline.twin(row.twin)
        taken = () if twin is None else twin.registration.adopted
        return row.number in [one.diagnosis for one in taken]

    def _end(self, job: JobId, ended: Ended) -> None:
        """Store the outcome of a diagnosis; called in the thread of the jobs."""
        rows = self._store.diagnoses(*job)
        if not rows:
            return  # its twin was deleted meanwhile
        row = rows[0]._replace(
            state=ended.state, error=ended.error, ended_ns=self._clock.now_ns()
        )
        if ended.outcome is None:
            self._store.end_diagnosis(row)
            self._automatic.ended(*job, None)
            return
        report, page, model = ended.outcome
        self._store.end_diagnosis(row._replace(report=report), page, model)
        with contextlib.suppress(ValueError):
            found = json.loads(report)
            self._pipeline.note(
                row.twin, "diagnosed", "info", f"Diagnosis {job.number}: {found['sentence']}",
                {"diagnosis": job.number},
            )  # fmt: skip
            self._automatic.ended(*job, found)

    def _registration(self, twin_id: str) -> Registration | None:
        twin = self._pipeline.twin(twin_id)
        return None if twin is None else twin.registration

    def _prepared(
        self,
        folder: Path,
        twin_id: str,
        registration: Registration,
        order: DiagnosisOrder,
        principal: Principal,
    ) -> Task:
        site, asset = address(twin_id)
        common: dict[str, Any] = {
            "site": site,
            "asset": asset,
            "order": order,
            "max_samples": self._settings.max_samples,
            "max_seconds": self._settings.max_raw_s,
            "max_memory_bytes": self._settings.max_memory_bytes,
            "effects": self._settings.effects,
            "max_own_s": self._settings.max_s / 2,
        }
        if order.clock == "slow":
            told = history_of(
                self._store, twin_id, registration, folder, self._settings.max_history
            )
            return Task(**common, **told)
        model = registration.model
        if model is None or not model.sensors:
            raise ProblemError(
                409,
                "no-model",
                f"{twin_id} has no model, or one without sensors, to compare samples with. "
                f"Give it one: PUT /api/v1/twins/{twin_id} with `model`.",
            )

        def kept(names: Sequence[str]) -> tuple[Path, ...]:
            return tuple(self._kept.of_twin(names, twin_id, principal))

        holdout = kept(order.holdout.files) if order.holdout else ()
        if order.recordings is not None:
            recordings = kept(order.recordings.files)
        else:
            assert order.raw is not None
            recordings = (folder / RAW,)
            self._ask_edge(twin_id, model, order.raw.duration_s, recordings[0])
        return Task(**common, model=model, recordings=recordings, holdout=holdout)

    def _ask_edge(self, twin_id: str, model: ModelFile, seconds: float, path: Path) -> None:
        """Ask the edge for its last samples, and write them as a recording."""
        if seconds > self._settings.max_raw_s:
            raise ProblemError(
                422,
                "too-long",
                f"{seconds:g} s of samples were asked for. Allowed: up to "
                f"{self._settings.max_raw_s:g} (diagnose.max_raw_s).",
            )
        site, asset = address(twin_id)
        samples = self.raw_samples(twin_id, seconds)
        found = {
            channel for sample in samples for channel in block_of(sample.payload)[1].channels
        }
        wanted = [entry.channel for entry in model.inputs]
        heard = [entry.channel for entry in model.sensors if entry.channel in found]
        missing = [name for name in wanted if name not in found]
        if missing or not heard:
            raise ProblemError(
                409,
                "channels-missing",
                f"The edge sends {', '.join(sorted(found))}; the model needs "
                f"{', '.join(missing or [s.channel for s in model.sensors])}. Give "
                "channels the same names at the edge and in the model.",
            )
        with RecordingWriter(path) as writer:
            for sample in samples:
                header, _ = block_of(sample.payload)
                writer.write(RAW_STREAM, site, asset, sample.payload, header.t_ns)

    def raw_samples(self, twin_id: str, seconds: float) -> list[Sample]:
        """Ask the edge for raw blocks now.

        Parameters
        ----------
        seconds
            Duration of the samples, up to now [s].

        Raises
        ------
        ProblemError
            Where nobody answers, or with what is no raw block.
        """
        site, asset = address(twin_id)
        answers = () if self._bus is None else self._bus.ask(
            request_key(site, asset, "raw"),
            {"seconds": f"{seconds:g}"},
            timeout_s=self._settings.ask_timeout_s,
        )  # fmt: skip
        if not answers:
            alive = self._pipeline.is_alive(twin_id)
            why = "is there, but keeps no samples yet" if alive else "is away"
            raise ProblemError(
                409,
                "no-samples",
                f"The edge agent of {twin_id} {why}, so it cannot be asked for raw "
                "samples. Start it, wait until it is online, or give recordings instead.",
            )
        try:
            for sample in answers:
                block_of(sample.payload)
        except ValueError as error:
            raise ProblemError(502, "no-samples", f"{twin_id}: {error}") from error
        return list(answers)


def _charts(page: bytes) -> bytes:
    """Return the charts of a report, without the library that draws them."""
    charts = [
        {"heading": heading, "data": chart.data, "layout": chart.layout, "words": chart.words}
        for heading, chart in charts_in(page.decode())
    ]
    return json.dumps({"charts": charts}).encode()
