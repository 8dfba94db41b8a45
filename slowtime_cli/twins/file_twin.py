"""A twin made of a file of modes or a recording, without a server.

It brings the whole twin server; verbs import it where no running server is asked.
"""

import contextlib
from collections.abc import Iterator

import click

from slowtime_api.twin_files import registration_of, samples_of
from slowtime_cli.shared.offline_twin import offline_twin
from slowtime_cli.shared.terminal import note
from slowtime_cli.twins.event import orders_of
from slowtime_cli.twins.twin_query import TwinQuery
from twin_server.pipeline import AssetEvents, TwinKnowledge
from twin_server.registration.twin import Registration, registrations
from twin_server.serve import ProblemError


@contextlib.contextmanager
def twin_of_file(asked: TwinQuery) -> Iterator[tuple[TwinKnowledge, str, Registration]]:
    """Make a twin of a file, and let it be asked."""
    assert asked.source is not None
    twin_id, samples = samples_of(asked.source, asked.asset, note)
    registration = _registration_of(asked, twin_id)
    with offline_twin() as (pipeline, store):
        pipeline.register(twin_id, registration)
        pipeline.ingest(samples)
        pipeline.give_up()
        if not len(store.history(twin_id, limit=1).states):
            raise click.UsageError(f"{asked.source} holds no epoch. Give one with some.")
        if asked.events is not None:
            keeping = AssetEvents(pipeline, store)
            with problems_told():
                for order in orders_of(asked.events):
                    keeping.record(twin_id, registration, order, order.person or "offline")
        yield TwinKnowledge(pipeline, store), twin_id, registration


def _registration_of(asked: TwinQuery, twin_id: str) -> Registration:
    if asked.registration is not None:
        found = registrations(asked.registration)
        if twin_id in found:
            return found[twin_id]
        if len(found) == 1 and asked.asset is None:
            return next(iter(found.values()))
        raise click.UsageError(
            f"{asked.registration} registers {', '.join(found) or 'nothing'}, not {twin_id}. "
            "Name one of them with --asset, or add it."
        )
    return registration_of(
        asked.changes, asked.nominal_hz, asked.nominal_damping, asked.learn_epochs
    )


@contextlib.contextmanager
def problems_told() -> Iterator[None]:
    """Convert a problem document of the server to a sentence."""
    try:
        yield
    except ProblemError as error:
        raise click.UsageError(error.detail) from error
