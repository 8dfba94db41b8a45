"""Router, twin server, MQTT broker and clock around this installation."""

import email.utils
import http.client
import json
import logging
import shutil
import socket
import ssl
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

from slowtime_cli.shared.options import endpoints

from .findings import CheckLine

NETWORK = "Network"
CLOCK = "Clock"
MAX_OFFSET_S = 300.0
"""Clock difference [s] from which a twin server refuses readings: its default of
`admission.max_ahead_s`."""
CONNECT_PACKET = bytes.fromhex("100c00044d5154540402003c0000")
"""CONNECT of MQTT 3.1.1 (section 3.1) with a clean session and an empty name of the client."""
MQTT_PORT = 1883
"""Port that IANA has registered for MQTT."""


def router(
    connect: Sequence[str], credentials: Path | None, timeout_s: float
) -> Iterator[CheckLine]:
    """Check that a Zenoh router answers, and which edge agents and servers are online."""
    connect = endpoints(connect, credentials)
    name, where = "router", ", ".join(connect)
    try:
        from slowtime_services.bus import BusUnreachableError, ZenohBus
        from slowtime_services.credentials import options_for
    except ImportError as error:
        advice = "Install it again: pip install --force-reinstall eclipse-zenoh"
        yield CheckLine(NETWORK, name, "problem", f"Zenoh cannot be loaded: {error}", advice)
        return
    logging.getLogger("slowtime_services").setLevel(logging.CRITICAL)
    try:
        options = options_for(credentials, connect)
        with ZenohBus("client", connect, open_timeout_s=timeout_s, options=options) as bus:
            watched: set[str] = set()
            watching = bus.watch(
                "slowtime/**", lambda who, alive: watched.add(who) if alive else None
            )
            time.sleep(min(0.5, timeout_s))
            watching.close()
    except BusUnreachableError:
        yield _no_router(name, where, connect, timeout_s)
    except (ValueError, OSError) as error:
        yield CheckLine(NETWORK, name, "problem", f"{where}: {error}", "Check --credentials.")
    else:
        online = f"{len(watched)} processes online" if watched else "no process online"
        yield CheckLine(NETWORK, name, "ok", f"answers at {where}; {online}")


def _no_router(name: str, where: str, connect: Sequence[str], timeout_s: float) -> CheckLine:
    for endpoint in connect:
        host, _, port = endpoint.partition("/")[2].rpartition(":")
        if port.isdigit() and _listens(host.strip("[]"), int(port), timeout_s):
            text = (
                f"{endpoint} is used by a program that is not a router (or by a router that "
                "requires credentials)"
            )
            return CheckLine(
                NETWORK, name, "problem", text,
                "Stop that program, start the router on another port (slowtime router "
                "--listen ...), or give --credentials.",
            )  # fmt: skip
    text = f"nothing listens at {where}; the port is free"
    return CheckLine(NETWORK, name, "note", text, "Start one: slowtime router")


def twin_server(url: str, timeout_s: float) -> Iterator[CheckLine]:
    """Check that a twin server answers, is ready, and agrees about the time."""
    name = "twin server"
    began = time.time()
    try:
        with urllib.request.urlopen(f"{url.rstrip('/')}/healthz", timeout=timeout_s) as answer:
            healthy = "status" in json.loads(answer.read(10_000))
            date = answer.headers.get("Date")
    except urllib.error.HTTPError as error:
        text = f"{url} answers with status {error.code}: it is not a twin server"
        yield CheckLine(NETWORK, name, "problem", text, _ANOTHER_PORT)
        return
    except (ValueError, http.client.HTTPException):
        text = f"{url} is used by another program"
        yield CheckLine(NETWORK, name, "problem", text, _ANOTHER_PORT)
        return
    except OSError as error:
        yield _no_server(name, url, error, timeout_s)
        return
    if not healthy:
        text = f"{url} is used by another program"
        yield CheckLine(NETWORK, name, "problem", text, _ANOTHER_PORT)
        return
    yield CheckLine(NETWORK, name, "ok", f"answers at {url}")
    if date:
        yield from _offset(date, (began + time.time()) / 2)


_ANOTHER_PORT = "End that program, or use another port: slowtime twin --port 8001"


