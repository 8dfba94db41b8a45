"""The verbs `edge` and `twin`: processes of the house."""

import contextlib
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import click

from edge_agent.inputs import LiveInput
from edge_agent.settings import EdgeSettings

from .options import (
    ROUTER,
    endpoints,
    names,
)
from .structures import EPOCHS_PER_S, METHODS, structure


def edge(
    config: Path | None,
    site: str | None,
    asset: str | None,
    simulate: str | None,
    file: Path | None,
    recording: Path | None,
    source: str | None,
    password_file: Path | None,
    rate_hz: float | None,
    units: tuple[str, ...],
    sensitivities: tuple[str, ...],
    speed: float,
    epochs_per_s: float | None,
    channels: str | None,
    method: Literal["auto", "ambient", "free_decay", "peak", "modes", "recursive"] | None,
    band_hz: tuple[float, float] | None,
    window_s: float | None,
    hop_s: float | None,
    raw: bool | None,
    spool: Path | None,
    connect: tuple[str, ...],
    credentials: Path | None,
) -> int:
    """Run an edge agent: samples in, features with uncertainty out."""
    from edge_agent.__main__ import run

    given: dict[str, Any] | LiveInput = {}
    measured_in = _given(units=units or None, sensitivities=sensitivities or None)
    if simulate:
        given = {
            "kind": "simulated",
            "structure": structure(simulate),
            "every_s": 1 / (epochs_per_s or EPOCHS_PER_S[simulate]),
        }
    elif file:
        given = {"kind": "file", "path": file, "rate_hz": rate_hz, "speed": speed} | measured_in
    elif recording:
        given = {"kind": "recording", "path": recording, "speed": speed} | measured_in
    elif source:
        told = _given(rate_hz=rate_hz, password_file=password_file)
        given = LiveInput.of(source, **told, **measured_in)
    extract = _given(
        channels=names(channels, "--channels"),
        band_hz=band_hz or None,
        method=method or (METHODS[simulate] if simulate else None),
        window_s=window_s,
        hop_s=hop_s,
    )
    with _naming(config):
        settings = EdgeSettings(
            **_given(
                config=config,
                site=site,
                asset=asset or simulate,
                connect=_endpoints(connect, config, credentials),
                credentials=credentials,
                input=given or None,
                extract=extract or None,
                publish={"raw": "on" if raw else "off"} if raw is not None else None,
                spool={"folder": spool} if spool else None,
            )
        )
    return run(settings)


def twin(
    config: Path | None,
    host: str | None,
    port: int | None,
    database: Path | str | None,
    recordings: Path | None,
    registrations: Path | None,
    tokens: Path | None,
    ledger_key: Path | None,
    tls_certificate: Path | None,
    tls_key: Path | None,
    behind_proxy: bool,
    published_on_loopback: bool,
    connect: tuple[str, ...],
    credentials: Path | None,
) -> int:
    """Run the twin server: features in; knowledge, REST and page out."""
    from twin_server.__main__ import run
    from twin_server.registration.twin import registrations as read_registrations
    from twin_server.settings import TwinSettings

    access = _given(
        tokens=tokens,
        behind_proxy=behind_proxy or None,
        published_on_loopback=published_on_loopback or None,
    )
    with _naming(config):
        settings = TwinSettings(
            **_given(
                config=config,
                host=host,
                port=port,
                database=database,
                registrations=registrations,
                diagnose={"recordings": recordings} if recordings else None,
                connect=_endpoints(connect, config, credentials),
                credentials=credentials,
                access=access or None,
                ledger={"key": ledger_key} if ledger_key else None,
                tls={"certificate": tls_certificate, "key": tls_key} if tls_key else None,
            )
        )
    read_registrations(settings.registrations)  # refused before a router is waited for
    return run(settings)


def _given(**settings: Any) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if value is not None}


@contextlib.contextmanager
def _naming(config: Path | None) -> Iterator[None]:
    """Say which file it was that could not be read."""
    try:
        yield
    except (json.JSONDecodeError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        kind = "JSON" if config is not None and config.suffix == ".json" else "TOML"
        raise click.UsageError(f"--config {config} is not {kind}: {error}.") from error


def _endpoints(
    connect: tuple[str, ...], config: Path | None, credentials: Path | None
) -> tuple[str, ...] | None:
    """Leave the endpoint to the file, where there is one and the flag was not used."""
    left = config is not None and connect == (ROUTER,)
    return None if left else endpoints(connect, credentials)
