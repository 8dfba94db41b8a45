"""The verb `replay`: plays an MCAP recording onto the bus, into a twin or through the edge."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

import click
from pydantic_core import from_json

from edge_agent.pipeline import rerun
from edge_agent.settings import Processing
from slowtime_cli.shared.connection import connected
from slowtime_cli.shared.offline_twin import offline_twin
from slowtime_cli.shared.terminal import (
    INTERRUPTED,
    bar,
    counting,
    note,
    removed_unless_finished,
    until_signalled,
)
from slowtime_schemas.codec import decode, encode
from slowtime_schemas.messages import About, Features
from slowtime_schemas.streams import (
    ABOUT,
    ASSET_EVENT,
    FATIGUE,
    FEATURES,
    RAW,
    REGISTRATION,
    Stream,
    parse_key,
)
from slowtime_services.bus import Sample
from slowtime_services.client import AnswerError, Client, UnreachableError
from slowtime_services.record.writer import COUNTED_ONCE, WINDOWS
from slowtime_services.replay import ReplayProgress, contents, raw_blocks, read_recording
from slowtime_services.replay import replay as replay_file

T = TypeVar("T")

INGESTED: tuple[Stream, ...] = (REGISTRATION, FEATURES, ASSET_EVENT, FATIGUE)
"""Streams that a fresh database is made of."""


def replay(
    recording: Path,
    connect: tuple[str, ...],
    credentials: Path | None,
    speed: float,
    fast: bool,
    server: str | None,
    database: Path | None,
    edge: bool,
) -> int:
    """Replay a recording and print the hash of its history."""
    if edge:
        return _through_the_edge(recording)
    if database is not None:
        return _into(recording, database)
    contents(recording)  # refused before a router is waited for
    pace = math.inf if fast else speed
    return _onto_the_bus(recording, connect, credentials, pace, server)


def _onto_the_bus(
    recording: Path,
    connect: tuple[str, ...],
    credentials: Path | None,
    speed: float,
    server: str | None,
) -> int:
    with (
        until_signalled() as stop,
        connected(connect, stop, credentials) as bus,
        bar("Replaying", 1) as tell,
    ):
        played = replay_file(recording, bus, speed=speed, stop=stop, progress=_share(tell))
    counts = ", ".join(f"{count} {name}" for name, count in sorted(played.counts.items()))
    click.echo(
        f"{counts} in {played.duration_s:.1f} s; {played.acknowledged} of {played.features} "
        "features acknowledged"
    )
    if stop.interrupted:
        return INTERRUPTED
    if played.features == 0:
        note(
            f"{recording} holds no features, and a twin reads only features. If it holds "
            f"samples, run: slowtime edge --file {recording}"
        )
    if server is not None:
        for asset in _assets(recording):
            _print_hash(asset, _asked_of(server, asset))
    return 0 if played.complete else 1


def _asked_of(server: str, asset: str) -> Mapping[str, object]:
    try:
        return Client(server).digest(asset).model_dump()
    except (AnswerError, UnreachableError, ValueError) as error:
        raise click.UsageError(
            f"--server {server} did not return the hash of {asset}: {error}"
        ) from error


def _share(tell: Callable[[float], None]) -> Callable[[ReplayProgress], None]:
    return lambda now: tell(now.done / max(now.total, 1))


def _into(recording: Path, database: Path) -> int:
    if database.exists():
        raise click.UsageError(
            f"{database} exists. Give a new file, so that the history is fresh."
        )
    assets = list(_assets(recording))
    through_the_edge = not assets and bool(_assets_of(recording, RAW))
    if through_the_edge:
        assets = _assets_of(recording, RAW)
        note(
            f"{recording} holds samples but no features; an edge agent with default "
            "settings computes them here. To choose the settings, run slowtime edge "
            "--file."
        )
    if not assets:
        raise click.UsageError(
            f"{recording} holds neither features nor samples for a twin. Give a recording of "
            "`slowtime record`, `slowtime import` or `slowtime simulate`."
        )
    with (
        removed_unless_finished(database),
        offline_twin(database) as (pipeline, store),
        bar("Replaying", _how_many(recording, through_the_edge)) as tell,
    ):
        read = _features_of_samples if through_the_edge else _samples
        pipeline.ingest(read(recording, tell))
        pipeline.give_up()
        for asset in assets:
            digest, count = store.digest(asset)
            _print_hash(asset, {"sha256": digest, "features": count})
        repeated = pipeline.refusals.counts["measured_before"]
        if contents(recording).metadata.get(WINDOWS) != COUNTED_ONCE:
            _tell_of_rule(recording, repeated, pipeline.counts["overlapping"])
    return 0


def _tell_of_rule(recording: Path, repeated: int, overlapping: int) -> None:
    """Say where the history differs from that of the version that recorded it."""
    if repeated or overlapping:
        note(
            f"{recording} was recorded by a version that counted windows of the same time "
            f"again under each boot. Now each counts once: {repeated} repeated windows were "
            f"left out, and {overlapping} count by the share of their time that is new. The "
            "hash differs from that of the server that recorded it."
        )


def _features_of_samples(recording: Path, tell: Callable[[float], None]) -> Iterator[Sample]:
    """Read registrations of a recording, and compute features from its raw blocks."""
    for message in read_recording(recording, streams=[REGISTRATION]):
        yield Sample(message.key, message.payload, message.publish_ns, replayed=True)
    blocks = _told(raw_blocks(recording), tell)
    for payload in rerun(blocks, Processing()):
        features = decode(FEATURES, payload)
        key = FEATURES.key(features.site, features.asset)
        yield Sample(key, payload, None, replayed=True)


def _told(blocks: Iterable[T], tell: Callable[[float], None]) -> Iterator[T]:
    """Say of each block that it is read."""
    for number, block in enumerate(blocks):
        tell(number)
        yield block


def _how_many(recording: Path, through_the_edge: bool) -> int:
    streams = (RAW,) if through_the_edge else INGESTED
    return contents(recording, streams=streams).messages


def _samples(recording: Path, tell: Callable[[float], None]) -> Iterator[Sample]:
    messages = read_recording(recording, streams=INGESTED)
    for number, message in enumerate(messages):
        if number % 1000 == 0:
            tell(number)
        yield Sample(message.key, message.payload, message.publish_ns, replayed=True)


def _print_hash(asset: str, digest: Mapping[str, object]) -> None:
    click.echo(f"{asset}  sha256:{digest['sha256']}  of {digest['features']} features")


def _through_the_edge(recording: Path) -> int:
    recorded = {message.payload for message in read_recording(recording, streams=[FEATURES])}
    older = {_without_units(payload) for payload in recorded if _is_older(payload)}
    total = same = 0
    with counting("Running the edge again") as tell:
        for site, asset in _listened_to(recording):
            processing = _recorded_settings(recording, site, asset)
            for payload in rerun(raw_blocks(recording, site=site, asset=asset), processing):
                total += 1
                same += payload in recorded or bool(older and _without_units(payload) in older)
                tell(f"{site}.{asset}, {same} of {total} features identical")
    click.echo(f"{same} of {total} features identical to those recorded, byte for byte")
    return 0 if same == total else 1


def _is_older(payload: bytes) -> bool:
    """Whether features are of a version without units."""
    return bool(from_json(payload)["version"] < Features.VERSION)


def _without_units(payload: bytes) -> bytes:
    """Features as they are now, but for the units."""
    features = decode(FEATURES, payload)
    return encode(features.model_copy(update={"units": ()}))


def _listened_to(recording: Path) -> list[tuple[str, str]]:
    keys = contents(recording, streams=[RAW]).counts
    found = sorted({parse_key(key)[1:] for key, count in keys.items() if count})
    if not found:
        raise click.UsageError(
            f"{recording} holds no raw blocks. Run the edge with --setting raw=yes while "
            "recording."
        )
    return found


def _recorded_settings(recording: Path, site: str, asset: str) -> Processing:
    key = ABOUT.key(site, asset)
    for message in read_recording(recording, streams=[ABOUT]):
        if message.key == key:
            about = decode(ABOUT, message.payload)
            assert isinstance(about, About)
            return Processing.from_about(about)
    raise click.UsageError(
        f"{recording} does not hold the settings of the edge agent of {site}.{asset}. Record "
        "the stream 'about' too."
    )


def _assets(recording: Path) -> Iterator[str]:
    return iter(_assets_of(recording, FEATURES))


def _assets_of(recording: Path, stream: Stream) -> list[str]:
    keys = contents(recording, streams=[stream]).counts
    return sorted({".".join(parse_key(key)[1:]) for key, count in keys.items() if count})
