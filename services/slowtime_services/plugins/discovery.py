"""Discovery of plug-ins by the entry points of installed distributions.

A distribution names a part in a group of `GROUPS`; the name is what settings, URLs and options
call it by. Nothing is imported until a part is asked for by its name, and whatever it does
wrong is told with the name of the distribution that brought it.
"""

import dataclasses
import importlib.metadata
from collections.abc import Mapping
from typing import Any

GROUPS: Mapping[str, str] = {
    "slowtime.sources": "read(url) → packets of bytes; the name is the scheme of its URLs",
    "slowtime.readers": "read(path, max_bytes) → Found; the name is the ending of its files",
    "slowtime.effects": "a Kind, or several",
    "slowtime.identifiers": "identify(samples, rate_hz, channels) → modes",
    "slowtime.limit_states": "a LimitState, made with the settings of a registration",
    "slowtime.alarms": "send(event, options) → None, or a text; the name is a kind of receiver",
}
"""Group of entry points → what each of its parts is."""

MOST_SAID = 300


class PluginError(ValueError):
    """A plug-in that is not installed, cannot be imported, or broke its contract."""


@dataclasses.dataclass(frozen=True, slots=True)
class Plugin:
    """One part of a distribution, not yet imported."""

    group: str
    name: str
    distribution: str
    version: str
    entry: importlib.metadata.EntryPoint

    def __str__(self) -> str:
        """Name it for a message."""
        kind = self.group.partition(".")[2].removesuffix("s")
        return f"The {kind} {self.name!r} of {self.distribution} {self.version}"

    def load(self) -> Any:
        """Import the part.

        Raises
        ------
        PluginError
            Where the import fails, or it holds nothing that the group takes.
        """
        try:
            part = self.entry.load()
        except Exception as error:  # an import of somebody's code raises whatever it likes
            raise PluginError(f"{self} cannot be imported: {exception_text(error)}.") from error
        if self.group != "slowtime.effects" and not callable(part):
            raise PluginError(
                f"{self} is a {type(part).__name__}, not a function. Point its entry at "
                f"{GROUPS[self.group]}."
            )
        return part


def plugins(group: str | None = None) -> tuple[Plugin, ...]:
    """Find every installed part, of one group or of all, without importing any."""
    groups = tuple(GROUPS) if group is None else (group,)
    found = {
        Plugin(
            group=one,
            name=entry.name,
            distribution=entry.dist.name if entry.dist else "?",
            version=entry.dist.version if entry.dist else "?",
            entry=entry,
        )
        for one in groups
        for entry in importlib.metadata.entry_points(group=one)
    }
    return tuple(sorted(found, key=lambda one: (one.group, one.name, one.distribution)))


def find(group: str, name: str) -> Plugin:
    """Find an installed part by its name, without importing it.

    Raises
    ------
    PluginError
        Where there is none of that name, or several distributions bring one.

    Examples
    --------
    >>> find("slowtime.readers", "nowhere")
    Traceback (most recent call last):
    slowtime_services.plugins.discovery.PluginError: No reader 'nowhere' is installed. ...
    """
    all_ = plugins(group)
    named = [one for one in all_ if one.name == name]
    if len(named) == 1:
        return named[0]
    kind = group.partition(".")[2].removesuffix("s")
    if not named:
        there = ", ".join(sorted({one.name for one in all_})) or "none"
        raise PluginError(
            f"No {kind} {name!r} is installed. Installed: {there}. `slowtime plugins` lists "
            "all parts."
        )
    of = " and ".join(one.distribution for one in named)
    raise PluginError(f"{of} each bring a {kind} {name!r}. Uninstall all but one.")


def exception_text(error: BaseException) -> str:
    """Return the text of an exception on one line, bounded."""
    text = " ".join(str(error).split())[:MOST_SAID].rstrip(".")
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
