"""The verb `edge`: runs an edge agent."""

from pathlib import Path
from typing import Any, Literal

from edge_agent.inputs import LiveInput
from edge_agent.settings import EdgeSettings
from slowtime_cli.operation.settings_flags import (
    endpoints_unless_configured,
    given_settings,
    naming_config,
)
from slowtime_cli.shared.demo_structures import EPOCHS_PER_S, METHODS, structure


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
    channels: tuple[str, ...] | None,
    method: Literal["auto", "ambient", "free_decay", "peak", "modes", "recursive"] | None,
    band_hz: tuple[float, float] | None,
    window_s: float | None,
    hop_s: float | None,
    raw: bool | None,
    spool: Path | None,
    link: Literal["lab", "field", "metered"] | None,
    connect: tuple[str, ...],
    credentials: Path | None,
) -> int:
    """Run an edge agent: samples in, features with uncertainty out."""
    from edge_agent.__main__ import run

    given: dict[str, Any] | LiveInput = {}
    measured_in = given_settings(units=units or None, sensitivities=sensitivities or None)
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
        told = given_settings(rate_hz=rate_hz, password_file=password_file)
        given = LiveInput.of(source, **told, **measured_in)
    extract = given_settings(
        channels=channels,
        band_hz=band_hz or None,
        method=method or (METHODS[simulate] if simulate else None),
        window_s=window_s,
        hop_s=hop_s,
    )
    with naming_config(config):
        settings = EdgeSettings(
            **given_settings(
                config=config,
                site=site,
                asset=asset or simulate,
                connect=endpoints_unless_configured(connect, config, credentials),
                credentials=credentials,
                input=given or None,
                extract=extract or None,
                publish={"raw": "on" if raw else "off"} if raw is not None else None,
                spool={"folder": spool} if spool else None,
                link=link,
            )
        )
    return run(settings)
