"""Stores uploaded recordings that are valid, and replays them to the twins of the server."""

import asyncio
import collections
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
    RecordingError,
    Supervise,
    check,
    contents,
)
from twin_server.fairness import OverQuotaError, Processors, Quota, current_holder
from twin_server.identity.principals import Principal
from twin_server.serve import ProblemError
from twin_server.serve.http.bounded_threads import BoundedThreads
from twin_server.serve.http.quotas import over_quota
from twin_server.settings import RecordingSettings

from .recording_folder import NOWHERE, Kept, RecordingFolder, name_taken
from .replays import Replay, check_duration
from .uploads import RETRY_AFTER_S, Upload, Uploads, no_room

CHECKS_AT_ONCE = 8
"""Recordings that are read through at once, of different sites; each has a process of some
100 MB, of which as many go on as there are processors."""
STOPPED_S = 5.0
"""Time that an answer waits for the end of a replay that was stopped [s]."""


class _Played(NamedTuple):
    """A recording, and its latest replay."""

    kept: Kept
    replay: Replay


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
    processors
        Pause checks and replays in favour of other sites.
    """

    def __init__(
        self,
        folder: Path | None,
        settings: RecordingSettings,
        known: Callable[[str], bool],
        bus: Bus,
        processors: Processors | None = None,
    ) -> None:
        self.folder = RecordingFolder(folder)
        self._settings, self._known, self._bus = settings, known, bus
        self._processors = processors or Processors()
        self.uploads = Uploads(self.folder, settings)
        self.replays = Quota(
            "replays", settings.max_replays, of_site=1, setting="recordings.max_replays"
        )
        # Waited for in the event loop: threads that wait would be missed by all others.
        self._checking: dict[str, asyncio.Lock] = collections.defaultdict(asyncio.Lock)
        self._checks = BoundedThreads(CHECKS_AT_ONCE)
        self._lock = threading.Lock()
        self._played: dict[Path, _Played] = {}

    def stop(self) -> None:
        """End the replays in progress."""
        with self._lock:
            playing = list(self._played.values())
            for one in playing:
                one.replay.stop.set()
        for one in playing:
            if one.replay.thread is not None:
                one.replay.thread.join(10.0)

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
        with self.uploads.begun(name, principal) as upload:
            partial = folder / upload.partial
            try:
                await self._write(partial, upload, chunks)
                async with self._checking[upload.holder.site]:
                    sites = await self._checks.run(
                        lambda: self._check(partial, upload, principal)
                    )
                place = self.folder.place_for(name, sites, principal)
                await asyncio.to_thread(self._place, partial, place, upload)
            finally:
                partial.unlink(missing_ok=True)

    def _check(self, partial: Path, upload: Upload, principal: Principal) -> set[str]:
        """Read one through, in a process that may be paused. Return its sites."""
        _check_sound(partial, upload.name, lambda pid: upload.supervised(self._processors, pid))
        return _checked_sites(contents(partial), principal)

    def delete(self, name: str, site: str | None, principal: Principal) -> None:
        """Delete one that is not being played."""
        path = self.path(name, site, principal)
        with self._lock:
            one = self._played.get(path)
            if one is not None and one.replay.state == "playing":
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
        check_duration(kept.inside, speed, self._settings)
        with self._lock:
            for other in self._played.values():
                if other.replay.state == "playing" and other.kept.sites & kept.sites:
                    raise _being_played(other.kept, principal)
            try:
                holding = self.replays.take(current_holder(), f"replay of {kept.name}")
            except OverQuotaError as error:
                raise over_quota(error, RETRY_AFTER_S) from error
            one = _Played(kept, Replay(holding, self._settings.max_replay_s))
            one.replay.total = kept.inside.messages
            holding.on_cancel = one.replay.stop.set
            self._played[kept.path] = one
            strange = not any(self._known(f"{s}.{a}") for s, a in kept.addresses)
            streams = [stream for stream in PLAYED if strange or stream is not REGISTRATION]
            one.replay.thread = threading.Thread(
                target=one.replay.run,
                args=(kept.path, self._bus, speed, streams, self._processors),
                name="replay",
                daemon=True,
            )
            one.replay.thread.start()

    def stop_playing(self, name: str, site: str | None, principal: Principal) -> None:
        """End a replay; return when it has ended, or after a while."""
        path = self.path(name, site, principal)
        with self._lock:
            one = self._played.get(path)
            if one is None or one.replay.state != "playing":
                raise ProblemError(409, "not-played", f"{name} is not being played.")
            one.replay.stop.set()
        assert one.replay.thread is not None
        one.replay.thread.join(STOPPED_S)

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
            "replay": played.replay.document() if played else None,
        }

    def _folder_for(self, name: str, principal: Principal) -> Path:
        folder = self.folder.folder
        if folder is None:
            raise ProblemError(404, "no-recordings", NOWHERE)
        folder.mkdir(parents=True, exist_ok=True)
        self.folder.check_free(name, principal)
        self.uploads.check_files(current_holder())
        return folder

    async def _write(self, partial: Path, upload: Upload, chunks: AsyncIterator[bytes]) -> None:
        """Write incoming bytes, within limits of size and time."""
        room = await asyncio.to_thread(self.uploads.room, upload.holder)
        with partial.open("wb") as file:
            async for chunk in upload.chunks(chunks):
                self.uploads.check_room(upload, room)
                await asyncio.to_thread(file.write, chunk)
            file.flush()
            await asyncio.to_thread(os.fsync, file.fileno())

    def _place(self, partial: Path, path: Path, upload: Upload) -> None:
        """Give the file its name, unless the name or the space has been taken meanwhile."""
        if partial.stat().st_size > self.uploads.room(upload.holder):
            raise no_room(self._settings)
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


def _check_sound(path: Path, name: str, supervise: Supervise) -> None:
    try:
        check(path, supervise)
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
