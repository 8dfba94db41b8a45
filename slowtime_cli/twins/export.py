"""The verb `export`: writes the history of a twin, or a record, for other programs."""

from pathlib import Path
from typing import Any, Literal

import click

from slowtime_cli.shared.terminal import removed_unless_finished

GraphForm = Literal["json-ld", "dtdl-2", "dtdl-3"]
FLAGS = ("asset", "site", "start", "end", "dtdl")
"""What is said of a twin's history, and not of a record."""
SQLITE = b"SQLite format 3\0"


def export(
    source: Path | None, server: str | None, form: str | None, out: Path, **given: Any
) -> None:
    """Export the history of a twin, or the samples of a record, in the requested form."""
    kind = form or out.suffix.removeprefix(".").lower()
    kind = "uff" if kind == "unv" else kind
    of_twin = {name: given.pop(name) for name in FLAGS}
    if server is not None or (source is not None and is_database(source)):
        _refuse(given, "a record", "this is a twin's history")
        if kind == "uff":
            raise click.UsageError(
                "A universal file holds samples, and a twin keeps none. Give a record or a "
                "recording, or write .csv, .parquet or .json."
            )
        _export_twin(source, server, of_twin, kind, out)
        return
    _refuse(of_twin, "a twin's database or --server", f"{source} is a record")
    if kind in ("json", "jsonld"):
        raise click.UsageError(
            "JSON is a graph of twins, of a database or --server. Write a record as .csv, "
            ".parquet or .uff."
        )
    from .export_record import export_record

    assert source is not None
    export_record(record_path=source, form=kind, out=out, **given)


def _export_twin(
    source: Path | None, server: str | None, which: dict[str, Any], kind: str, out: Path
) -> None:
    version = which.pop("dtdl")
    graph: GraphForm = (
        "json-ld" if kind == "jsonld" else "dtdl-2" if version == "2" else "dtdl-3"
    )
    with removed_unless_finished(out):
        if server is not None:
            from .export_server import export_server

            export_server(server, kind, out=out, graph_form=graph, **which)
        else:
            from .export_database import export_database

            assert source is not None
            export_database(source, kind, out=out, graph_form=graph, **which)
    click.echo(f"{out}: {out.stat().st_size:,} bytes")


def is_database(source: Path) -> bool:
    """Whether a file is a database by its first bytes."""
    with source.open("rb") as file:
        return file.read(len(SQLITE)) == SQLITE


def _refuse(given: dict[str, Any], goes_with: str, this: str) -> None:
    for name, value in given.items():
        if value not in (None, (), ""):
            key = {"units": "unit", "sensitivities": "sensitivity"}.get(name, name)
            flag = f"--{name}" if name in FLAGS else f"--reading {key}"
            flag = "--setting dtdl" if name == "dtdl" else flag
            raise click.UsageError(f"{flag} goes with {goes_with}; {this}. Leave it out.")