def _no_server(name: str, url: str, error: OSError, timeout_s: float) -> CheckLine:
    parts = urlsplit(url)
    host, port = parts.hostname or "", parts.port or (443 if parts.scheme == "https" else 80)
    reason = getattr(error, "reason", error)
    if isinstance(reason, ssl.SSLError):
        return CheckLine(
            NETWORK, name, "problem", f"{url}: {reason}",
            "Make this computer trust the server's certificate: SSL_CERT_FILE=ca.pem",
        )  # fmt: skip
    if _listens(host, port, timeout_s):
        text = f"{url} is taken by a program that does not speak HTTP, or is too slow"
        return CheckLine(NETWORK, name, "problem", text, _ANOTHER_PORT)
    text = f"nothing listens at {url}; the port is free"
    return CheckLine(NETWORK, name, "note", text, "Start one: slowtime twin (or slowtime demo)")


def _offset(date: str, now_s: float) -> Iterator[CheckLine]:
    try:
        there_s = email.utils.parsedate_to_datetime(date).timestamp()
    except ValueError:
        return
    offset_s = now_s - there_s - 0.5  # the header has whole seconds
    text = f"{offset_s:+.0f} s from that of the twin server"
    if abs(offset_s) > MAX_OFFSET_S:
        advice = "Set the clock that is wrong; readings from the future are not accepted."
        yield CheckLine(CLOCK, "difference", "problem", text, advice)
    else:
        yield CheckLine(CLOCK, "difference", "ok", text)


def mqtt(address: str, timeout_s: float) -> Iterator[CheckLine]:
    """Check that an MQTT broker accepts a connection without a user name."""
    host, _, port = address.partition(":")
    name = "MQTT broker"
    number = int(port) if port.isdigit() else MQTT_PORT
    try:
        with socket.create_connection((host, number), timeout_s) as link:
            link.settimeout(timeout_s)
            link.sendall(CONNECT_PACKET)
            told = link.recv(4)
    except OSError as error:
        text = f"{host}:{number}: {error}"
        yield CheckLine(NETWORK, name, "problem", text, "Start one: mosquitto -p 1883")
        return
    if told[:2] != b"\x20\x02":
        text = f"{host}:{number} is not an MQTT broker"
        yield CheckLine(NETWORK, name, "problem", text, "Give its HOST:PORT; TLS is not tried.")
    elif told[3:] == b"\0":
        yield CheckLine(NETWORK, name, "ok", f"answers at {host}:{number}")
    else:
        text = f"{host}:{number} answers, and refuses with code {told[3]}"
        advice = "Give user and password in the URL of the source: mqtt://USER:PASSWORD@HOST"
        yield CheckLine(NETWORK, name, "note", text, advice)


def clock(timeout_s: float) -> Iterator[CheckLine]:
    """Check that the clock was set, and whether the system keeps it so."""
    installed_s = Path(__file__).stat().st_mtime
    now_s = time.time()
    said = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now_s))
    if now_s < installed_s - 86_400.0:
        text = f"{said} is before slowtime was installed"
        advice = "Set it; readings are stamped with it."
        yield CheckLine(CLOCK, "time", "problem", text, advice)
    else:
        yield CheckLine(CLOCK, "time", "ok", said)
    kept = _synchronized(timeout_s)
    if kept is False:
        advice = "Turn it on where edge agents run: timedatectl set-ntp true"
        yield CheckLine(CLOCK, "synchronised", "note", "not by NTP", advice)
    else:
        text = "by NTP" if kept else "not known: this system does not say"
        yield CheckLine(CLOCK, "synchronised", "ok" if kept else "note", text)


def _synchronized(timeout_s: float) -> bool | None:
    program = shutil.which("timedatectl")
    if program is None:
        return None
    try:
        done = subprocess.run(
            [program, "show", "--property", "NTPSynchronized", "--value"],
            capture_output=True, text=True, timeout=timeout_s, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return None
    return {"yes": True, "no": False}.get(done.stdout.strip())


def _listens(host: str, port: int, timeout_s: float) -> bool:
    try:
        with socket.create_connection((host, port), timeout_s):
            return True
    except OSError:
        return False
