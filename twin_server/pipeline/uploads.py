"""Uploads under way: their slots, their pace, and what each site may keep."""

import asyncio
import contextlib
import hashlib
import threading
from collections.abc import AsyncIterator, Callable, Iterator

from slowtime_services.operating_system import pause_process, resume_process
from twin_server.fairness import (
    ALONE,
    ALPHA,
    Holder,
    OverQuotaError,
    Processors,
    Quota,
    QuotaHolding,
    current_holder,
    may_take,
)
from twin_server.identity.principals import Principal
from twin_server.serve import ProblemError
from twin_server.serve.http.pace import Pace
from twin_server.serve.http.quotas import cancelled_error, over_quota
from twin_server.settings import RecordingSettings

from .recording_folder import RecordingFolder

RETRY_AFTER_S = 5
"""What a client is told to wait where too many uploads are under way [s]."""


class Upload:
    """One that is under way.

    Parameters
    ----------
    holding
        Its slot.
    """

    def __init__(
        self,
        name: str,
        principal: Principal,
        holding: QuotaHolding,
        settings: RecordingSettings,
    ) -> None:
        self.name, self.sites, self._holding = name, principal.sites, holding
        self.received, self._settings = 0, settings
        self._cancelled = threading.Event()
        self._task, self._loop = asyncio.current_task(), asyncio.get_running_loop()
        holding.on_cancel = self._cancel

    @property
    def key(self) -> tuple[str, frozenset[str] | None]:
        """Different for uploads that do not get into each other's way."""
        return self.name, self.sites

    @property
    def holder(self) -> Holder:
        """For whom it is counted."""
        return self._holding.holder

    @property
    def partial(self) -> str:
        """Name of the file while it is written, another one for each group of sites."""
        sites = "*" if self.sites is None else ",".join(sorted(self.sites))
        return f".{hashlib.sha256(sites.encode()).hexdigest()[:16]}.{self.name}.partial"

    async def chunks(self, body: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
        """Yield what comes, as long as it comes fast enough; writing it takes no patience."""
        settings, loop = self._settings, asyncio.get_running_loop()
        pace = Pace(settings.slowest_bytes_per_s, settings.patience_s)
        chunk: bytes | None = b""
        while chunk is not None:
            began_s = loop.time()
            with contextlib.suppress(TimeoutError):
                chunk = await asyncio.wait_for(anext(body, None), pace.left_s)
                self.received += len(chunk or b"")
            if not pace.take(len(chunk or b""), loop.time() - began_s):
                raise ProblemError(
                    408,
                    "too-slow",
                    f"{self.received:,} bytes came, and the rest too slowly. Allowed: to fall "
                    f"{settings.patience_s:g} s behind {settings.slowest_bytes_per_s:,.0f} "
                    "bytes a second (recordings.patience_s, recordings.slowest_bytes_per_s). "
                    "Send it faster.",
                )
            if chunk:
                yield chunk

    @contextlib.contextmanager
    def supervised(self, processors: Processors, pid: int) -> Iterator[Callable[[], float]]:
        """Share the processors with the process that checks it; give how long that has run."""
        with processors.turn(
            self.holder, lambda: pause_process(pid), lambda: resume_process(pid)
        ) as turn:

            def running_s() -> float:
                if self._cancelled.is_set():
                    raise cancelled_error()
                return turn.running_s()

            yield running_s

    def _cancel(self) -> None:
        self._cancelled.set()
        if self._task is not None:
            self._loop.call_soon_threadsafe(self._task.cancel)

    @contextlib.contextmanager
    def cancellable(self) -> Iterator[None]:
        """Turn its cancellation into the answer that says so."""
        try:
            yield
        except asyncio.CancelledError:
            if self._task is None or not self._cancelled.is_set():
                raise
            self._task.uncancel()
            raise cancelled_error() from None


class Uploads:
    """All that are under way, and what each site may keep beside them."""

    def __init__(self, folder: RecordingFolder, settings: RecordingSettings) -> None:
        self._folder, self._settings = folder, settings
        self.quota = Quota("uploads", settings.max_at_once, setting="recordings.max_at_once")
        self._coming: dict[object, Upload] = {}

    @contextlib.contextmanager
    def begun(self, name: str, principal: Principal) -> Iterator[Upload]:
        """Begin one beside the others; of the same sites each has a name of its own."""
        try:
            holding = self.quota.take(current_holder(), f"upload of {name}")
        except OverQuotaError as error:
            raise over_quota(error, RETRY_AFTER_S) from error
        upload = Upload(name, principal, holding, self._settings)
        try:
            if upload.key in self._coming:
                raise ProblemError(
                    409,
                    "being-taken-in",
                    f"{name} is being taken in already. Give another name.",
                )
            self._coming[upload.key] = upload
            try:
                with upload.cancellable():
                    yield upload
            finally:
                del self._coming[upload.key]
        finally:
            holding.release()

    def check_files(self, holder: Holder) -> None:
        """Refuse one more file where there are too many, of all sites or of the caller's."""
        paths, most = self._folder.paths(), self._settings.max_files
        own = len(self._own(holder))
        if holder == ALONE or len(paths) >= most:
            own = 0
        if not may_take(own, most - len(paths)):
            raise ProblemError(
                507,
                "no-room",
                f"There are {own or most} recordings already. Allowed: {most}, of one site as "
                "many as it leaves free (recordings.max_files). Delete one first.",
            )

    def room(self, holder: Holder) -> int:
        """Return how many bytes more the recordings of a holder may have, with what comes."""
        free = self._settings.max_total_bytes - sum(
            path.stat().st_size for path in self._folder.paths()
        )
        if holder == ALONE:
            return free
        # Each byte that is kept is one more of the holder's, and one less that is free.
        own = sum(self._own(holder))
        return min(free, (ALPHA * free - own) // (1 + ALPHA))

    def check_room(self, upload: Upload, room: int) -> None:
        """Refuse bytes that have come and find no room beside all others that come."""
        coming = [one for one in self._coming.values() if one.holder.site == upload.holder.site]
        if sum(one.received for one in coming) > room or sum(
            one.received for one in self._coming.values()
        ) > self.room(ALONE):
            raise no_room(self._settings)

    def _own(self, holder: Holder) -> list[int]:
        """Return the sizes of what the sites of a holder have uploaded."""
        if holder == ALONE:
            return []
        kept = map(self._folder.look, self._folder.paths())
        return [
            one.size
            for one in kept
            if one is not None and one.space is not None and one.sites & holder.sites
        ]


def no_room(settings: RecordingSettings) -> ProblemError:
    """Make the refusal of bytes that find no room."""
    return ProblemError(
        507,
        "no-room",
        f"All recordings together may have {settings.max_total_bytes:,} bytes, those of one "
        "site as many as it leaves free (recordings.max_total_bytes). Delete one first.",
    )
