"""What long work says while it goes on, and how it is ended."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)

ERR = Console(stderr=True)


@contextlib.contextmanager
def until_signalled(duration_s: float = 0.0) -> Iterator[threading.Event]:
    """Give an event that Ctrl-C, SIGTERM, or the end of `duration_s` sets."""
    stop = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    timer = threading.Timer(duration_s, stop.set) if duration_s else None
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        yield stop
    finally:
        if timer is not None:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def counting(title: str) -> Iterator[Callable[[str], None]]:
    """Show a line that changes while work of unknown length goes on; nothing off a terminal."""
    if not ERR.is_terminal:
        yield lambda _text: None
        return
    with ERR.status(f"{title} ...") as status:
        yield lambda text: status.update(f"{title}: {text}")


@contextlib.contextmanager
def bar(title: str, total: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar; the function given sets how far it is. Nothing off a terminal."""
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=ERR, transient=True, disable=not ERR.is_terminal
    ) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done: progress.update(task, completed=done)
