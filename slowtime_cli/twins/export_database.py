"""Export of a twin out of its database, which a server may be writing to."""

import tempfile
from pathlib import Path
from typing import Literal, cast

import click

from slowtime_cli.shared.offline_twin import offline_twin
from twin_server.identity.principals import EVERYBODY
from twin_server.persist import WrongStoreError, backup
from twin_server.pipeline import CompositeRegistry, TwinKnowledge
from twin_server.serve.exports import (
    Form,
    NotInstalledError,
    assets_of,
    columns_of,
    graph,
    pages_of,
    written,
    written_as,
)
from twin_server.serve.instants import MomentError, parse_moment

from .export_server import one_of, write_graph


def export_database(
    database: Path,
    form: str,
    *,
    asset: str | None,
    site: str | None,
    start: str | None,
    end: str | None,
    out: Path,
    graph_form: Form,
) -> None:
    """Write the history of a twin as CSV or Parquet, or a graph of the twins."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            moments = [None if text is None else parse_moment(text) for text in (start, end)]
            copy = Path(folder) / "copy.sqlite"
            backup(database, copy, lambda stage, share: None)
            with offline_twin(copy) as (pipeline, store):
                knowledge = TwinKnowledge(pipeline, store)
                known = knowledge.ids(EVERYBODY)
                if form in ("json", "jsonld"):
                    of_site = [i for i in known if site in (None, i.partition(".")[0])]
                    chosen = of_site if asset is None else [one_of(known, asset)]
                    composites = CompositeRegistry(pipeline, store).all(EVERYBODY)
                    whole = graph(list(assets_of(knowledge, chosen)), composites)
                    write_graph(out, written_as(whole, graph_form))
                    return
                which = one_of(known, asset)
                registration = knowledge.registration(which)
                assert registration is not None
                pages = pages_of(knowledge, which, *moments)
                kind = cast(Literal["csv", "parquet"], form)
                with out.open("wb") as file:
                    file.writelines(written(pages, columns_of(registration), kind, which))
    except (MomentError, NotInstalledError, WrongStoreError) as error:
        raise click.UsageError(str(error)) from error
