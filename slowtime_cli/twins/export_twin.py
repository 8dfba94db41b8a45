"""Export of the history of a twin to CSV, Parquet, JSON-LD and DTDL."""

import contextlib
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, cast

import click

from slowtime_cli.shared.offline_twin import offline_twin
from slowtime_cli.shared.terminal import removed_unless_finished
from slowtime_services.client import AnswerError, Client
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


def export_twin(
    database: Path | None,
    server: str | None,
    asset: str | None,
    site: str | None,
    start: str | None,
    end: str | None,
    form: str,
    out: Path,
    dtdl: str | None = None,
) -> None:
    """Export the history of a twin as CSV, Parquet or DTDL."""
    graph_form: Form = "json-ld" if form == "jsonld" else "dtdl-2" if dtdl == "2" else "dtdl-3"
    with removed_unless_finished(out), _sentences():
        if server is not None:
            _of_server(Client(server), form, asset, site, start, end, out, graph_form)
        else:
            assert database is not None
            _of_file(database, form, asset, site, start, end, out, graph_form)
    click.echo(f"{out}: {out.stat().st_size:,} bytes")


def _of_server(
    client: Client,
    form: str,
    asset: str | None,
    site: str | None,
    start: str | None,
    end: str | None,
    out: Path,
    graph_form: Form,
) -> None:
    if form in ("json", "jsonld"):
        told = (
            client.dtdl(site=site, form=graph_form)
            if asset is None
            else client.dtdl_of(asset, form=graph_form)
        )
        _write(out, told)
        return
    which = _one_of([twin.id for twin in client.twins()], asset)
    kind = cast(Literal["csv", "parquet"], form)
    client.export(which, out, kind, start=start, end=end)


def _of_file(
    database: Path,
    form: str,
    asset: str | None,
    site: str | None,
    start: str | None,
    end: str | None,
    out: Path,
    graph_form: Form,
) -> None:
    moments = [None if text is None else parse_moment(text) for text in (start, end)]
    with tempfile.TemporaryDirectory() as folder:
        # A server may be writing it: what is read is a copy.
        copy = Path(folder) / "copy.sqlite"
        backup(database, copy, lambda stage, share: None)
        with offline_twin(copy) as (pipeline, store):
            knowledge = TwinKnowledge(pipeline, store)
            known = knowledge.ids(EVERYBODY)
            if form in ("json", "jsonld"):
                of_site = [i for i in known if site in (None, i.partition(".")[0])]
                chosen = of_site if asset is None else [_one_of(known, asset)]
                composites = CompositeRegistry(pipeline, store).all(EVERYBODY)
                whole = graph(list(assets_of(knowledge, chosen)), composites)
                _write(out, written_as(whole, graph_form))
                return
            which = _one_of(known, asset)
            registration = knowledge.registration(which)
            assert registration is not None
            pages = pages_of(knowledge, which, *moments)
            kind = cast(Literal["csv", "parquet"], form)
            with out.open("wb") as file:
                file.writelines(written(pages, columns_of(registration), kind, which))


def _one_of(known: list[str], asset: str | None) -> str:
    if asset is None and len(known) == 1:
        return known[0]
    if asset not in known:
        said = "Name the twin with --asset" if asset is None else f"There is no twin {asset}"
        raise click.UsageError(f"{said}. There are: {', '.join(sorted(known)) or 'none'}.")
    return asset


def _write(out: Path, whole: object) -> None:
    out.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")


@contextlib.contextmanager
def _sentences() -> Iterator[None]:
    """Convert a missing result to a sentence."""
    try:
        yield
    except (AnswerError, MomentError, NotInstalledError, WrongStoreError) as error:
        raise click.UsageError(str(error)) from error
