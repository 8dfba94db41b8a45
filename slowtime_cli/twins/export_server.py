"""Export of a twin that a running server keeps; the server writes it."""

import json
from pathlib import Path
from typing import Literal, cast

import click

from slowtime_services.client import AnswerError, Client, UnreachableError


def export_server(
    server: str,
    form: str,
    *,
    asset: str | None,
    site: str | None,
    start: str | None,
    end: str | None,
    out: Path,
    graph_form: Literal["json-ld", "dtdl-2", "dtdl-3"],
) -> None:
    """Let a server write the history of a twin as CSV or Parquet, or a graph of its twins."""
    try:
        client = Client(server)
        if form in ("json", "jsonld"):
            told = (
                client.dtdl(site=site, form=graph_form)
                if asset is None
                else client.dtdl_of(asset, form=graph_form)
            )
            write_graph(out, told)
            return
        which = one_of([twin.id for twin in client.twins()], asset)
        kind = cast(Literal["csv", "parquet"], form)
        client.export(which, out, kind, start=start, end=end)
    except (AnswerError, UnreachableError) as error:
        raise click.UsageError(str(error)) from error


def one_of(known: list[str], asset: str | None) -> str:
    """Return the twin that is asked for, or the only one.

    Raises
    ------
    click.UsageError
        Where several might be meant, or none is.
    """
    if asset is None and len(known) == 1:
        return known[0]
    if asset not in known:
        said = "Name the twin with --asset" if asset is None else f"There is no twin {asset}"
        raise click.UsageError(f"{said}. There are: {', '.join(sorted(known)) or 'none'}.")
    return asset


def write_graph(out: Path, graph: object) -> None:
    """Write a graph of twins as JSON."""
    out.write_text(json.dumps(graph, indent=1) + "\n", encoding="utf-8")
