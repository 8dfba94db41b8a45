"""A PostgreSQL of the distribution's packages, in a temporary folder, for the tests alone."""

import contextlib
import os
import pwd
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

USER = "slowtime"


def _program(name: str) -> str | None:
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return shutil.which(name, path=os.pathsep.join([*map(str, folders), os.environ["PATH"]]))


@contextlib.contextmanager
def server(folder: Path) -> Iterator[str]:
    """Run a server on a socket in `folder`; give its URL, or skip the test with the reason."""
    initdb, ctl = _program("initdb"), _program("pg_ctl")
    if initdb is None or ctl is None:
        pytest.skip("no PostgreSQL: initdb and pg_ctl are not there; apt install postgresql")
    pytest.importorskip("psycopg", reason="no psycopg: pip install 'slowtime[postgres]'")
    data = folder / "data"
    folder.mkdir(parents=True, exist_ok=True)
    as_user = _as_user()
    if as_user:
        nobody = pwd.getpwnam("nobody")
        os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        for parent in folder.parents:
            if parent.stat().st_uid == 0 and parent != Path("/"):
                with contextlib.suppress(PermissionError):
                    parent.chmod(parent.stat().st_mode | 0o011)

    def run(*words: str) -> None:
        done = subprocess.run(
            [*as_user, *words], cwd=folder, capture_output=True, text=True, timeout=300
        )
        if done.returncode:
            pytest.skip(
                f"PostgreSQL does not start here: {(done.stderr or done.stdout)[-300:]}"
            )

    run(
        initdb, "-D", str(data), "-U", USER, "--auth=trust", "--data-checksums", "--no-sync",
        "--encoding=UTF8", "--locale=C",
    )  # fmt: skip
    run(*_start(ctl, folder))
    try:
        yield f"postgresql://{USER}@/postgres?host={folder}"
    finally:
        subprocess.run([*as_user, ctl, "-D", str(data), "-m", "immediate", "stop"], cwd=folder,
                       capture_output=True, check=False)  # fmt: skip


def _as_user() -> list[str]:
    """Words before a command that is not run as root, which PostgreSQL refuses to be."""
    if os.getuid():
        return []
    nobody = pwd.getpwnam("nobody")
    return [
        "setpriv", f"--reuid={nobody.pw_uid}", f"--regid={nobody.pw_gid}", "--clear-groups"
    ]  # fmt: skip


def _start(ctl: str, folder: Path) -> list[str]:
    options = f"-k {folder} -c listen_addresses='' -c fsync=off -c max_connections=50"
    log = ("-w", "-l", str(folder / "log"), "-o", options, "start")
    return [ctl, "-D", str(folder / "data"), *log]


def kill(folder: Path) -> None:
    """Kill the server in `folder` by SIGKILL; its other processes notice it and end."""
    pid = int((folder / "data" / "postmaster.pid").read_text().split()[0])
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def restart(folder: Path, patience_s: float = 60.0) -> None:
    """Start the server in `folder` again after `kill`, once its old processes have ended."""
    ctl = _program("pg_ctl")
    assert ctl is not None
    until_s = time.monotonic() + patience_s
    while subprocess.run(
        [*_as_user(), *_start(ctl, folder)], cwd=folder, capture_output=True
    ).returncode:
        if time.monotonic() > until_s:
            raise TimeoutError(f"PostgreSQL did not start again: see {folder / 'log'}.")
        time.sleep(0.2)


def schema_of(url: str, name: str) -> str:
    """Make an empty schema; give the URL of it."""
    import psycopg

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f'drop schema if exists "{name}" cascade')
        connection.execute(f'create schema "{name}"')
    return f"{url}&options=-csearch_path%3D{name}"
