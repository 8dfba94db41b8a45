"""What the command imports before it has anything to do: nothing that takes long.

Not timed, so that it does not depend on the machine: `benchmarks/processes/startup.py` times
it.
"""

import dataclasses
import functools
import inspect
import json
import re
import subprocess
import sys
from typing import Any

import click
import pytest

from slowtime_cli.__main__ import app
from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.verbs.models import diagnose
from slowtime_cli.verbs.operation import keys, tokens
from slowtime_services.credentials import ROLES
from slowtime_services.diagnose import run
from slowtime_services.files import ReadingOptions
from twin_server.identity.principals import Scope

LIGHT = {
    "click", "slowtime", "slowtime_api", "slowtime_cli", "slowtime_schemas", "slowtime_services"
}  # fmt: skip
"""Packages, of all that are installed, without which no argument can be read: slowtime's own,
as long as they import no arrays."""
COMPUTING = {
    "fastapi", "h5py", "mcap", "numba", "plotly", "scipy", "slowtime", "uvicorn", "zenoh"
}  # fmt: skip
"""What computes and serves; a server that is asked does both."""
SERVING = {"edge_agent", "twin_server.persist", "twin_server.pipeline", "twin_server.serve"}
PROBE = """
import contextlib, io, json, sys
before = set(sys.modules)
from slowtime_cli.__main__ import main
def imported():
    for name in sorted(set(sys.modules) - before):
        if name.partition(".")[0] not in sys.stdlib_module_names:
            yield name
told = []
for arguments in json.load(sys.stdin):
    err = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        try:
            main(arguments)
        except SystemExit as left:
            status = left.code
    told.append([arguments, status, err.getvalue(), list(imported())])
json.dump(told, sys.stdout)
"""


def commands(command: click.Command = app, path: tuple[str, ...] = ()):
    """Every verb, with the words that lead to it."""
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from commands(found, (*path, name))


WORKS = [(path, command) for path, command in commands() if isinstance(command, Deferred)]


def files_of(command: click.Command):
    """The parameters that want a file which is there."""
    for parameter in command.params:
        kind = parameter.type
        if getattr(kind, "exists", False) or isinstance(kind, diagnose.RecordName):
            yield parameter


