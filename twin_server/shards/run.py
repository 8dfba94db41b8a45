"""Composition root of a fleet of shards: supervisor, front, HTTP server."""

import contextlib
import logging
import secrets
import threading
from collections.abc import Callable

import uvicorn

from slowtime_services.logs import Format, JsonLines
from slowtime_services.shutdown import ended_by_signals
from twin_server.__main__ import (
    OTHER_FILES,
    AddressError,
    allow_files,
    http_config,
    limits_of,
    listening_socket,
)
from twin_server.registration.twin import WrongRegistrationsError, registrations
from twin_server.serve.access import NotSecuredError, WrongTokenFileError, guarded
from twin_server.serve.http.connections import Connections
from twin_server.settings import TwinSettings

from .front import create_front
from .ray_actors import EngineError, check_engine
from .ray_driver import RayFleet
from .supervisor import Supervisor

logger = logging.getLogger(__name__)

FLEET_S = 25.0
"""How long all shards together may take to end, beside `shutdown_s` [s]; longer than the
supervisors wait until they kill one, shorter than containers are waited for."""


def run(
    settings: TwinSettings,
    *,
    stop: threading.Event | None = None,
    ready: Callable[[str, Supervisor | RayFleet], None] | None = None,
) -> int:
    """Run all shards and the front before them until `stop`, SIGINT or SIGTERM.

    Parameters
    ----------
    settings
        Of the fleet, with a `shards.count` above 1.
    stop
        Set from outside to end.
    ready
        Told the URL once the front answers, with the supervisor of the shards.

    Returns
    -------
    0 after a clean end, 2 where settings or surroundings are wrong: the log says what to do.
    """
    stop = stop or threading.Event()
    try:
        check_engine(settings)
        registrations(settings.registrations)
        settings = _with_key(settings)
        with contextlib.ExitStack() as open_things:
            grace_s = settings.shutdown_s + FLEET_S
            open_things.enter_context(ended_by_signals(stop, grace_s=grace_s))
            guard = guarded(settings)
            listening = open_things.enter_context(
                listening_socket(settings.host, settings.port)
            )
            supervisor = _supervisor(settings, stop)
            allow_files(settings.serve.max_connections * 2 + OTHER_FILES)
            app = guard.around(create_front(supervisor, settings))
            server = uvicorn.Server(
                http_config(app, settings, Connections(limits_of(settings)))
            )
            door = threading.Thread(
                target=server.run, kwargs={"sockets": [listening]}, name="http", daemon=True
            )
            supervisor.start()
            door.start()
            try:
                while not server.started and door.is_alive():
                    stop.wait(0.01)
                host, port = listening.getsockname()[:2]
                scheme = "http" if settings.tls is None else "https"
                url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"
                logger.info("%d shards are started; they answer at %s.", supervisor.count, url)
                if ready is not None:
                    ready(url, supervisor)
                while not stop.wait(0.2) and door.is_alive():
                    pass
            finally:
                server.should_exit = True
                supervisor.stop()
                door.join(settings.shutdown_s + 1.0)
    except (
        EngineError,
        NotSecuredError,
        WrongTokenFileError,
        WrongRegistrationsError,
        AddressError,
    ) as error:
        logger.error("%s", error)
        return 2
    logger.info("The shards have ended.")
    return 0


def _with_key(settings: TwinSettings) -> TwinSettings:
    """Make the secret by which shards know their front, for this start."""
    shards = settings.shards.model_copy(update={"key": secrets.token_urlsafe(32)})
    return settings.model_copy(update={"shards": shards})


def _supervisor(settings: TwinSettings, stop: threading.Event) -> Supervisor | RayFleet:
    """Make what runs the shards, as the settings name it."""
    root = logging.getLogger()
    how = Supervisor if settings.shards.engine == "local" else RayFleet
    return how(settings, stop, level=root.level, form=_form(root))


def _form(root: logging.Logger) -> Format:
    """How this process logs, so that its shards do likewise."""
    as_json = any(isinstance(handler.formatter, JsonLines) for handler in root.handlers)
    return "json" if as_json else "text"
