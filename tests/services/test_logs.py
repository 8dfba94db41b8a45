"""Log lines: one JSON object each where asked for, and no secret in any of them."""

import json
import logging
import sys

import pytest

from slowtime_services.logs import JsonLines, Lines

SECRETS = (
    "slowtime_fcf694ff_DhF0Aq0yqxlFdo0Gn7xZVF24m5v5-8beiOl6xxSuoOQ",
    "Bearer eyJhbGciOiJSUzI1NiJ9.eyJzdWIiOiJhbm4ifQ.c2ln",
    "postgresql://slowtime:hunter2hunter2@db/twin",
    "PGPASSWORD=hunter2hunter2",
    '{"password": "hunter2hunter2"}',
    "-----BEGIN PRIVATE KEY-----\nMIGHAgEAMBMGByqGSM49\n-----END PRIVATE KEY-----",
)
HIDDEN = ("DhF0Aq0y", "eyJzdWIi", "hunter2", "MIGHAgEA")


def record(message, *arguments, exc_info=None):
    return logging.LogRecord("a.b", logging.WARNING, "f.py", 1, message, arguments, exc_info)


def test_a_record_is_one_object_on_one_line():
    line = JsonLines().format(record("%s said:\n“ends”", "lab.beam"))
    assert "\n" not in line
    said = json.loads(line)
    assert said["time"].endswith("Z")
    assert said | {"time": ""} == {
        "time": "", "level": "warning", "logger": "a.b", "message": "lab.beam said:\n“ends”",
    }  # fmt: skip


def test_an_exception_is_part_of_its_line():
    try:
        raise ValueError("too much of it")
    except ValueError:
        line = JsonLines().format(record("It failed.", exc_info=sys.exc_info()))
    assert "ValueError: too much of it" in json.loads(line)["exception"]
    assert "\n" not in line


@pytest.mark.parametrize("secret", SECRETS)
@pytest.mark.parametrize("formatter", [Lines(), JsonLines()], ids=["text", "json"])
def test_no_secret_is_written(formatter, secret):
    try:
        raise ValueError(f"refused {secret}")
    except ValueError:
        line = formatter.format(record("Given: %s", secret, exc_info=sys.exc_info()))
    assert "***" in line
    assert not [hidden for hidden in HIDDEN if hidden in line]


def test_what_is_no_secret_stays():
    said = "Edge lab.beam: tls/10.0.0.2:7447, slowtime_services.bus, postgresql://slowtime@db/x"
    assert JsonLines().format(record(said)).count("***") == 0
