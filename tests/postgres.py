"""A PostgreSQL of the distribution's packages, in a temporary folder, for the tests alone."""

import contextlib
import os
import pwd
import shutil
import subprocess
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
    as_user: list[str] = []
    if os.getuid() == 0:  # which PostgreSQL refuses to run as
        nobody = pwd.getpwnam("nobody")
        os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        for parent in folder.parents:
            if parent.stat().st_uid == 0 and parent != Path("/"):
                with contextlib.suppress(PermissionError):
                    parent.chmod(parent.stat().st_mode | 0o011)
        as_user = ["setpriv", f"--reuid={nobody.pw_uid}", f"--regid={nobody.pw_gid}"]
        as_user += ["--clear-groups"]

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
    options = f"-k {folder} -c listen_addresses='' -c fsync=off -c max_connections=50"
    run(ctl, "-D", str(data), "-w", "-l", str(folder / "log"), "-o", options, "start")
    try:
        yield f"postgresql://{USER}@/postgres?host={folder}"
    finally:
        subprocess.run([*as_user, ctl, "-D", str(data), "-m", "immediate", "stop"], cwd=folder,
                       capture_output=True, check=False)  # fmt: skip


def schema_of(url: str, name: str) -> str:
    """Make an empty schema; give the URL of it."""
    import psycopg

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f'drop schema if exists "{name}" cascade')
        connection.execute(f'create schema "{name}"')
    return f"{url}&options=-csearch_path%3D{name}"
