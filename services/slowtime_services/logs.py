"""Logs of processes: lines for people, or JSON lines for a collector.

Secrets are not logged; should one slip into a message, it is blotted out.
"""

import datetime
import json
import logging
import re
from typing import Literal

Format = Literal["text", "json"]

_SECRETS = (
    (re.compile(r"\b(slowtime_[0-9a-f]{8}_)[\w-]{8,}"), r"\1***"),
    (re.compile(r"(?i)\b(bearer\s+)[\w.~+/=-]{8,}"), r"\1***"),
    (re.compile(r"(?i)(://[^\s:/@]+:)[^\s/@]+@"), r"\1***@"),
    (re.compile(r"(?i)\b((?:pg)?password[\"']?\s*[=:]\s*[\"']?)[^\s\"',;]+"), r"\1***"),
    (re.compile(r"-----BEGIN [A-Z ]*PRIVATE KEY-----.*?(?:-----END|$)", re.DOTALL), "***"),
)


def without_secrets(text: str) -> str:
    """Blot out tokens, passwords and keys.

    Examples
    --------
    >>> without_secrets("postgresql://ann:hunter2@db/twin, Authorization: Bearer abcdefgh.ijk")
    'postgresql://ann:***@db/twin, Authorization: Bearer ***'
    """
    for secret, instead in _SECRETS:
        text = secret.sub(instead, text)
    return text


class Lines(logging.Formatter):
    """A line for people."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Write one record, traceback and all."""
        return without_secrets(super().format(record))


class JsonLines(logging.Formatter):
    """One JSON object a line: time, level, logger, message; exception where there is one."""

    def format(self, record: logging.LogRecord) -> str:
        """Write one record as one line."""
        when = datetime.datetime.fromtimestamp(record.created, datetime.UTC)
        said = {
            "time": when.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": without_secrets(record.getMessage()),
        }
        if record.exc_info:
            said["exception"] = without_secrets(self.formatException(record.exc_info))
        return json.dumps(said, ensure_ascii=False)


def formatter(form: Format) -> logging.Formatter:
    """Make the formatter of a name."""
    return JsonLines() if form == "json" else Lines()
