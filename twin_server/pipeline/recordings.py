"""Stores uploaded recordings that are valid, and replays them to the twins of the server."""

import asyncio
import dataclasses
import hashlib
import logging
import math
import os
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, NamedTuple

from slowtime_schemas.streams import REGISTRATION, parse_key
from slowtime_services.bus import Bus
from slowtime_services.replay import (
    PLAYED,
    Contents,
    Progress,
    RecordingError,
    check,
    contents,
    replay,
)
from twin_server.identity.principals import Principal
from twin_server.serve import ProblemError
from twin_server.settings import RecordingSettings

from .recording_folder import NOWHERE, Kept, RecordingFolder, name_taken

logger = logging.getLogger(__name__)


class _Upload(NamedTuple):
    """An upload under way: its name, and the sites of who sends it."""

    name: str
    sites: frozenset[str] | None

    @property
    def partial(self) -> str:
        """Name of the file while it is written, another one for each group of sites."""
        sites = "*" if self.sites is None else ",".join(sorted(self.sites))
        return f".{hashlib.sha256(sites.encode()).hexdigest()[:16]}.{self.name}.partial"


@dataclasses.dataclass(slots=True)
class _Replay:
    kept: Kept
    stop: threading.Event
    thread: threading.Thread | None = None
    state: str = "playing"
    done: int = 0
    total: int = 0
    sentence: str = "It begins."

    def document(self) -> dict[str, Any]:
        return {key: getattr(self, key) for key in ("state", "done", "total", "sentence")}


