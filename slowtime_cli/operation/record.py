"""The verb `record`: writes the messages on the bus to an MCAP recording."""

from pathlib import Path
from typing import Literal

import click

from slowtime_cli.shared.connection import connected
from slowtime_cli.shared.terminal import (
    INTERRUPTED,
    counting,
    plural,
    until_signalled,
)
from slowtime_schemas.streams import (
    BY_NAME,
    STREAMS,
    Stream,
)
from slowtime_services.record import Recorder, Recording, free_path


def record(
    out: Path,
    connect: tuple[str, ...],
    credentials: Path | None,
    asset: str,
    streams: tuple[str, ...] | None,
    duration_s: float,
    number: bool,
    keep_bytes: int | None,
    when_full: Literal["drop-oldest", "stop"],
) -> int:
    """Record the messages of the bus into an MCAP file."""
    wanted = _meant_for_recording() if streams is None else [_stream(name) for name in streams]
    site, _, name = asset.partition(".")
    path = free_path(out) if number and out.exists() and keep_bytes is None else out
    then: Literal["drop_oldest", "stop"] = "stop" if when_full == "stop" else "drop_oldest"
    with until_signalled(duration_s) as stop, connected(connect, stop, credentials) as bus:
        with Recorder(
            bus, path, streams=wanted, site=site, asset=name,
            keep_bytes=keep_bytes, when_full=then,
        ) as recorder:  # fmt: skip
            with counting("Recording") as tell:
                recorder.run(stop, lambda now: tell(_describe(now)))
        click.echo(_describe(recorder.recording))
    if recorder.full:
        click.echo(
            "slowtime: The recording stopped because its files have reached the size "
            "that --keep allows. Raise --keep, move old files away, or give --when-full "
            "drop-oldest.",
            err=True,
        )
        return 1
    return INTERRUPTED if duration_s and stop.interrupted else 0


def _meant_for_recording() -> list[Stream]:
    return [stream for stream in STREAMS if stream.recorded]


def _stream(name: str) -> Stream:
    if name not in BY_NAME:
        raise click.UsageError(f"No stream is called {name!r}. Allowed: {', '.join(BY_NAME)}.")
    return BY_NAME[name]


def _describe(now: Recording) -> str:
    counts = ", ".join(f"{count} {name}" for name, count in sorted(now.counts.items()))
    lost = f", {now.dropped} dropped" if now.dropped else ""
    lost += f", {now.unwritten} after it was full" if now.unwritten else ""
    lost += f", {plural(now.deleted, 'old file')} deleted" if now.deleted else ""
    files = ", ".join(str(path) for path in now.paths)
    return f"{counts or 'nothing yet'}{lost}, {now.bytes_written / 1e6:.1f} MB in {files}"
