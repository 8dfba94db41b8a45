"""Serves a fleet of shards: the front and its HTTP server."""

import contextlib
import logging
import threading
from collections.abc import Callable

import uvicorn

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
from .ray_actors import EngineError
from .ray_driver import RayFleet
from .supervisor import Supervisor

logger = logging.getLogger(__name__)

FLEET_S = 25.0
"""How long all shards together may take to end, beside `shutdown_s` [s]; longer than the
supervisors wait until they kill one, shorter than containers are waited for."""


def serve(
    fleet: Supervisor | RayFleet,
    settings: TwinSettings,
    stop: threading.Event,
    ready: Callable[[str, Supervisor | RayFleet], None] | None,
) -> int:
    """Start the shards, and answer for them until `stop` is set; return the exit code.

    Parameters
    ----------
    fleet
        Runs the shards.
    settings, stop, ready
        As those of `run`.
    """
    try:
        registrations(settings.registrations)
        with contextlib.ExitStack() as open_things:
            grace_s = settings.shutdown_s + FLEET_S
            open_things.enter_context(ended_by_signals(stop, grace_s=grace_s))
            guard = guarded(settings)
            listening = open_things.enter_context(
                listening_socket(settings.host, settings.port)
            )
            allow_files(settings.serve.max_connections * 2 + OTHER_FILES)
            app = guard.around(create_front(fleet, settings))
            server = uvicorn.Server(
                http_config(app, settings, Connections(limits_of(settings)))
            )
            door = threading.Thread(
                target=server.run, kwargs={"sockets": [listening]}, name="http", daemon=True
            )
            fleet.start()
            door.start()
            try:
                while not server.started and door.is_alive():
                    stop.wait(0.01)
                host, port = listening.getsockname()[:2]
                scheme = "http" if settings.tls is None else "https"
                url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"
                logger.info("%d shards are started; they answer at %s.", fleet.count, url)
                if ready is not None:
                    ready(url, fleet)
                while not stop.wait(0.2) and door.is_alive():
                    pass
            finally:
                server.should_exit = True
                fleet.stop()
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
