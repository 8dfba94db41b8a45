"""Sends events by mail, one message each, with a Message-ID that identifies duplicates."""

import smtplib
import socket
import ssl
from collections.abc import Mapping
from email.message import EmailMessage
from typing import Any

from slowtime_schemas.slow_times import time_in_words
from slowtime_services.outbound.connections import connected
from twin_server.events.receivers import EmailReceiver

from .deadlines import DEADLINES
from .message import Message, NotDeliveredError, connection_error_text, credentials
from .webhook import tls

_LONGEST_SUBJECT = 150
"""Characters of a subject, beyond which it is cut."""


class _Mail(smtplib.SMTP):
    """Connects to the address that was checked, which `SMTP` has no argument for."""

    local = False

    def _get_socket(self, host: str, port: int, timeout: float) -> socket.socket:
        return connected(host, port, timeout, local=self.local)


class _SecureMail(smtplib.SMTP_SSL):
    local = False

    def _get_socket(self, host: str, port: int, timeout: float) -> ssl.SSLSocket:
        made = connected(host, port, timeout, local=self.local)
        return self.context.wrap_socket(made, server_hostname=host)


class Email:
    """Sends to one receiver, by one connection a message."""

    def __init__(self, receiver: EmailReceiver) -> None:
        self._receiver = receiver

    def check(self) -> None:
        """Raise where it cannot be sent to as things are."""
        credentials(self._receiver.credentials_file)
        tls(self._receiver.ca)

    def send(self, message: Message) -> str:
        """Send; report recipients that the mail server refused.

        Raises
        ------
        NotDeliveredError
            Where the mail server took the message for nobody.
        """
        receiver = self._receiver
        known = credentials(receiver.credentials_file)
        mail = mail_of(message, receiver)
        server = self._server()
        with DEADLINES.within(receiver.timeout_s, lambda: getattr(server, "sock", None)):
            try:
                server.connect(receiver.host, receiver.port)
                if receiver.security == "starttls":
                    server.starttls(context=tls(receiver.ca))
                if known is not None:
                    server.login(*known)
                refused = server.send_message(mail, receiver.sender, list(receiver.to))
                server.quit()
            except smtplib.SMTPResponseException as error:
                raise NotDeliveredError(
                    f"The mail server answered {error.smtp_code} and refused."
                ) from error
            except smtplib.SMTPRecipientsRefused as error:
                raise NotDeliveredError("The mail server refused all recipients.") from error
            except (OSError, smtplib.SMTPException) as error:
                raise NotDeliveredError(
                    f"The mail server: {connection_error_text(error)}."
                ) from error
            finally:
                server.close()
        return f"Refused for {', '.join(sorted(refused))}." if refused else ""

    def _server(self) -> smtplib.SMTP:
        """Make an unconnected client, so that the deadline can close its socket."""
        receiver = self._receiver
        if receiver.security == "tls":
            made: smtplib.SMTP = _SecureMail(
                timeout=receiver.timeout_s, context=tls(receiver.ca)
            )
        else:
            made = _Mail(timeout=receiver.timeout_s)
        made.local = receiver.local  # type: ignore[attr-defined]
        # What certificates are held against; `connect` alone does not note it.
        made._host = receiver.host  # type: ignore[attr-defined]
        return made


def mail_of(message: Message, receiver: EmailReceiver) -> EmailMessage:
    """Write a message as mail."""
    mail = EmailMessage()
    mail["From"] = receiver.sender
    mail["To"] = ", ".join(receiver.to)
    mail["Subject"] = f"slowtime {message.title}"[:_LONGEST_SUBJECT]
    mail["Message-ID"] = f"<{message.key}@{receiver.sender.partition('@')[2]}>"
    mail["X-Slowtime-Event"] = message.event
    mail["Auto-Submitted"] = "auto-generated"
    told = message.content
    lines = [
        " ".join(str(told["message"]).split()),
        "",
        f"Twin: {told['twin']}",
        f"Kind: {told['kind']} ({told['severity']})",
        *_times(told),
        f"Event: {message.event}",
    ]
    if told["test"]:
        lines.append("This is a test: nothing has happened.")
    if message.page is not None:
        lines += ["", f"See it, and say that you have: {message.page}"]
    mail.set_content("\n".join(lines) + "\n")
    return mail


def _times(content: Mapping[str, Any]) -> list[str]:
    """Write the sensor time and, where it differs, the slow time with its unit."""
    sensor_time = time_in_words(content["t_ns"] / 1e9, "s")
    lines = [f"Time: {sensor_time}"] if sensor_time.endswith("UTC") else []
    if content["slow_time"] is not None:
        slow_time = time_in_words(content["slow_time"], content["slow_time_unit"])
        if slow_time != sensor_time:
            lines.append(f"Slow time: {slow_time.removeprefix('slow time ')}")
    return lines
