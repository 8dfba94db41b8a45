"""Limits how many assets of a site are taken in that nobody has registered."""

from collections.abc import Container, Sequence

from slowtime_schemas.messages import Message
from twin_server.collect import Account, Refusals


class AssetLimit:
    """Lets messages of known assets pass, and those of new ones while their site has room.

    A certificate of an edge speaks for its own asset alone; who holds many, or speaks on a bus
    without certificates, could otherwise fill the memory with assets that do not exist.

    Parameters
    ----------
    most
        Assets of one site.
    refusals
        Where refused messages are counted.
    """

    def __init__(self, most: int, refusals: Refusals) -> None:
        self._most, self._refusals = most, refusals

    def allowed(
        self,
        messages: Sequence[Message],
        account: Account,
        twins: Container[tuple[str, str]],
    ) -> list[bool]:
        """Whether each message is let in, in their order."""
        new: set[tuple[str, str]] = set()
        found = []
        for message in messages:
            key = message.site, message.asset
            is_known = key in new or self.admits(key, account, twins, len(new))
            if is_known and key not in twins and not account.knows(*key):
                new.add(key)
            found.append(is_known)
        return found

    def admits(
        self,
        key: tuple[str, str],
        account: Account,
        twins: Container[tuple[str, str]],
        more: int = 0,
    ) -> bool:
        """Whether anything of an asset is let in, after `more` others that are new."""
        if key in twins or account.knows(*key):
            return True
        if account.assets_of(key[0]) + more < self._most:
            return True
        self._refusals.refuse(
            "too_many_assets",
            f"A message of {key[0]}.{key[1]} was given. Allowed: {self._most:,} assets of a "
            f"site without registration. PUT /api/v1/twins/{key[0]}.{key[1]}, or raise "
            "admission.max_assets_of_site.",
        )
        return False
