"""One shard: a twin server of its assets, at a port of loopback, in a process of its own."""

import contextlib
import logging
import sys
import threading
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from slowtime_services.logs import Format, formatter

if TYPE_CHECKING:
    from twin_server.settings import TwinSettings


def settings_of(settings: "TwinSettings", index: int) -> "TwinSettings":
    """Return the settings of one shard of a fleet.

    It listens on loopback, without encryption, for the front alone. The workers that compute
    forecasts are divided among the shards, each of which has at least one.
    """
    count = settings.shards.count
    return settings.model_copy(
        update={
            "host": "127.0.0.1",
            "port": 0,
            "tls": None,
            "shards": settings.shards.model_copy(update={"index": index}),
            "access": settings.access.model_copy(
                update={"behind_proxy": True, "published_on_loopback": False}
            ),
            "serve": settings.serve.model_copy(
                update={"workers": max(1, settings.serve.workers // count)}
            ),
        }
    )


def serve_shard(settings: "TwinSettings", pipe: Connection, level: int, form: Format) -> None:
    """Serve until the other end of `pipe` is closed; tell it the URL once it answers.

    Parameters
    ----------
    settings
        As `settings_of` makes them.
    pipe
        To the process that started this one, whose death closes it.
    level, form
        Least level of the log, and how it is written.
    """
    from twin_server.__main__ import run  # loaded before the fork (`supervisor.LOADED`)

    handler = logging.StreamHandler()
    handler.setFormatter(formatter(form))
    logging.basicConfig(level=level, handlers=[handler])
    stop = threading.Event()

    def until_closed() -> None:
        with contextlib.suppress(EOFError, OSError):
            pipe.recv()
        stop.set()

    threading.Thread(target=until_closed, name="parent", daemon=True).start()

    def answers(url: str) -> None:
        with contextlib.suppress(OSError):  # the parent has left
            pipe.send(url)

    sys.exit(run(settings, stop=stop, ready=answers))
