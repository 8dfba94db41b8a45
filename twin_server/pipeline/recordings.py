"""Stores uploaded recordings that are valid, and replays them to the twins of the server."""

import asyncio
import contextlib
import dataclasses
import logging
import math
import os
import re
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
from twin_server.serve import ProblemError
from twin_server.serve.routes.recordings import NAME, Reaches
from twin_server.settings import RecordingSettings

logger = logging.getLogger(__name__)

NOWHERE = (
    "This server keeps no recordings. Start it with `slowtime twin --recordings FOLDER`, or "
    "set diagnose.recordings."
)


class _Kept(NamedTuple):
    size: int
    changed_ns: int
    inside: Contents | None
    problem: str | None

    @property
    def addresses(self) -> list[tuple[str, str]]:
        """Site and asset of all that it holds."""
        keys = self.inside.counts if self.inside else {}
        return sorted({parse_key(key)[1:] for key in keys})


@dataclasses.dataclass(slots=True)
class _Replay:
    name: str
    stop: threading.Event
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
        self._folder, self._settings, self._known, self._bus = folder, settings, known, bus
        self._read: dict[str, _Kept] = {}
        self._coming: dict[str, int] = {}
        self._checking = threading.Lock()
        self._lock = threading.Lock()
        self._played: dict[str, _Replay] = {}
        self._thread: threading.Thread | None = None

    def stop(self) -> None:
        """End the replay in progress."""
        with self._lock:
            for one in self._played.values():
                one.stop.set()
        if self._thread is not None:
            self._thread.join(10.0)

    def listed(self, reaches: Reaches) -> dict[str, Any]:
        """Return all recordings that the caller may see, the newest first."""
        found = [
            self._recording_document(path.name, kept)
            for path in self._paths()
            for kept in [self._look(path)]
            if kept is not None and _may_see(kept, reaches)
        ]
        found.sort(key=lambda one: one["changed_ns"], reverse=True)
        limit = self._settings.max_bytes
        return {"kept": self._folder is not None, "max_bytes": limit, "recordings": found}

    def path(self, name: str, reaches: Reaches) -> Path:
        """Return the path of a recording that the caller may see."""
        kept = {path.name: path for path in self._paths()}
        found = kept.get(name)
        look = self._look(found) if found else None
        if found is None or look is None or not _may_see(look, reaches):
            raise ProblemError(
                404,
                "no-such-recording",
                NOWHERE
                if self._folder is None
                else f"There is no recording {name:.110} that "
                "you may see. GET /api/v1/recordings lists those there are.",
            )
        return found

    async def take(self, name: str, chunks: AsyncIterator[bytes], reaches: Reaches) -> None:
        """Write one beside the others under another name, read it through, and keep it."""
        folder = self._folder_for(name)
        self._begin(name)
        partial = folder / f".{name}.partial"
        try:
            await self._write(partial, name, chunks)
            await asyncio.to_thread(self._check, partial, name, reaches)
            self._place(partial, folder / name)
        finally:
            partial.unlink(missing_ok=True)
            self._coming.pop(name, None)

    def _begin(self, name: str) -> None:
        """Begin an upload beside others; each has a name of its own."""
        if name in self._coming:
            raise ProblemError(
                409, "being-taken-in", f"{name} is being taken in already. Give another name."
            )
        if len(self._coming) >= self._settings.max_at_once:
            raise ProblemError(
                503,
                "busy",
                f"{len(self._coming)} recordings are being taken in. Allowed: "
                f"{self._settings.max_at_once} at once (recordings.max_at_once). Try again.",
                **{"Retry-After": "5"},
            )
        self._coming[name] = 0

    def _check(self, partial: Path, name: str, reaches: Reaches) -> None:
        """Read one through; one at a time, since that takes a processor."""
        with self._checking:
            _check_sound(partial, name)
            _check_reached(contents(partial), reaches)

    def delete(self, name: str, reaches: Reaches) -> None:
        """Delete one that is not being played."""
        path = self.path(name, reaches)
        with self._lock:
            one = self._played.get(name)
            if one is not None and one.state == "playing":
                raise ProblemError(
                    409, "being-played", f"{name} is being played. Stop it first."
                )
            self._played.pop(name, None)
            self._read.pop(name, None)
            path.unlink(missing_ok=True)

    def play(self, name: str, speed: float | None, reaches: Reaches) -> None:
        """Begin to play one, if none is being played."""
        path = self.path(name, reaches)
        kept = self._look(path)
        if kept is None or kept.inside is None:
            raise ProblemError(409, "not-sound", kept.problem or "" if kept else "It has gone.")
        with self._lock:
            busy = [one.name for one in self._played.values() if one.state == "playing"]
            if busy:
                raise ProblemError(
                    409, "being-played", f"{busy[0]} is being played. Wait, or stop it first."
                )
            one = _Replay(name, threading.Event(), total=kept.inside.messages)
            self._played[name] = one
            strange = not any(self._known(f"{s}.{a}") for s, a in kept.addresses)
            self._thread = threading.Thread(
                target=self._play, args=(path, one, speed, strange), name="replay", daemon=True
            )
            self._thread.start()

    def stop_playing(self, name: str, reaches: Reaches) -> None:
        """End a replay."""
        self.path(name, reaches)
        with self._lock:
            one = self._played.get(name)
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

    def _paths(self) -> list[Path]:
        if self._folder is None or not self._folder.is_dir():
            return []
        return [
            path
            for path in self._folder.iterdir()
            if re.match(NAME, path.name) and path.is_file() and not path.is_symlink()
        ]

    def _look(self, path: Path) -> _Kept | None:
        """Read the contents of a recording; again only if it has changed."""
        try:
            state = path.stat()
        except FileNotFoundError:
            return None
        before = self._read.get(path.name)
        if before is None or before[:2] != (state.st_size, state.st_mtime_ns):
            before = _Kept(state.st_size, state.st_mtime_ns, *_read_contents(path))
            self._read[path.name] = before
        return before

    def _recording_document(self, name: str, kept: _Kept) -> dict[str, Any]:
        inside, played = kept.inside, self._played.get(name)
        messages: Counter[str] = Counter()
        for key, count in (inside.counts if inside else {}).items():
            messages[parse_key(key)[0].name] += count
        return {
            "name": name,
            "bytes": kept.size,
            "changed_ns": kept.changed_ns,
            "start_ns": inside.start_ns if inside else None,
            "end_ns": inside.end_ns if inside else None,
            "twins": [f"{site}.{asset}" for site, asset in kept.addresses],
            "messages": {stream: count for stream, count in messages.items() if count},
            "problem": kept.problem,
            "replay": played.document() if played else None,
        }

    def _folder_for(self, name: str) -> Path:
        if self._folder is None:
            raise ProblemError(404, "no-recordings", NOWHERE)
        self._folder.mkdir(parents=True, exist_ok=True)
        if (self._folder / name).exists():
            raise _name_taken_error(name)
        if len(self._paths()) >= self._settings.max_files:
            raise ProblemError(
                507,
                "no-room",
                f"There are {self._settings.max_files} recordings already (recordings."
                "max_files). Delete one first.",
            )
        return self._folder

    async def _write(self, partial: Path, name: str, chunks: AsyncIterator[bytes]) -> None:
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
                self._coming[name] += len(chunk)
                if sum(self._coming.values()) > room:
                    raise self._no_room()
                await asyncio.to_thread(file.write, chunk)
            file.flush()
            await asyncio.to_thread(os.fsync, file.fileno())

    def _room(self) -> int:
        used = sum(path.stat().st_size for path in self._paths())
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
            raise _name_taken_error(path.name) from None
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


