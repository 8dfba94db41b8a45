"""The whole application behind its door, in this process, with tokens of every kind."""

import asyncio
import contextlib
import dataclasses
import datetime
from typing import Any

import httpx
import pytest

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
from twin_server.settings import TwinSettings

DAY = datetime.timedelta(days=1)


class Passing(Hub):
    """Live streams that end once they have begun, so that a request has an end."""

    def join(self, twin_id):
        client = super().join(twin_id)
        if client is not None:
            client.end()
        return client


class Nothing:
    """Diagnoses and recordings of which there are none."""

    def __getattr__(self, name):
        def refuse(*_, **__):
            raise ProblemError(404, "no-such-thing", "There is none.")

        return refuse


@dataclasses.dataclass
class Door:
    """What is behind the door, and the tokens that open it."""

    app: Any
    guard: Any
    tokens: TokenFile
    words: dict[str, str]
    pipeline: Any

    def ask(self, method, path, token=None, **more):
        """One request, in an event loop of its own."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        headers |= more.pop("headers", {})

        async def once():
            transport = httpx.ASGITransport(self.guard, raise_app_exceptions=False)
            async with httpx.AsyncClient(
                transport=transport, base_url="http://127.0.0.1"
            ) as client:
                return await client.request(method, path, headers=headers, **more)

        return asyncio.run(once())


@pytest.fixture(scope="package")
def door(tmp_path_factory):
    home = tmp_path_factory.mktemp("door")
    tokens = TokenFile(home / "tokens.json")
    words = {
        scope: tokens.add(f"one {scope}", scope, ["lab"], DAY)
        for scope in ("viewer", "operator", "admin")
    }
    words["admin of all"] = tokens.add("root", "admin", ["*"], DAY)
    words["other site"] = tokens.add("stranger", "admin", ["other"], DAY)
    words["expired"] = tokens.add("late", "admin", ["*"], -DAY)
    words["revoked"] = tokens.add("dismissed", "admin", ["*"], DAY)
    tokens.revoke(words["revoked"].split("_")[1])
    access = {"tokens": tokens.path, "failures_burst": 10_000, "burst": 100_000}
    settings = TwinSettings(access=access)
    with contextlib.ExitStack() as stack:
        pipeline, store = stack.enter_context(offline_twin(home / "twin.sqlite"))
        for twin_id in ("lab.beam", "other.secret"):
            pipeline.register(twin_id, Registration())
        hub = Passing(9, 99, 9)
        told = AssetEvents(pipeline, store)
        app = create_app(
            TwinKnowledge(pipeline, store), hub, settings.serve, Nothing(), Nothing(),
            alarm_service=Alarms(pipeline, store), events=told,
            changes=ChangeHistory(pipeline, store, told),
            composite_service=CompositeRegistry(pipeline, store),
            quarantine_service=QuarantineDesk(pipeline, store),
        )  # fmt: skip
        yield Door(app, guarded(settings).around(app), tokens, words, pipeline)
