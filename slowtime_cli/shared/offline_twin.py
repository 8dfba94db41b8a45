"""A twin without network, page or clock."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings


@contextlib.contextmanager
def offline_twin(database: Path | None = None) -> Iterator[tuple[Pipeline, SqliteStore]]:
    """Yield a working pipeline and its store; in a temporary file by default."""
    with contextlib.ExitStack() as stack:
        if database is None:
            folder = tempfile.TemporaryDirectory(prefix="slowtime-")
            database = Path(stack.enter_context(folder)) / "twin.sqlite"
        store = stack.enter_context(contextlib.closing(SqliteStore(database)))
        pipeline = Pipeline(TwinSettings(database=database, connect=()), store)
        pipeline.start()
        stack.callback(pipeline.stop)
        yield pipeline, store
