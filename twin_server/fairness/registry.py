"""All that is held, of every kind: listed and ended by who may, and counted by site."""

from collections.abc import Iterator
from typing import Any

from twin_server.identity.principals import Principal

from .holders import Holder
from .quota import Quota, QuotaHolding


class Holdings:
    """The quotas of a server, by the kind of what they are for."""

    def __init__(self) -> None:
        self._quotas: dict[str, Quota] = {}

    def add(self, quota: Quota) -> Quota:
        """Make a quota known; return it."""
        self._quotas[quota.kind] = quota
        return quota

    def quotas(self) -> list[Quota]:
        """All quotas, in the order in which they were added."""
        return list(self._quotas.values())

    def seen(self, principal: Principal) -> list[dict[str, Any]]:
        """Return what the sites that a caller reaches hold, the oldest first."""
        found = sorted(self._seen(principal), key=lambda one: one.since_s)
        return [_described(one) for one in found]

    def find(self, holding_id: str, principal: Principal) -> QuotaHolding | None:
        """Return one by its id; None where there is none that the caller may see."""
        return next((one for one in self._seen(principal) if one.id == holding_id), None)

    def counts(self) -> Iterator[tuple[str, str, int, int]]:
        """Yield kind, site, how many it holds, and how many it was refused."""
        for quota in self.quotas():
            held = [one.holder.site for one in quota.held()]
            for site in sorted({*held, *quota.refused}):
                yield quota.kind, site, held.count(site), quota.refused[site]

    def _seen(self, principal: Principal) -> Iterator[QuotaHolding]:
        for quota in self.quotas():
            for one in quota.held():
                if principal.covers(one.holder.sites):
                    yield one


def _described(one: QuotaHolding) -> dict[str, Any]:
    holder: Holder = one.holder
    return {
        "id": one.id,
        "kind": one.kind,
        "what": one.what,
        "site": holder.site,
        "token": holder.token,
        "since_ns": int(one.since_s * 1e9),
        "cancellable": one.on_cancel is not None,
    }