def _name_taken_error(name: str) -> ProblemError:
    return ProblemError(
        409,
        "there-already",
        f"{name} exists already, and may be the only copy. Give another name.",
    )


def _may_see(kept: _Kept, reaches: Reaches) -> bool:
    """Whether the caller may see all of a recording; an unreadable one is for admins only."""
    if kept.inside is None:
        return reaches("*")
    return all(reaches(site) for site, _ in kept.addresses)


def _check_sound(path: Path, name: str) -> None:
    try:
        check(path)
    except RecordingError as error:
        said = str(error).replace(str(path), name)
        raise ProblemError(422, "not-sound", f"{name} is not taken in. {said}") from error


def _check_reached(inside: Contents, reaches: Reaches) -> None:
    sites = sorted({parse_key(key)[1] for key in inside.counts})
    beyond = [site for site in sites if not reaches(site)]
    if beyond:
        raise ProblemError(
            403,
            "site-out-of-reach",
            f"It holds messages of {', '.join(beyond)[:200]}, which your token does not reach. "
            "Ask an admin for a token that does.",
        )


def _read_contents(path: Path) -> tuple[Contents | None, str | None]:
    with contextlib.suppress(FileNotFoundError):
        try:
            return contents(path), None
        except RecordingError as error:
            return None, str(error).replace(str(path), path.name)
    return None, "It has gone."
