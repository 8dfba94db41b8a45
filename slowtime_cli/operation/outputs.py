"""The verb `twin outputs`: sends states and events of a twin server to receivers."""

from pathlib import Path

import click

from slowtime_services import outputs as outputs_process
from slowtime_services.documents.bounds import DocumentError


def outputs(settings: Path) -> int:
    """Send states and events of a server until it is stopped."""
    try:
        given = outputs_process.OutputsSettings(config=settings)
    except DocumentError as error:
        raise click.UsageError(f"{settings}: {error}") from error
    return outputs_process.run(given, ready=lambda: click.echo("Sending."))
