"""The application with a twin that has a history, behind its door, in this process."""

import contextlib
import datetime
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from slowtime_cli.shared.offline_twin import offline_twin
from twin_server.pipeline import (
    Alarms,
    AssetEvents,
    ChangeHistory,
    CompositeRegistry,
    QuarantineDesk,
    TwinKnowledge,
)
from twin_server.registration.twin import Registration
from twin_server.serve import Hub, create_app
from twin_server.serve.access import TokenFile, guarded
from twin_server.serve.http.problems import ProblemError
from twin_server.serve.live import LiveClient
from twin_server.settings import TwinSettings

from .wire import accepted


class Passing(Hub):
    """Live streams that end once they have begun, so that a request has an end."""

    def join(self, twin_id: str) -> LiveClient | None:
        """Watch, and no longer."""
        client = super().join(twin_id)
        if client is not None:
            client.end()
        return client


class NoDiagnoses:
    """Diagnoses of which there are none, and none can be made."""

    def __getattr__(self, name: str) -> Any:
        """Refuse."""

        def refuse(*_: Any, **__: Any) -> None:
            raise ProblemError(404, "no-such-diagnosis", "There is none.")

        return refuse


@contextlib.contextmanager
def behind_the_door() -> Iterator[tuple[Any, dict[str, Any], dict[str, str]]]:
    """Application, its OpenAPI document, and the header of an admin."""
    with contextlib.ExitStack() as stack:
        home = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        tokens = TokenFile(home / "tokens.json")
        word = tokens.add("root", "admin", ["*"], datetime.timedelta(1))
        access = {"tokens": tokens.path, "burst": 10**9, "failures_burst": 10**9}
        settings = TwinSettings(access=access)
        pipeline, store = stack.enter_context(offline_twin(home / "twin.sqlite"))
        pipeline.register("lab.beam-1", Registration())
        pipeline.ingest(accepted(2_000, seed=7))
        knowledge = TwinKnowledge(pipeline, store)
        assert knowledge.counts().get("failed_batches", 0) == 0
        told = AssetEvents(pipeline, store)
        app = create_app(
            knowledge, Passing(9, 99, 9), settings.serve, NoDiagnoses(),
            alarm_service=Alarms(pipeline, store), events=told,
            changes=ChangeHistory(pipeline, store, told),
            composite_service=CompositeRegistry(pipeline, store),
            quarantine_service=QuarantineDesk(pipeline, store),
        )  # fmt: skip
        headers = {"Authorization": f"Bearer {word}"}
        yield guarded(settings).around(app), app.openapi(), headers
