"""Which composites a principal may see: those of which all parts are of its sites.

A composite belongs to the site of its id. It is seen by who may see its id and all composites
and twins within it, since its health, its tree and its texts tell of all of them.
"""

from collections.abc import Mapping, Sequence

from twin_server.identity.principals import Principal, site_of

from .composite import Composite
from .hierarchy import Composites

Sites = Mapping[str, frozenset[str]]
"""Of each composite, the sites of its id and of everything within it."""


def sites_of(composites: Composites) -> dict[str, frozenset[str]]:
    """Return the sites of each composite, each computed once however often it is a member."""
    found: dict[str, frozenset[str]] = {}
    for start in composites:
        waiting = [start]
        while waiting:
            name = waiting[-1]
            parts = [one for one in composites[name].members if one in composites]
            missing = [one for one in parts if one not in found]
            if name not in found and missing:
                waiting += missing
                continue
            waiting.pop()
            own = {site_of(one) for one in (name, *composites[name].members)}
            found[name] = frozenset(own).union(*(found[one] for one in parts))
    return found


def seen(
    composites: Composites, principal: Principal, sites: Sites | None = None
) -> Composites:
    """Keep the composites that a principal may see, in their order.

    Parameters
    ----------
    sites
        Of each composite, where they are known already.
    """
    if principal.sites is None:
        return composites
    of_each = sites_of(composites) if sites is None else sites
    return {name: one for name, one in composites.items() if principal.covers(of_each[name])}


def history_of(
    composite_id: str, registrations: Sequence[tuple[str, Composite | None]]
) -> list[frozenset[str]]:
    """Return the sites of each registration of a composite, as of when it was registered.

    Parameters
    ----------
    registrations
        Of all composites in order; None where one was deleted, which tells of the sites of the
        registration before.
    """
    then: dict[str, Composite] = {}
    found: list[frozenset[str]] = []
    for name, one in registrations:
        if one is not None:
            then[name] = one
        else:
            then.pop(name, None)
        if name == composite_id:
            before = found[-1] if found else frozenset({site_of(composite_id)})
            found.append(before if one is None else _sites_within(composite_id, then))
    return found


def _sites_within(composite_id: str, composites: Composites) -> frozenset[str]:
    found: set[str] = set()
    waiting, known = [composite_id], {composite_id}
    while waiting:
        name = waiting.pop()
        found.add(site_of(name))
        if name in composites:
            more = set(composites[name].members) - known
            known |= more
            waiting += more
    return frozenset(found)
