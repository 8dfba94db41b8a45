"""Runs a fleet: begins what the shards need, loads the front beside it, and serves."""

import contextlib
import importlib
import importlib.util
import logging
import secrets
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from slowtime_services.logs import Format, JsonLines

from .ray_actors import EngineError, check_engine
from .ray_driver import Driver, RayFleet, begin_driver
from .supervisor import LOADED, Supervisor, load_ahead

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings

logger = logging.getLogger(__name__)


@contextlib.contextmanager
def begun(count: int | None, engine: str | None) -> Iterator[Driver | None]:
    """Begin what shards need that the command line names, before the settings are loaded.

    Parameters
    ----------
    count, engine
        As the command line gives them.

    Returns
    -------
    The driver of Ray, if it is one; `run` goes on with it.
    """
    driver = None
    if count is not None and count > 1:
        if engine in (None, "local"):
            load_ahead()
        elif importlib.util.find_spec("ray") is not None:
            root = logging.getLogger()
            driver = begin_driver(str(engine), count, root.level, _form(root))
    try:
        yield driver
    finally:
        if driver is not None:
            driver.pipe.close()


def run(
    settings: "TwinSettings",
    *,
    stop: threading.Event | None = None,
    ready: Callable[[str, Supervisor | RayFleet], None] | None = None,
    driver: Driver | None = None,
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
    driver
        Of Ray, which `begun` has begun.

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
    fleet = _fleet(settings, stop, driver)
    fleet.prepare()
    try:
        importlib.import_module(LOADED)
        from .serving import serve  # loaded for seconds, beside what was begun

        return serve(fleet, settings, stop, ready)
    finally:
        fleet.stop()


def _with_key(settings: "TwinSettings") -> "TwinSettings":
    """Make the secret by which shards know their front, for this start."""
    shards = settings.shards.model_copy(update={"key": secrets.token_urlsafe(32)})
    return settings.model_copy(update={"shards": shards})


def _fleet(
    settings: "TwinSettings", stop: threading.Event, driver: Driver | None
) -> Supervisor | RayFleet:
    """Make what runs the shards, as the settings name it."""
    root = logging.getLogger()
    level, form = root.level, _form(root)
    if settings.shards.engine == "local":
        return Supervisor(settings, stop, level=level, form=form)
    return RayFleet(settings, stop, begun=driver, level=level, form=form)


def _form(root: logging.Logger) -> Format:
    """How this process logs, so that its shards do likewise."""
    as_json = any(isinstance(handler.formatter, JsonLines) for handler in root.handlers)
    return "json" if as_json else "text"
