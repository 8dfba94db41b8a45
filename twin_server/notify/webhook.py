"""Sends events by HTTP: one signed POST each to an address that an operator declared.

No redirection is followed and no proxy of the environment is used: the request goes to that
address or nowhere, and its name may not lead to this machine or its link. Of the answer only
the status is read.
"""

import contextlib
import http.client
import os
import socket
import ssl
import time
from collections.abc import Callable
from urllib.parse import urlsplit

from slowtime_services.outbound.connections import PlainConnection, SecureConnection
from twin_server.events.receivers import WebhookReceiver

from .backoff import LONGEST_WAIT_S
from .deadlines import DEADLINES
from .message import Message, NotDeliveredError, connection_error_text, reading_error_text
from .webhook_signature import SHORTEST, signature


class Webhook:
    """Sends to one receiver; `now_s` is the time that is signed [s since 1970]."""

    def __init__(
        self, receiver: WebhookReceiver, now_s: Callable[[], float] = time.time
    ) -> None:
        self._receiver, self._now_s = receiver, now_s

    def check(self) -> None:
        """Raise where it cannot be sent to as things are."""
        self._secret()
        self._context()

    def send(self, message: Message) -> str:
        """Send; return a note on the success.

        Raises
        ------
        NotDeliveredError
            Where the receiver did not answer with a status from 200 to 299.
        """
        receiver, payload = self._receiver, message.payload
        stamp = str(int(self._now_s()))
        headers = {
            "Content-Type": "application/json",
            "User-Agent": "slowtime",
            "Idempotency-Key": message.key,
            "X-Slowtime-Event": message.event,
            "X-Slowtime-Timestamp": stamp,
            "X-Slowtime-Signature": signature(self._secret(), stamp, payload),
        }
        connection = self._connection()
        with (
            contextlib.closing(connection),
            DEADLINES.within(receiver.timeout_s, _socket(connection)),
        ):
            try:
                connection.request("POST", self._path(), payload, headers)
                with connection.getresponse() as answer:
                    status, wait = answer.status, answer.getheader("Retry-After")
            except (OSError, http.client.HTTPException) as error:
                raise NotDeliveredError(
                    f"The receiver: {connection_error_text(error)}."
                ) from error
            if 200 <= status < 300:
                return ""
            raise NotDeliveredError(
                f"The receiver answered {status}, and not from 200 to 299.", _wait_s(wait)
            )

    def _connection(self) -> http.client.HTTPConnection:
        parts = urlsplit(self._receiver.url)
        assert parts.hostname is not None
        patience, local = self._receiver.timeout_s, self._receiver.local
        if parts.scheme == "http":
            return PlainConnection(parts.hostname, parts.port, patience, local=local)
        return SecureConnection(
            parts.hostname, parts.port, patience, self._context(), local=local
        )

    def _context(self) -> ssl.SSLContext:
        return tls(self._receiver.ca)

    def _path(self) -> str:
        parts = urlsplit(self._receiver.url)
        return (parts.path or "/") + (f"?{parts.query}" if parts.query else "")

    def _secret(self) -> bytes:
        """Read the secret; again at each attempt, so that it may change."""
        receiver = self._receiver
        if receiver.secret_env is not None:
            text, where = os.environ.get(receiver.secret_env, ""), receiver.secret_env
        else:
            assert receiver.secret_file is not None
            where = receiver.secret_file.name
            try:
                text = receiver.secret_file.read_text(encoding="utf-8")
            except (OSError, ValueError) as error:
                raise NotDeliveredError(
                    f"{where} cannot be read: {reading_error_text(error)}."
                ) from error
        secret = text.strip().encode()
        if len(secret) < SHORTEST:
            raise NotDeliveredError(
                f"The secret in {where} has {len(secret)} bytes. Allowed: {SHORTEST} or more. "
                "Make one with `openssl rand -hex 32`."
            )
        return secret


def tls(ca: object) -> ssl.SSLContext:
    """Verify certificates, by the system's authorities or a file of others."""
    try:
        return ssl.create_default_context(cafile=None if ca is None else str(ca))
    except (OSError, ValueError) as error:
        raise NotDeliveredError(
            f"The certificates of `ca` cannot be read: {reading_error_text(error)}."
        ) from error


def _socket(
    connection: http.client.HTTPConnection,
) -> Callable[[], socket.socket | None]:
    return lambda: connection.sock


def _wait_s(told: str | None) -> float:
    """Return the wait that a receiver asks for [s]; dates are not read."""
    return min(float(told), LONGEST_WAIT_S) if told is not None and told.isdecimal() else 0.0
