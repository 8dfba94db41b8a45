"""A request whose head never ends is cut off; uvicorn would keep all of it."""

import logging

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

logger = logging.getLogger(__name__)

LARGEST_HEAD = 65_536


class Heads(HttpToolsProtocol):
    """HTTP/1.1 with at most `LARGEST_HEAD` bytes, and what comes with the last of them."""

    _head = 0
    _in_head = True

    def data_received(self, data: bytes) -> None:
        """Take bytes, unless too many of a head have come."""
        if self._in_head and self._head > LARGEST_HEAD:
            logger.warning("A request with an endless head is cut off.")
            self.transport.close()
            return
        if self._in_head:
            self._head += len(data)
        super().data_received(data)

    def on_headers_complete(self) -> None:
        """Count no further: what follows is a body, which has its own limit."""
        self._in_head, self._head = False, 0
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """Count again: what follows is the next request."""
        self._in_head, self._head = True, 0
        super().on_message_complete()
