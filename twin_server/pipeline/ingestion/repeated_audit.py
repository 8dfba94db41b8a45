"""Compares the whole store with its ledger, at the start and then every so often."""

import logging
import threading
import time
from collections.abc import Callable

from slowtime_services.credentials import Signer
from slowtime_services.ledger import Head
from twin_server.persist import Audit, DamagedStoreError, Store, audit

Seal = Callable[[bytes], bytes]

logger = logging.getLogger(__name__)

STOPPED_S = 5.0
"""How long a server that ends waits for an audit to notice [s]."""


class _StoppedError(Exception):
    """The server ends."""


def audit_store(
    store: Store,
    *,
    public: str,
    seal: Seal,
    kept: Head | None = None,
    tell: Callable[[str, int], None] | None = None,
) -> Audit:
    """Compare a store with its ledger; damage is a difference, too."""
    try:
        with store.snapshot() as reader:
            return audit(reader, public=public, kept=kept, seal=seal, tell=tell)
    except DamagedStoreError as error:
        return Audit(wrong=[str(error)])


class RepeatedAudit:
    """Audits a store in a thread of its own, while it is written.

    Parameters
    ----------
    every_s
        Time between the beginnings of two audits [s]; 0 for none.
    """

    def __init__(self, store: Store, signer: Signer, every_s: float) -> None:
        self._store, self._signer, self._every_s = store, signer, every_s
        self._next_s = time.monotonic() + every_s
        self._thread: threading.Thread | None = None
        self._result: Audit | None = None
        self._stopping = threading.Event()

    def step(self) -> None:
        """Begin an audit if it is due and none runs."""
        is_due = self._every_s > 0 and time.monotonic() >= self._next_s
        if is_due and self._thread is None:
            self._next_s = time.monotonic() + self._every_s
            self._thread = threading.Thread(target=self._run, name="audit", daemon=True)
            self._thread.start()

    def take_result(self) -> Audit | None:
        """Return once what an audit has found; None while there is nothing new."""
        if self._thread is None or self._thread.is_alive():
            return None
        self._thread = None
        found, self._result = self._result, None
        return found

    def stop(self) -> None:
        """End the audit that runs."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(STOPPED_S)

    def _run(self) -> None:
        try:
            public, seal = self._signer.public, self._signer.seal
            self._result = audit_store(
                self._store, public=public, seal=seal, tell=self._heed_stop
            )
        except _StoppedError:
            pass
        except Exception:
            logger.exception("The ledger could not be audited; it is tried again.")

    def _heed_stop(self, _chain: str, _entries: int) -> None:
        if self._stopping.is_set():
            raise _StoppedError
