"""Connections by TCP and HTTP to a name that is looked up and checked once."""

import http.client
import socket
import ssl
import urllib.request
from collections.abc import Callable
from typing import Any

from .addresses import look_up


def connected(host: str, port: int, timeout_s: float, *, local: bool = False) -> socket.socket:
    """Connect to one of the addresses of a name.

    Parameters
    ----------
    host, port
        Of the settings.
    timeout_s
        For one address [s].
    local
        Whether the settings allow addresses of this machine and its link.

    Raises
    ------
    OSError
        Of the last address, where none answers; `LocalAddressError` where one is not allowed.
    """
    failure: OSError = OSError("it has no address")
    for family, place in look_up(host, port, local=local):
        made = socket.socket(family, socket.SOCK_STREAM)
        try:
            made.settimeout(timeout_s)
            made.connect(place)
        except OSError as error:
            failure = error
            made.close()
        else:
            return made
    raise failure


class PlainConnection(http.client.HTTPConnection):
    """HTTP to a checked address; redirects are answers as any others."""

    def __init__(
        self, host: str, port: int | None, timeout_s: float, *, local: bool = False
    ) -> None:
        super().__init__(host, port, timeout=timeout_s)
        self._timeout_s, self._local = timeout_s, local

    def connect(self) -> None:
        """Connect to the address that the name leads to now."""
        self.sock = connected(self.host, self.port, self._timeout_s, local=self._local)


class SecureConnection(PlainConnection):
    """HTTPS to a checked address; the certificate has to be of the name."""

    default_port = http.client.HTTPS_PORT

    def __init__(
        self,
        host: str,
        port: int | None,
        timeout_s: float,
        context: ssl.SSLContext,
        *,
        local: bool = False,
    ) -> None:
        super().__init__(host, port, timeout_s, local=local)
        self._context = context

    def connect(self) -> None:
        """Connect, and see to it that the server is the one of that name."""
        super().connect()
        self.sock = self._context.wrap_socket(self.sock, server_hostname=self.host)


class _Https(urllib.request.HTTPSHandler):
    def https_open(self, req: urllib.request.Request) -> http.client.HTTPResponse:
        def connection(host: str, /, **given: Any) -> http.client.HTTPConnection:
            return SecureConnection(host, None, given["timeout"], ssl.create_default_context())

        made: Callable[..., Any] = connection
        return self.do_open(made, req)


class NoRedirects(urllib.request.HTTPRedirectHandler):
    """Follows nothing: a token is for the server that was named, not for one it points to."""

    def redirect_request(self, *_given: Any) -> None:
        """Follow nothing."""


def fetch(url: str, timeout_s: float, most_bytes: int) -> bytes:
    """Return what an https address answers, from the address that its name leads to.

    Parameters
    ----------
    url
        Of the settings. A proxy of the environment is used; redirects are not followed.
    timeout_s
        Longest wait for each part of the answer [s].
    most_bytes
        Of the answer that are read [bytes].

    Raises
    ------
    OSError
        Where there is no answer, or another one than 200.
    """
    opener = urllib.request.build_opener(_Https, NoRedirects)
    with opener.open(url, timeout=timeout_s) as answer:
        body: bytes = answer.read(most_bytes)
    return body
