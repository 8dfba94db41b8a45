"""Reads secrets from files, again at each connection, so that they may change."""

from pathlib import Path

from slowtime_services.reasons import reason_of

from .batch import NotSentError


def secret_of(path: Path) -> str:
    """Return the content of a file, without blanks at the ends."""
    secret = _text(path).strip()
    if not secret:
        raise NotSentError(f"{path} is empty. Write the token into it.", is_refused=True)
    return secret


def user_and_password(path: Path | None) -> tuple[str, str] | None:
    """Return user and password of a file with a line each; None without a file."""
    if path is None:
        return None
    lines = _text(path).splitlines()
    if len(lines) < 2 or not lines[0]:
        raise NotSentError(
            f"{path} holds {len(lines)} line(s). Give the user in the first line and the "
            "password in the second.",
            is_refused=True,
        )
    return lines[0], lines[1]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise NotSentError(f"A secret cannot be read: {reason_of(error)}") from error
