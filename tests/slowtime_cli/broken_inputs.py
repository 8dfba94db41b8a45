"""Broken inputs for every option and argument of every verb that takes a file or folder."""

import ctypes
import os
import re
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import click

from slowtime_cli.__main__ import main
from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.options import OutFile
from tests.slowtime_cli.command_tree import commands

INTERNALS = re.compile(
    r"Traceback \(most recent|<frozen |<class '|\bobject at 0x|\bat 0x[0-9a-f]{6}|"
    r"File \"[^\"]*\.py\"|site-packages|<unknown>|sys\.set_int_max_str_digits|"
    r"maximum recursion depth|<urlopen|Internal error in slowtime|\[Errno \d|<module|"
    r"slowtime_(?:cli|services|schemas)\.\w|twin_server\.\w|Warning: |DeprecationWarning"
)
"""What no message to a user shows."""

_LOGGED = re.compile(r"^\d{4}-\d\d-\d\d [\d:,]+ [A-Z]+ +[\w.]+: ", re.MULTILINE)
"""What begins a line of a log: its time, level and logger, which is named after a module."""

PATIENCE_S = 20
"""Processor time after which a command is ended [s]."""

WAIT_S = 60.0
"""After which one that waits is ended [s]."""

SERVERS = frozenset(("edge", "publish", "record", "twin run"))
"""Verbs that go on without some of the files that they may be given."""

ENDLESS = frozenset(("demo", "router run"))
"""Verbs that run until Ctrl-C with any file that they may be given."""

ENDINGS = ("", ".csv", ".json", ".yaml", ".toml", ".mcap", ".npz", ".mat", ".sqlite")
TEXTS = ("", ".csv", ".json", ".yaml", ".toml")


class Broken(NamedTuple):
    """A file that is broken, and the names under which it is given."""

    make: Callable[[Path], object]
    endings: tuple[str, ...] = ENDINGS


def _denied(path: Path) -> None:
    path.write_text("1,2\n2,3\n")
    path.chmod(0o000)


def _text(text: str) -> Broken:
    return Broken(lambda path: path.write_text(text), TEXTS)


BROKEN: dict[str, Broken] = {
    "missing": Broken(lambda path: None, ("",)),
    "folder": Broken(lambda path: path.mkdir()),
    "denied": Broken(_denied),
    "endless": Broken(lambda path: path.symlink_to("/dev/zero")),
    "empty": Broken(lambda path: path.write_bytes(b"")),
    "junk": Broken(lambda path: path.write_bytes(bytes(range(256)) * 40)),
    "zeros": Broken(lambda path: path.write_bytes(bytes(5000))),
    "words": _text("It is a letter: dear friends,\nyours\n"),
    "number": _text("7\n"),
    "null": _text("null\n"),
    "list": _text("[1, [2, {}], null]\n"),
    "table": _text('{"a": {"b": [null, 1e400]}, "slowtime_model": 1}\n'),
    "deep": _text("[" * 5000 + "]" * 5000),
    "digits": _text('{"slowtime_model": %s}' % ("9" * 5000)),
    "surrogate": _text('{"slowtime_model": "\\ud800"}'),
    "mcap": Broken(
        lambda path: path.write_bytes(b"\x89MCAP0\r\n" + b"\x01" * 200 + b"\x89MCAP0\r\n"),
        ("", ".mcap"),
    ),
}

MEMORY_BYTES = 2 << 30
"""Memory that a command may take beyond what its process has when it begins [bytes]."""


def verbs() -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command that is no group."""
    for words, command, _ in commands():
        if not isinstance(command, click.Group):
            yield tuple(words.split()), command


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


def said_of(
    words: list[str], *, closed: frozenset[int] = frozenset(), bound_by_modes: bool = False
) -> tuple[int, str]:
    """Status and output of a command, in a child of this process.

    Parameters
    ----------
    closed
        Which of 1 (stdout) and 2 (stderr) are pipes that nobody reads.
    bound_by_modes
        Whether modes of files bind it even where it runs as root.
    """
    with tempfile.TemporaryFile() as out:
        child = os.fork()
        if child == 0:
            _run(words, out, closed, bound_by_modes)
        ends = [
            threading.Timer(WAIT_S, os.kill, (child, signal.SIGTERM)),
            threading.Timer(2 * WAIT_S, os.kill, (child, signal.SIGKILL)),
        ]
        for end in ends:
            end.start()
        _, status = os.waitpid(child, 0)
        for end in ends:
            end.cancel()
        out.seek(0)
        said = _LOGGED.sub("", out.read().decode(errors="replace"))
        return os.waitstatus_to_exitcode(status), said


INTERPRETER_FAILED = 120
"""Status of the interpreter where it cannot flush its output at its end."""


def _run(words: list[str], out: Any, closed: frozenset[int], bound_by_modes: bool) -> None:
    status: Any = 99
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE_S, PATIENCE_S))
        kib = re.search(r"VmData:\s+(\d+)", Path("/proc/self/status").read_text())
        most = 1024 * int(kib[1] if kib else 0) + MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        for number in (1, 2):
            os.dup2(_unread() if number in closed else out.fileno(), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout = os.fdopen(os.dup(1), "w")
        sys.stderr = os.fdopen(os.dup(2), "w")
        if bound_by_modes:
            _drop_privileges_over_files()
        main(words)
        status = 0
    except SystemExit as ended:
        status = ended.code
    except BaseException:
        traceback.print_exc(file=os.fdopen(os.dup(out.fileno()), "w"))
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except BrokenPipeError:
            status = INTERPRETER_FAILED
        os._exit(status if isinstance(status, int) else 1)


def _drop_privileges_over_files() -> None:
    """Give up the capabilities of Linux to read and write files whatever their modes say."""
    libc = ctypes.CDLL(None, use_errno=True)
    head = (ctypes.c_uint32 * 2)(0x20080522, 0)  # _LINUX_CAPABILITY_VERSION_3, this process
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; low and high bits
    assert libc.capget(head, sets) == 0
    overrides = 1 << 1 | 1 << 2  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    sets[0] &= ~overrides
    sets[1] &= ~overrides
    assert libc.capset(head, sets) == 0


def _unread() -> int:
    """Return a pipe that nobody reads."""
    read, write = os.pipe()
    os.close(read)
    return write
