"""Versions, extras, write access and compiled code of this installation."""

import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from .findings import CheckLine

VERSIONS = "Versions"
EXTRAS = "Extras"
WRITING = "Write access"
OLDEST_PYTHON = (3, 11)
"""Oldest version of Python that is supported; as `requires-python` in pyproject.toml."""
LIBRARIES = ("slowtime", "numpy", "scipy", "pydantic", "click", "eclipse-zenoh", "cryptography")
"""Libraries without which nothing runs."""
FOR_DEVELOPERS = ("dev", "docs", "peers")
"""Extras that users do not need, and beginnings of their names."""
REQUIREMENT = re.compile(
    r"(?P<name>[\w.-]+)\s*(?:\[(?P<extras>[\w,\s-]+)\])?[^;]*"
    r"(?:;.*extra\s*==\s*['\"](?P<extra>[\w-]+)['\"])?"
)


def installed_version(distribution: str) -> str | None:
    """Return the version of an installed distribution; None if it is absent."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def versions() -> Iterator[CheckLine]:
    """Check Python, the system and the libraries without which nothing runs."""
    said = f"{platform.python_version()} ({sys.executable})"
    oldest = ".".join(map(str, OLDEST_PYTHON))
    if sys.version_info < OLDEST_PYTHON:
        yield CheckLine(
            VERSIONS, "Python", "problem", said, f"Install Python {oldest} or newer."
        )
    else:
        yield CheckLine(VERSIONS, "Python", "ok", said)
    yield CheckLine(VERSIONS, "system", "ok", f"{platform.platform()}, {os.cpu_count()} cores")
    for library in LIBRARIES:
        version = installed_version(library)
        if version is None:
            advice = "Install it again: pip install --force-reinstall slowtime"
            yield CheckLine(VERSIONS, library, "problem", "not installed", advice)
        else:
            yield CheckLine(VERSIONS, library, "ok", version)


def requirements(lines: Iterable[str]) -> dict[str, set[str]]:
    """Return the distributions that each extra brings, extras within extras resolved.

    Parameters
    ----------
    lines
        Requirements as in the metadata of a distribution.

    Examples
    --------
    >>> lines = ["numpy>=2", "rich>=13; extra == 'a'", "slowtime[a]; extra == 'b'"]
    >>> requirements(lines) == {"a": {"rich"}, "b": {"rich"}}
    True
    """
    direct: dict[str, set[str]] = {}
    nested: dict[str, set[str]] = {}
    for line in lines:
        found = REQUIREMENT.match(line)
        if found is None or found["extra"] is None:
            continue
        extra = found["extra"]
        direct.setdefault(extra, set())
        if found["name"].lower() == "slowtime":
            others = {one.strip() for one in (found["extras"] or "").split(",")}
            nested.setdefault(extra, set()).update(others)
        else:
            direct[extra].add(found["name"])

    def all_of(extra: str) -> set[str]:
        within = (all_of(one) for one in nested.get(extra, ()) if one != extra)
        return direct.get(extra, set()).union(*within)

    return {extra: all_of(extra) for extra in direct}


def extras() -> Iterator[CheckLine]:
    """Check which extras are installed; name the install line of those that are not."""
    try:
        lines = importlib.metadata.requires("slowtime") or []
    except importlib.metadata.PackageNotFoundError:
        text = "slowtime runs from a folder, not from an installation"
        yield CheckLine(EXTRAS, "all", "note", text, "pip install -e '.[all]'")
        return
    for extra, needed in sorted(requirements(lines).items()):
        if extra.startswith(FOR_DEVELOPERS):
            continue
        missing = sorted(name for name in needed if installed_version(name) is None)
        if missing:
            text = f"absent: {', '.join(missing)}"
            yield CheckLine(EXTRAS, extra, "note", text, f"pip install 'slowtime[{extra}]'")
        else:
            yield CheckLine(EXTRAS, extra, "ok", "installed")


def write_access(folder: Path) -> Iterator[CheckLine]:
    """Check that files can be written in a folder and in the one for temporary files."""
    advice = "Give this user the right to write there, or use another folder."
    for name, place in (("folder", folder), ("temporary files", Path(tempfile.gettempdir()))):
        try:
            with tempfile.TemporaryFile(dir=place) as file:
                file.write(b"slowtime")
                file.flush()
        except OSError as error:
            text = f"{place.resolve()}: {error.strerror}"
            yield CheckLine(WRITING, name, "problem", text, advice)
        else:
            yield CheckLine(WRITING, name, "ok", str(place.resolve()))


def compiled_code() -> Iterator[CheckLine]:
    """Check whether compiled code is kept on disk."""
    if importlib.util.find_spec("numba") is None:
        return  # said among the extras
    spec = importlib.util.find_spec("slowtime")
    package = Path(spec.origin).parent if spec and spec.origin else Path()
    stated = os.environ.get("NUMBA_CACHE_DIR")
    # Numba writes beside the code, or else into a folder of the user.
    places = [Path(stated)] if stated else [package, *_home()]
    count = sum(1 for _ in places[0].rglob("*.nbi"))
    if count:
        yield CheckLine(
            WRITING, "compiled code", "ok", f"{count} functions kept below {places[0]}"
        )
        return
    usable = any(os.access(place, os.W_OK) for place in places)
    advice = "" if usable else "Set NUMBA_CACHE_DIR to a folder that this user may write."
    text = "none yet; the first diagnosis or simulation compiles it, for up to a minute"
    yield CheckLine(WRITING, "compiled code", "note", text, advice)


def _home() -> list[Path]:
    try:
        return [Path.home()]
    except RuntimeError:  # a user without a folder
        return []
