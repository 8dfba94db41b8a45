"""The verb `composite`: registers, lists and exports composites of twins."""

import json
from pathlib import Path
from typing import Any

import click

from slowtime_cli.shared.terminal import plural
from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_schemas.slow_times import one_unit_in_words, span_in_words
from slowtime_services.client import Client, Composite
from slowtime_services.documents.bounds import DocumentError, document_text
from slowtime_services.documents.validation import validated
from slowtime_services.documents.yaml_lines import YamlError, read_with_lines
from slowtime_services.reasons import reason_of

NAMES = ("members", "name")
"""Keys whose values are names, even where they look like numbers."""
LEVELS = 64
"""Lists and tables within each other [1]: a composite has up to 16 gates within gates."""


def add(file: Path, composite_id: str, server: str) -> None:
    """Register a composite from a file."""
    from twin_server.composites.composite import Composite as Registration

    try:
        text = document_text(file)
        content, _ = read_with_lines(text, NAMES, depth=LEVELS)
    except YamlError as error:
        raise click.UsageError(f"{file}, line {error.line}: {error}") from error
    except DocumentError as error:
        raise click.UsageError(str(error)) from error
    if not isinstance(content, dict):
        raise click.UsageError(
            f"{file} holds no composite. Give at least `members:` with ids of twins, such as "
            "[demo.tower, demo.mast]."
        )
    validated(Registration, content, len(text))
    with server_errors_told():
        found = Client(server).register_composite(composite_id, content)
    click.echo(_sentence(found))


def list_(server: str) -> None:
    """List all composites."""
    with server_errors_told():
        every = Client(server).composites()
    for one in every:
        health = one.health
        click.echo(
            f"{one.id}  {one.kind}  {plural(health.twins, 'twin')}, "
            f"{health.valid_twins} valid, {plural(health.alarms, 'alarm')}: "
            f"{', '.join(one.members)}"
        )
    if not every:
        click.echo(
            "There are no composites. Register one: slowtime twin composite add FILE --id ID."
        )


def show(composite_id: str, horizon: float | None, as_json: bool, server: str) -> None:
    """Print health, failure probability, importance and pooled rates of a composite."""
    with server_errors_told():
        client = Client(server)
        if as_json:
            query = {"horizon": horizon}
            told = client.json("GET", f"/composites/{composite_id}", query)
            click.echo(json.dumps(told, indent=1, ensure_ascii=False))
            return
        found = client.composite(composite_id, horizon=horizon)
    click.echo(_sentence(found))
    click.echo(_health(found))
    for twin in found.twins:
        click.echo(f"  {twin.id}: {_chance(twin.failure)}{_importance(twin.importance)}")
    for pool in found.pooled:
        fleet = pool.fleet
        click.echo(
            f"Drift of {pool.quantity} in the fleet: {_number(fleet.value)} per "
            f"{one_unit_in_words(pool.slow_time_unit)} (95 %: {_number(fleet.lo)} to "
            f"{_number(fleet.hi)}); another such asset: {_number(pool.another.lo)} to "
            f"{_number(pool.another.hi)}."
        )
    for reason in (*found.failure.reasons, *found.health.reasons):
        click.echo(f"  Note: {reason}")


def import_(
    file: Path, site: str | None, relationships: tuple[str, ...], dry_run: bool, server: str
) -> None:
    """Register the composites of a graph."""
    from twin_server.serve.composites import CONTAINS, composites_of

    with server_errors_told():
        client = Client(server)
        twins = {twin.id for twin in client.twins()}
        try:
            text = document_text(file)
            found = composites_of(text, twins, site=site, contains=(*CONTAINS, *relationships))
        except (OSError, ValueError) as error:
            raise click.UsageError(f"{file}: {reason_of(error)}") from error
        for note in found.notes:
            click.echo(f"  Note: {note}")
        for name, one in found.composites.items():
            if not dry_run:
                client.register_composite(name, one.to_dict())
            click.echo(f"{name}: {', '.join(one.members)}")
    told = plural(len(found.composites), "composite")
    click.echo(f"{told} {'would be' if dry_run else 'are'} registered.")


def export(site: str | None, form: str, out: Path, server: str) -> None:
    """Write the graph of a server."""
    with server_errors_told():
        whole = Client(server).dtdl(site=site, form=form)
    out.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    click.echo(f"{out}: {out.stat().st_size:,} bytes")


def _sentence(found: Composite) -> str:
    failure = found.failure
    ahead = (
        "" if failure.horizon is None
        else f" within {span_in_words(failure.horizon, failure.slow_time_unit, digits=6)}"
    )  # fmt: skip
    bounds = failure.any_dependence
    return (
        f"{found.id} fails{ahead} with probability {_chance(failure)}; "
        f"{_number(bounds.lo)} to {_number(bounds.hi)} whatever its members' dependence."
    )


def _health(found: Composite) -> str:
    health = found.health
    worst = "" if health.worst is None else f" Most of it is due to {health.worst}."
    return (
        f"{health.valid_twins} of {plural(health.twins, 'twin')} valid, {health.alive} alive, "
        f"{plural(health.alarms, 'alarm')}.{worst}"
    )


def _chance(chance: Any) -> str:
    band = f"{_number(chance.lo)} to {_number(chance.hi)}"
    return (
        f"not known ({band})" if chance.value is None else f"{_number(chance.value)} ({band})"
    )


def _importance(importance: Any) -> str:
    if importance is None:
        return ""
    cuts = importance.fussell_vesely
    return (
        f"; Birnbaum {_number(importance.birnbaum)}, criticality "
        f"{_number(importance.criticality)}, Fussell-Vesely {_number(cuts)}"
    )


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3g}"
