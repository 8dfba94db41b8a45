"""The folder of recordings: which files there are, whose they are, and which one a name means.

Names are unique within what one caller sees, not within the folder: what a token of some sites
uploads lies in a subfolder of the sites that it holds messages of, so that neither its name nor
a refusal depends on files of other sites. Files directly in the folder are those of the whole
server: put there by an operator, or uploaded with a token of all sites.
"""

import contextlib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from slowtime_schemas.streams import parse_key
from slowtime_services.replay import Contents, RecordingError, contents
from twin_server.identity.principals import Principal
from twin_server.serve import ProblemError
from twin_server.serve.routes.recordings import NAME

NOWHERE = (
    "This server keeps no recordings. Start it with `slowtime twin --recordings FOLDER`, or "
    "set diagnose.recordings."
)

SITES = re.compile(r"[a-z0-9][a-z0-9_-]*(,[a-z0-9][a-z0-9_-]*)*")
"""Name of a subfolder: the sites of its recordings, joined by commas."""

LONGEST_FOLDER = 200
"""Characters of the name of a subfolder; file systems allow 255 bytes."""


class Kept(NamedTuple):
    """A recording that is kept.

    Parameters
    ----------
    space
        Sites of its subfolder, joined by commas; None for one of the whole server.
    problem
        Why it cannot be read; None where it can.
    """

    path: Path
    space: str | None
    size: int
    changed_ns: int
    inside: Contents | None
    problem: str | None

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.name

    @property
    def addresses(self) -> list[tuple[str, str]]:
        """Site and asset of all that it holds."""
        keys = self.inside.counts if self.inside else {}
        return sorted({parse_key(key)[1:] for key in keys})

    @property
    def sites(self) -> frozenset[str]:
        """Sites that it tells of; none of one that cannot be read and is nobody's."""
        of_folder = self.space.split(",") if self.space else ()
        return frozenset(of_folder) | {site for site, _ in self.addresses}

    def is_seen_by(self, principal: Principal) -> bool:
        """Whether a principal may see it: all of it."""
        return principal.covers(self.sites)


class RecordingFolder:
    """Recordings by name, for who asks.

    Parameters
    ----------
    folder
        None for a server that keeps none.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._read: dict[Path, Kept] = {}

    def paths(self) -> list[Path]:
        """All files there are, those of the whole server first."""
        if self.folder is None or not self.folder.is_dir():
            return []
        entries = sorted(self.folder.iterdir())
        below = [
            path
            for entry in entries
            if SITES.fullmatch(entry.name) and entry.is_dir() and not entry.is_symlink()
            for path in sorted(entry.iterdir())
        ]
        return [
            path
            for path in (*entries, *below)
            if re.match(NAME, path.name) and path.is_file() and not path.is_symlink()
        ]

    def seen(self, principal: Principal) -> list[Kept]:
        """Return all recordings that a principal may see."""
        kept = map(self.look, self.paths())
        return [one for one in kept if one is not None and one.is_seen_by(principal)]

    def one(self, name: str, site: str | None, principal: Principal) -> Kept:
        """Return the recording of a name that a principal may see.

        Parameters
        ----------
        site
            Its sites, joined by commas, where several have the name; without them, that of the
            whole server is meant.

        Raises
        ------
        ProblemError
            Where there is none, or where it is not clear which one is meant.
        """
        named = [one for one in self.seen(principal) if one.name == name]
        found = [one for one in named if site is None or one.space == site]
        if not found:
            raise ProblemError(404, "no-such-recording", self._none(name, site))
        if len(found) > 1 and found[0].space is not None:
            spaces = ", ".join(str(one.space) for one in found)
            raise ProblemError(
                409,
                "several-recordings",
                f"{len(found)} recordings are called {name}, of these sites: {spaces[:500]}. "
                f"Say which one, such as ?site={found[0].space}.",
            )
        return found[0]

    def of_twin(self, names: Sequence[str], twin_id: str, principal: Principal) -> list[Path]:
        """Return the recordings for a diagnosis of a twin.

        Parameters
        ----------
        names
            Of several with one name, that of the twin's site is taken. Without names, all that
            hold messages of the twin.

        Raises
        ------
        ProblemError
            Where there are none, or none of a name; it lists those that may be seen.
        """
        kept = self.seen(principal)
        site, _, asset = twin_id.partition(".")
        own = {one.name: one for one in sorted(kept, key=lambda one: one.space == site)}
        strange = [name for name in names if name not in own]
        found = (
            [own[name] for name in names if name in own]
            if names
            else [one for one in kept if (site, asset) in one.addresses]
        )
        if strange or not found:
            some = ", ".join(sorted(own)[:20]) or "none; upload one, or ask the edge (raw)"
            if self.folder is None:
                some = "none; set diagnose.recordings to a folder"
            what = ", ".join(strange) or f"Recordings of {twin_id}"
            raise ProblemError(
                422,
                "no-such-recording",
                f"{what} were asked for. There are, of those that you may see: {some}.",
            )
        return [one.path for one in found]

    def place_for(self, name: str, sites: Iterable[str], principal: Principal) -> Path:
        """Return where a recording of some sites is put, and make its folder."""
        assert self.folder is not None
        if principal.sites is None:
            return self.folder / name
        place = self.folder / ",".join(sorted(sites))
        if len(place.name) > LONGEST_FOLDER:
            raise ProblemError(
                422,
                "too-many-sites",
                "The recording holds messages of too many sites. Split it by sites, or have "
                "it uploaded with a token of all sites.",
            )
        place.mkdir(exist_ok=True)
        return place / name

    def check_free(self, name: str, principal: Principal) -> None:
        """Refuse a name of a recording that the principal sees."""
        if any(one.name == name for one in self.seen(principal)):
            raise name_taken(name)

    def look(self, path: Path) -> Kept | None:
        """Read the contents of a recording; again only if it has changed."""
        try:
            state = path.stat()
        except FileNotFoundError:
            return None
        before = self._read.get(path)
        if before is None or before[2:4] != (state.st_size, state.st_mtime_ns):
            space = None if path.parent == self.folder else path.parent.name
            before = Kept(path, space, state.st_size, state.st_mtime_ns, *_contents(path))
            self._read[path] = before
        return before

    def forget(self, path: Path) -> None:
        """Forget a file that was deleted."""
        self._read.pop(path, None)

    def _none(self, name: str, site: str | None) -> str:
        if self.folder is None:
            return NOWHERE
        of_site = f" of {site:.200}" if site is not None else ""
        return (
            f"There is no recording {name:.110}{of_site} that you may see. GET "
            "/api/v1/recordings lists those there are."
        )


def name_taken(name: str) -> ProblemError:
    """Make the refusal of a name that is taken."""
    return ProblemError(
        409,
        "there-already",
        f"{name} exists already, and may be the only copy. Give another name.",
    )


def _contents(path: Path) -> tuple[Contents | None, str | None]:
    with contextlib.suppress(FileNotFoundError):
        try:
            return contents(path), None
        except RecordingError as error:
            return None, str(error).replace(str(path), path.name)
    return None, "It has gone."
