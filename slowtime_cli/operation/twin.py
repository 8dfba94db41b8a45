"""The verb `twin`: runs the twin server."""

from pathlib import Path

from slowtime_cli.operation.settings_flags import (
    endpoints_unless_configured,
    given_settings,
    naming_config,
)


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
    shards: int | None,
    engine: str | None,
) -> int:
    """Run the twin server: features in; estimates, REST and page out."""
    from twin_server.shards import begun

    with begun(shards, engine) as driver:
        from twin_server.registration.twin import registrations as read_registrations
        from twin_server.settings import TwinSettings

        access = given_settings(
            tokens=tokens,
            behind_proxy=behind_proxy or None,
            published_on_loopback=published_on_loopback or None,
        )
        divided = given_settings(count=shards, engine=engine)
        with naming_config(config):
            settings = TwinSettings(
                **given_settings(
                    config=config,
                    host=host,
                    port=port,
                    database=database,
                    registrations=registrations,
                    diagnose={"recordings": recordings} if recordings else None,
                    connect=endpoints_unless_configured(connect, config, credentials),
                    credentials=credentials,
                    access=access or None,
                    shards=divided or None,
                    ledger={"key": ledger_key} if ledger_key else None,
                    tls={"certificate": tls_certificate, "key": tls_key} if tls_key else None,
                )
            )
        read_registrations(settings.registrations)  # refused before a router is waited for
        if settings.shards.count > 1 and settings.shards.index is None:
            from twin_server.shards import run as run_shards

            return run_shards(settings, driver=driver)

        from twin_server.__main__ import run

        return run(settings)