def told_of(tries):
    """Status, errors and imports of commands that one process runs, in turn."""
    done = subprocess.run(
        [sys.executable, "-c", PROBE],
        input=json.dumps(tries),
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


@functools.cache
def probed():
    """Every help, every missing file and a wrong option of each verb, tried in one process."""
    tries = [["--version"], *([*path, "--help"] for path, _ in commands())]
    for path, command in commands():
        tries += [[*path, "--no-such-option"]]
        for parameter in files_of(command):
            flag = [parameter.opts[0]] if isinstance(parameter, click.Option) else []
            tries += [[*path, *flag, "missing.json"]]
    tries += [["diagnose", "--history", "missing.json"]]
    return told_of(tries)


def test_help_and_refusals_import_nothing_that_takes_long():
    for arguments, _, _, imported in probed():
        heavy = {name for name in imported if name.partition(".")[0] not in LIGHT}
        assert not heavy, f"slowtime {' '.join(arguments)} imported {sorted(heavy)[:9]}"


ASKED = (
    "twin forecast --asset lab.a",
    "twin risk --asset lab.a",
    "twin plan --asset lab.a",
    "twin plan --fleet",
    "twin whatif --asset lab.a --load step --amplitude 1",
    "export --asset lab.a --out a.csv",
    "export --out a.json",
    "twin composite list",
    "twin composite show lab.a",
    "twin composite export --out a.json",
    "twin event add lab.a --kind note --text seen",
    "twin event list lab.a",
    "twin event undo lab.a r1",
    "twin alarms deliveries lab.a",
    "twin alarms test lab.a",
    "twin holdings list",
    "twin holdings cancel h1",
    "twin quarantine list lab.a",
    "twin quarantine drop lab.a 1",
    "twin quarantine release lab.a 1",
)
"""Each verb that asks a server, but for its address."""
BESIDE = {
    "doctor": "asks a router, too",
    "replay": "reads a recording",
    "db ledger head": "checks signatures",
    "db ledger prove": "reads a recording",
    "twin composite add": "reads a file",
    "twin composite import": "reads a file",
}
"""Verbs that ask a server, and do something beside."""


def test_a_verb_that_asks_a_server_imports_the_client_and_nothing_that_computes():
    for path, command in commands():
        if any("--server" in parameter.opts for parameter in command.params):
            verb = " ".join(path)
            assert verb in BESIDE or any(f"{one} ".startswith(f"{verb} ") for one in ASKED)
    closed = "http://127.0.0.1:9"
    for arguments, status, said, imported in told_of(
        [[*one.split(), "--server", closed] for one in ASKED]
    ):
        assert status, arguments
        assert f"{closed} did not answer" in said
        heavy = {name for name in imported if name.partition(".")[0] in COMPUTING}
        heavy |= {name for name in imported if ".".join(name.split(".")[:2]) in SERVING}
        assert not heavy, f"slowtime {' '.join(arguments)} imported {sorted(heavy)[:9]}"


LATE = {"matplotlib", "pandas", "scipy.interpolate", "scipy.signal", "scipy.stats", "sklearn"}
"""What takes from a tenth to half a second to import, and few runs need. After a bare
`import scipy`, SciPy imports a part of itself where it is first named."""
WITH_DISTRIBUTIONS = {"design", "reliability", "surrogate"}
"""Verbs whose inputs are distributions of `scipy.stats`."""
LOADED = """
import importlib, json, sys
for module in json.load(sys.stdin):
    importlib.import_module(f"slowtime_cli.{module}")
print(*sys.modules)
"""


def test_the_work_of_a_verb_imports_late_what_few_runs_need():
    modules = {c.work.split(":")[0] for p, c in WORKS if p[0] not in WITH_DISTRIBUTIONS}
    done = subprocess.run(
        [sys.executable, "-c", LOADED],
        input=json.dumps(sorted(modules)), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert not LATE & set(done.stdout.split())


def test_of_the_shared_packages_they_import_words_and_the_options_of_files():
    imported = probed()[-1][-1]
    shared = {
        name
        for name in imported
        if name.startswith(("slowtime_schemas.", "slowtime_services."))
    }
    assert shared == {
        "slowtime_schemas.plain_text",
        "slowtime_services.argument_checks",
        "slowtime_services.files",
        "slowtime_services.files.reading_options",
        "slowtime_services.logs",
        "slowtime_services.reasons",
    }


def test_every_help_is_told_and_every_missing_file_refused_by_name():
    missing = 0
    for arguments, status, said, _ in probed():
        assert status == (0 if arguments[-1] in ("--help", "--version") else 2), arguments
        if arguments[-1] == "missing.json":
            assert re.search("'missing.json' does not exist|no file missing.json", said), said
            missing += 1
    assert missing > 20


@pytest.mark.parametrize(("path", "command"), WORKS, ids=[" ".join(path) for path, _ in WORKS])
def test_the_work_of_a_verb_takes_the_arguments_that_it_declares(path, command):
    handed_on = [one for one in command.params if one.expose_value]
    names = {parameter.name for parameter in handed_on} | {*command.fixed}
    for parameter in command.params:
        names.update(getattr(parameter, "handed_on", ()))
    given: dict[Any, Any] = dict.fromkeys(names)
    inspect.signature(command.callback).bind(**given)
    work = command.load()
    of_record = {"record_path", *(field.name for field in dataclasses.fields(ReadingOptions))}
    if hasattr(work, "__wrapped__"):  # which hands on a record in place of how to read it
        assert given.keys() > of_record
        given = {name: None for name in given.keys() - of_record} | {"record": 0, "path": 0}
    inspect.signature(work).bind(**given)


def test_what_declarations_repeat_of_the_work_is_what_it_is():
    assert tokens.SCOPES == tuple(scope.word for scope in Scope)
    assert {*keys.WITHDRAWN} == {*ROLES} - {"router", "edge"}
    assert (diagnose.PATIENCE_S, diagnose.MASSES, diagnose.MORE, diagnose.LARGE) == (
        run.PATIENCE_S,
        run.MASSES,
        run.MORE,
        run.LARGE,
    )
