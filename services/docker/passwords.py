"""Makes the passwords of the containers, once: ``python passwords.py FOLDER``.

Each goes into a folder that is a volume of its own, mounted read-only where it is needed and
nowhere else. A password given by the environment is taken instead, also later. What the twin
server reads has mode 0600, as libpq asks for; PostgreSQL and Grafana run as users of their own
images, whose numbers are not known here, so that theirs have mode 0444: nobody else sees the
volume.
"""

import os
import secrets
import sys
from pathlib import Path

HOST, PORT, DATABASE, USER = "postgres", 5432, "slowtime", "slowtime"


def main(folder: Path) -> None:
    """Make the missing passwords, and print how to read them."""
    _password(folder / "grafana/password", "SLOWTIME_GRAFANA_PASSWORD")
    database = _password(folder / "postgres/password", "SLOWTIME_DATABASE_PASSWORD")
    escaped = database.replace("\\", "\\\\").replace(":", "\\:")
    line = f"{HOST}:{PORT}:{DATABASE}:{USER}:{escaped}\n"
    _write(folder / "twin/pgpass", line, mode=0o600)
    sys.stdout.write(
        "Passwords are in volumes of their own. To read them:\n"
        "  docker compose run --rm --no-deps --entrypoint cat passwords "
        "/passwords/grafana/password    (Grafana, user admin)\n"
        "  docker compose run --rm --no-deps --entrypoint cat passwords "
        "/passwords/postgres/password   (PostgreSQL, user slowtime)\n"
    )


def _password(path: Path, variable: str) -> str:
    given = os.environ.get(variable, "")
    if "\n" in given:
        sys.exit(f"{variable} has a line break. Give a password in one line.")
    password = given or (path.read_text() if path.exists() else secrets.token_urlsafe(24))
    _write(path, password, mode=0o444)
    return password


def _write(path: Path, text: str, mode: int) -> None:
    """Write a whole file in one step, so that no reader sees half of it."""
    if path.exists() and path.read_text() == text:
        return
    new = path.with_suffix(".new")
    new.unlink(missing_ok=True)
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "w") as file:
        file.write(text)
        os.fchmod(file.fileno(), mode)  # whatever the umask
        os.fsync(file.fileno())
    new.replace(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
