"""Runs a fleet: begins what the shards need, loads the front beside it, and serves."""

import logging
import secrets
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from slowtime_services.logs import Format, JsonLines

from .ray_actors import EngineError, check_engine
from .ray_driver import RayFleet
from .supervisor import Supervisor

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)


def run(
    settings: "TwinSettings",
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
        Told the URL once the front answers, with what runs the shards.

    Returns
    -------
    0 after a clean end, 2 where settings or surroundings are wrong: the log says what to do.
    """
    stop = stop or threading.Event()
    try:
        check_engine(settings)
    except EngineError as error:
        logger.error("%s", error)
        return 2
    settings = _with_key(settings)
    fleet = _fleet(settings, stop)
    fleet.prepare()
    try:
        from .serving import serve  # loaded for seconds, beside what was begun

        return serve(fleet, settings, stop, ready)
    finally:
        fleet.stop()


def _with_key(settings: "TwinSettings") -> "TwinSettings":
    """Make the secret by which shards know their front, for this start."""
    shards = settings.shards.model_copy(update={"key": secrets.token_urlsafe(32)})
    return settings.model_copy(update={"shards": shards})


def _fleet(settings: "TwinSettings", stop: threading.Event) -> Supervisor | RayFleet:
    """Make what runs the shards, as the settings name it."""
    root = logging.getLogger()
    how = Supervisor if settings.shards.engine == "local" else RayFleet
    return how(settings, stop, level=root.level, form=_form(root))


def _form(root: logging.Logger) -> Format:
    """How this process logs, so that its shards do likewise."""
    as_json = any(isinstance(handler.formatter, JsonLines) for handler in root.handlers)
    return "json" if as_json else "text"
