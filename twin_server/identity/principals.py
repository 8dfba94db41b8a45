"""The principal of a request: name, scope, sites and expiry, and which names it may know.

Whatever holds names of several sites (lists of twins, composites, recordings, refusals that say
what is allowed) is asked with a principal and answers by these methods alone, so that there is
one place that decides who may know.
"""

import dataclasses
import enum
import math
from collections.abc import Callable, Iterable, Mapping, MutableMapping
from typing import Any, Self

KEY = "slowtime.principal"


class Scope(enum.IntEnum):
    """Scope of a principal; each includes those before it."""

    VIEWER = 1
    OPERATOR = 2
    ADMIN = 3

    @classmethod
    def of(cls, word: str) -> Self:
        """Parse a scope.

        Raises
        ------
        ValueError
            Naming the words that are.
        """
        try:
            return cls[word.upper()]
        except KeyError:
            raise ValueError(
                f"{word!r} is not a valid scope. Allowed: {', '.join(s.word for s in cls)}."
            ) from None

    @property
    def word(self) -> str:
        """As it is written."""
        return self.name.lower()


def site_of(name: str) -> str:
    """Return the site of a twin or a composite.

    Examples
    --------
    >>> site_of("lab.beam")
    'lab'
    """
    return name.partition(".")[0]


@dataclasses.dataclass(frozen=True, slots=True)
class Principal:
    """An authenticated caller.

    Parameters
    ----------
    sites
        Those it reaches; None for all.
    until
        When that ends [s since 1970].
    still
        Whether it has not been taken back meanwhile; asked by what lasts, such as a stream.
    """

    name: str
    scope: Scope
    sites: frozenset[str] | None
    until: float = math.inf
    still: Callable[[], bool] = lambda: True

    def reaches(self, site: str) -> bool:
        """Whether it may see anything of a site."""
        return self.sites is None or site in self.sites

    def sees(self, twin_id: str) -> bool:
        """Whether it may see a twin."""
        return self.reaches(site_of(twin_id))

    def covers(self, sites: Iterable[str]) -> bool:
        """Whether it may see all of what belongs to several sites; of none, if to all sites."""
        every = frozenset(sites)
        return self.sites is None or (bool(every) and every <= self.sites)

    def seen(self, names: Iterable[str]) -> list[str]:
        """Keep the twins and composites that it may see."""
        return [name for name in names if self.sees(name)]

    def to_message(self) -> dict[str, Any]:
        """Write its name and sites, for another process that has to decide by them."""
        return {
            "name": self.name,
            "scope": self.scope.word,
            "sites": None if self.sites is None else sorted(self.sites),
        }

    @classmethod
    def of_message(cls, told: Mapping[str, Any]) -> Self:
        """Read the output of `to_message`."""
        sites = None if told["sites"] is None else frozenset(told["sites"])
        return cls(told["name"], Scope.of(told["scope"]), sites)

    def to_dict(self) -> dict[str, Any]:
        """Render the principal for its own session."""
        return {
            "name": self.name,
            "scope": self.scope.word,
            "sites": ["*"] if self.sites is None else sorted(self.sites),
            "until": None if math.isinf(self.until) else self.until,
        }


EVERYBODY = Principal("a local user", Scope.ADMIN, None)
"""Who asks a server that listens to its own machine and knows no tokens."""

NOBODY = Principal("nobody in particular", Scope.VIEWER, frozenset())
"""Who asks what anybody may, without a token."""

SERVER = Principal("the server", Scope.ADMIN, None)
"""Who asks for what the server itself needs, and tells nobody but its operators."""


def principal_of(scope: MutableMapping[str, Any]) -> Principal:
    """Return the principal of a request; `EVERYBODY` where access is not restricted."""
    found = scope.get(KEY, EVERYBODY)
    assert isinstance(found, Principal)
    return found
