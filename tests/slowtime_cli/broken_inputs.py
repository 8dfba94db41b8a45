"""Broken inputs for every option and argument of every verb that takes a file or folder."""

import os
import re
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from slowtime_cli.__main__ import VERBS, Verbs, main
from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import OutFile

INTERNALS = re.compile(
    r"Traceback \(most recent|<frozen |<class '|\bobject at 0x|\bat 0x[0-9a-f]{6}|"
    r"File \"[^\"]*\.py\"|site-packages|<unknown>|sys\.set_int_max_str_digits|"
    r"maximum recursion depth|<urlopen|Internal error in slowtime|\[Errno \d|<module|"
    r"slowtime_(?:cli|services|schemas)\.\w|twin_server\.\w|Warning: |DeprecationWarning"
)
"""What no message to a user shows."""

PATIENCE_S = 20
"""Processor time after which a command is ended [s]."""

WAIT_S = 120.0
"""After which one that waits is ended [s]."""

ENDLESS = frozenset(("demo", "router"))
"""Verbs that run until Ctrl-C with any file that they may be given."""

BROKEN: dict[str, Callable[[Path], object]] = {
    "missing": lambda path: None,
    "folder": lambda path: path.mkdir(),
    "empty": lambda path: path.write_bytes(b""),
    "junk": lambda path: path.write_bytes(bytes(range(256)) * 40),
    "zeros": lambda path: path.write_bytes(bytes(5000)),
    "words": lambda path: path.write_text("It is a letter: dear friends,\nyours\n"),
    "number": lambda path: path.write_text("7\n"),
    "null": lambda path: path.write_text("null\n"),
    "list": lambda path: path.write_text("[1, [2, {}], null]\n"),
    "table": lambda path: path.write_text('{"a": {"b": [null, 1e400]}, "slowtime_model": 1}\n'),
    "deep": lambda path: path.write_text("[" * 5000 + "]" * 5000),
    "digits": lambda path: path.write_text('{"slowtime_model": %s}' % ("9" * 5000)),
    "surrogate": lambda path: path.write_text('{"slowtime_model": "\\ud800"}'),
    "mcap": lambda path: path.write_bytes(b"\x89MCAP0\r\n" + b"\x01" * 200 + b"\x89MCAP0\r\n"),
}
ENDINGS = ("", ".csv", ".json", ".yaml", ".toml", ".mcap", ".npz", ".mat", ".sqlite")


def verbs() -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every verb, and every command within one."""
    group = Verbs()
    context = click.Context(group)
    for name in VERBS:
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            for inner in command.list_commands(context):
                found = command.get_command(context, inner)
                assert found is not None
                yield (name, inner), found
        else:
            yield (name,), command


def preload() -> None:
    """Import the work of all verbs, so that a child need not."""
    for _, command in verbs():
        if isinstance(command, Deferred):
            command.load()


def is_read(param: click.Parameter) -> bool:
    """Whether an option or argument is a file or folder that is read."""
    kind = param.type
    named = type(kind).__name__ in ("Database", "RecordPath")
    return (isinstance(kind, click.Path) and not isinstance(kind, OutFile)) or named


def plausible(param: click.Parameter) -> str:
    """A value of the kind that an option takes."""
    kind = param.type
    if isinstance(kind, OutFile):
        ending = (getattr(kind, "endings", None) or getattr(kind, "_endings", None) or [""])[0]
        return f"out{ending}"
    if isinstance(kind, click.Choice):
        return str(kind.choices[0])
    name = type(kind).__name__
    if name == "Name":
        parts = getattr(kind, "_pattern", re.compile("")).pattern.count("a-z0-9][")
        return "lab.beam" if parts > 1 else "lab"
    if name in ("IntRange", "IntParamType"):
        return "2"
    if name in ("FloatRange", "Number"):
        return "0.5"
    return "2022-07-19T22:55:00Z" if name == "Instant" else "x"


def arguments(command: click.Command, param: click.Parameter, file: str) -> list[str]:
    """Words that give a file to one parameter and plausible values to those that are needed."""
    words: list[str] = []
    last: list[str] = []
    for one in command.params:
        if one is param or one.required:
            value = file if one is param or is_read(one) else plausible(one)
            if isinstance(one, click.Argument):
                last.append(value)
            else:
                words += [one.opts[0], value]
    return [*words, *last]


def said_of(words: list[str]) -> tuple[int, str]:
    """Status and output of a command, in a child of this process."""
    with tempfile.TemporaryFile() as out:
        child = os.fork()
        if child == 0:
            _run(words, out)
        end = threading.Timer(WAIT_S, os.kill, (child, signal.SIGKILL))
        end.start()
        _, status = os.waitpid(child, 0)
        end.cancel()
        out.seek(0)
        return os.waitstatus_to_exitcode(status), out.read().decode(errors="replace")


def _run(words: list[str], out: Any) -> None:
    status: Any = 99
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE_S, PATIENCE_S))
        os.dup2(out.fileno(), 1)
        os.dup2(out.fileno(), 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = os.fdopen(os.dup(1), "w")
        sys.stderr = os.fdopen(os.dup(2), "w")
        main(words)
        status = 0
    except SystemExit as ended:
        status = ended.code
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status if isinstance(status, int) else 1)