class Recordings:
    """The recordings of the server, and their replay.

    Parameters
    ----------
    folder
        Where they are; None for a server that keeps none.
    known
        Whether a twin is registered.
    bus
        On which they are played.
    """

    def __init__(
        self,
        folder: Path | None,
        settings: RecordingSettings,
        known: Callable[[str], bool],
        bus: Bus,
    ) -> None:
        self.folder = RecordingFolder(folder)
        self._settings, self._known, self._bus = settings, known, bus
        self._coming: dict[_Upload, int] = {}
        self._checking = threading.Lock()
        self._lock = threading.Lock()
        self._played: dict[Path, _Replay] = {}

    def stop(self) -> None:
        """End the replays in progress."""
        with self._lock:
            playing = list(self._played.values())
            for one in playing:
                one.stop.set()
        for one in playing:
            if one.thread is not None:
                one.thread.join(10.0)

    def listed(self, principal: Principal) -> dict[str, Any]:
        """Return all recordings that the caller may see, the newest first."""
        found = [self._recording_document(kept) for kept in self.folder.seen(principal)]
        found.sort(key=lambda one: one["changed_ns"], reverse=True)
        limit = self._settings.max_bytes
        kept = self.folder.folder is not None
        return {"kept": kept, "max_bytes": limit, "recordings": found}

    def path(self, name: str, site: str | None, principal: Principal) -> Path:
        """Return the path of a recording that the caller may see."""
        return self.folder.one(name, site, principal).path

    async def take(self, name: str, chunks: AsyncIterator[bytes], principal: Principal) -> None:
        """Write one beside the others under another name, read it through, and keep it."""
        folder = await asyncio.to_thread(self._folder_for, name, principal)
        upload = _Upload(name, principal.sites)
        self._begin(upload)
        partial = folder / upload.partial
        try:
            await self._write(partial, upload, chunks)
            sites = await asyncio.to_thread(self._check, partial, name, principal)
            self._place(partial, self.folder.place_for(name, sites, principal))
        finally:
            partial.unlink(missing_ok=True)
            self._coming.pop(upload, None)

    def _begin(self, upload: _Upload) -> None:
        """Begin an upload beside others; of the same sites each has a name of its own."""
        if upload in self._coming:
            raise ProblemError(
                409,
                "being-taken-in",
                f"{upload.name} is being taken in already. Give another name.",
            )
        if len(self._coming) >= self._settings.max_at_once:
            raise ProblemError(
                503,
                "busy",
                "Other recordings are being taken in. Allowed: "
                f"{self._settings.max_at_once} at once (recordings.max_at_once). Try again.",
                **{"Retry-After": "5"},
            )
        self._coming[upload] = 0

    def _check(self, partial: Path, name: str, principal: Principal) -> set[str]:
        """Read one through; one at a time, since that takes a processor. Return its sites."""
        with self._checking:
            _check_sound(partial, name)
            return _checked_sites(contents(partial), principal)

    def delete(self, name: str, site: str | None, principal: Principal) -> None:
        """Delete one that is not being played."""
        path = self.path(name, site, principal)
        with self._lock:
            one = self._played.get(path)
            if one is not None and one.state == "playing":
                raise ProblemError(
                    409, "being-played", f"{name} is being played. Stop it first."
                )
            self._played.pop(path, None)
            self.folder.forget(path)
            path.unlink(missing_ok=True)

    def play(
        self, name: str, site: str | None, speed: float | None, principal: Principal
    ) -> None:
        """Begin to play one, if none is being played to the same sites."""
        kept = self.folder.one(name, site, principal)
        if kept.inside is None:
            raise ProblemError(409, "not-sound", kept.problem or "")
        with self._lock:
            for other in self._played.values():
                if other.state == "playing" and other.kept.sites & kept.sites:
                    raise _being_played(other.kept, principal)
            one = _Replay(kept, threading.Event(), total=kept.inside.messages)
            self._played[kept.path] = one
            strange = not any(self._known(f"{s}.{a}") for s, a in kept.addresses)
            one.thread = threading.Thread(
                target=self._play, args=(kept.path, one, speed, strange), name="replay",
                daemon=True,
            )  # fmt: skip
            one.thread.start()

    def stop_playing(self, name: str, site: str | None, principal: Principal) -> None:
        """End a replay."""
        path = self.path(name, site, principal)
        with self._lock:
            one = self._played.get(path)
            if one is None or one.state != "playing":
                raise ProblemError(409, "not-played", f"{name} is not being played.")
            one.stop.set()

    def _play(self, path: Path, one: _Replay, speed: float | None, strange: bool) -> None:
        streams = [stream for stream in PLAYED if strange or stream is not REGISTRATION]

        def tell(progress: Progress) -> None:
            one.done, one.total = progress.done, progress.total
            one.sentence = f"{one.done:,} of {one.total:,} messages."

        try:
            done = replay(
                path, self._bus, speed=speed or math.inf, streams=streams, stop=one.stop,
                progress=tell,
            )  # fmt: skip
        except Exception as error:  # whatever it is, the server goes on, and says so
            logger.warning("%s could not be replayed: %s", path.name, error)
            one.state, one.sentence = "failed", str(error).replace(str(path), path.name)
            return
        kept = f"{done.acknowledged:,} of {done.features:,} features are in the twins."
        one.sentence = f"{'Stopped. ' if done.stopped else ''}{kept}"
        one.state = "stopped" if done.stopped else "done"

    def _recording_document(self, kept: Kept) -> dict[str, Any]:
        inside, played = kept.inside, self._played.get(kept.path)
        messages: Counter[str] = Counter()
        for key, count in (inside.counts if inside else {}).items():
            messages[parse_key(key)[0].name] += count
        return {
            "name": kept.name,
            "site": kept.space,
            "bytes": kept.size,
            "changed_ns": kept.changed_ns,
            "start_ns": inside.start_ns if inside else None,
            "end_ns": inside.end_ns if inside else None,
            "twins": [f"{site}.{asset}" for site, asset in kept.addresses],
            "messages": {stream: count for stream, count in messages.items() if count},
            "problem": kept.problem,
            "replay": played.document() if played else None,
        }

    def _folder_for(self, name: str, principal: Principal) -> Path:
        folder = self.folder.folder
        if folder is None:
            raise ProblemError(404, "no-recordings", NOWHERE)
        folder.mkdir(parents=True, exist_ok=True)
        self.folder.check_free(name, principal)
        if len(self.folder.paths()) >= self._settings.max_files:
            raise ProblemError(
                507,
                "no-room",
                f"There are {self._settings.max_files} recordings already (recordings."
                "max_files). Delete one first.",
            )
        return folder

    async def _write(
        self, partial: Path, upload: _Upload, chunks: AsyncIterator[bytes]
    ) -> None:
        """Write incoming bytes, within limits of size and time."""
        settings = self._settings
        room = self._room()
        with partial.open("wb") as file:
            while True:
                try:
                    chunk = await asyncio.wait_for(anext(chunks, None), settings.patience_s)
                except TimeoutError:
                    raise ProblemError(
                        408,
                        "too-slow",
                        f"Nothing came for {settings.patience_s:g} s. Try again.",
                    ) from None
                if chunk is None:
                    break
                self._coming[upload] += len(chunk)
                if sum(self._coming.values()) > room:
                    raise self._no_room()
                await asyncio.to_thread(file.write, chunk)
            file.flush()
            await asyncio.to_thread(os.fsync, file.fileno())

    def _room(self) -> int:
        used = sum(path.stat().st_size for path in self.folder.paths())
        return self._settings.max_total_bytes - used

    def _no_room(self) -> ProblemError:
        return ProblemError(
            507,
            "no-room",
            f"All recordings together may have {self._settings.max_total_bytes:,} bytes "
            "(recordings.max_total_bytes). Delete one first.",
        )

    def _place(self, partial: Path, path: Path) -> None:
        """Give the file its name, unless the name or the space has been taken meanwhile."""
        if partial.stat().st_size > self._room():
            raise self._no_room()
        try:
            _give_name(partial, path)
        except FileExistsError:
            raise name_taken(path.name) from None
        except OSError as error:
            raise ProblemError(
                507,
                "not-kept",
                f"{path.name} cannot be kept in the recordings folder: {error.strerror}. Make "
                "room on its disk, and let the server's user write there.",
            ) from error


def _give_name(partial: Path, path: Path) -> None:
    """Give a file its name unless that is taken."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # exFAT and some network drives have no hard links
        path.touch(exist_ok=False)
        try:
            partial.replace(path)
        except OSError:
            path.unlink()
            raise


def _check_sound(path: Path, name: str) -> None:
    try:
        check(path)
    except RecordingError as error:
        said = str(error).replace(str(path), name)
        raise ProblemError(422, "not-sound", f"{name} is not taken in. {said}") from error


def _checked_sites(inside: Contents, principal: Principal) -> set[str]:
    """Return the sites of a recording; refuse one that the caller may not see all of."""
    sites = {parse_key(key)[1] for key in inside.counts}
    beyond = sorted(site for site in sites if not principal.reaches(site))
    if beyond:
        raise ProblemError(
            403,
            "site-out-of-reach",
            f"It holds messages of {', '.join(beyond)[:200]}, which your token does not reach. "
            "Ask an admin for a token that does.",
        )
    return sites


def _being_played(other: Kept, principal: Principal) -> ProblemError:
    """Refuse a replay beside another one, which is named to who may see it."""
    named = other.name if other.is_seen_by(principal) else "A recording of several sites"
    return ProblemError(
        409,
        "being-played",
        f"{named} is being played to twins of the same site. Wait, or stop it first.",
    )
