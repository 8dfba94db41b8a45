"""On whose behalf something is held or computed: a site, and a token of it."""

import contextlib
import contextvars
from collections.abc import Iterator
from typing import NamedTuple

from twin_server.identity.principals import EVERYBODY, Principal

OF_ALL = "*"
"""Site of what a token of all sites asks about no twin."""


class Holder(NamedTuple):
    """Site and token that something is counted for.

    Parameters
    ----------
    site
        A site; several, joined by commas, for a token of several that asks about no twin.
    token
        Name of the token.

    Examples
    --------
    >>> sorted(Holder("a,b", "t").sites)
    ['a', 'b']
    """

    site: str
    token: str

    @classmethod
    def of(cls, principal: Principal, twin_id: str | None) -> "Holder":
        """Return for whom a request counts: the site of its twin, or those of its token."""
        if principal is EVERYBODY:
            return ALONE
        if twin_id is not None:
            return cls(twin_id.partition(".")[0], principal.name)
        sites = OF_ALL if principal.sites is None else ",".join(sorted(principal.sites))
        return cls(sites, principal.name)

    @property
    def sites(self) -> frozenset[str]:
        """The sites."""
        return frozenset(self.site.split(","))


ALONE = Holder("", "")
"""Everybody, where callers are not told apart: nobody is there to share with."""

_current: contextvars.ContextVar[Holder] = contextvars.ContextVar("holder", default=ALONE)


def current_holder() -> Holder:
    """Return for whom this task or thread works."""
    return _current.get()


@contextlib.contextmanager
def acting_for(holder: Holder) -> Iterator[None]:
    """Count what is held and computed within for a holder."""
    token = _current.set(holder)
    try:
        yield
    finally:
        _current.reset(token)
