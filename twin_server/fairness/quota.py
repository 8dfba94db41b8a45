r"""Slots that are held for a while: how many a site and a token may hold at once.

A site may hold one more while it holds less than what is free: the dynamic threshold of
Choudhury and Hahne [1]_ with :math:`\alpha = 1`. One site alone gets half of all; the other
half is the reserve for others. Of `k` sites that take all they can, one after the other, the
last still leaves :math:`2^{-k}` of all, and each has :math:`1 / (1 + k)` once slots have been
given back and taken again. The same holds for the tokens of a site, with :math:`\alpha = 4`:
one token alone gets four fifths of what one site may hold.

References
----------
.. [1] A. K. Choudhury and E. L. Hahne, "Dynamic queue length thresholds for shared-memory
   packet switches", IEEE/ACM Transactions on Networking 6 (1998), 130-140.
"""

import dataclasses
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Literal

from .holders import ALONE, Holder

ALPHA = 1
"""Ratio of what a site may hold to what is free [1]. With 2, one site alone would get two
thirds, but three of them in turn would leave one slot of 27 instead of one of 8."""

ALPHA_OF_TOKEN = 4
"""The same for a token and what is free of its site's [1]: tokens of one site are colleagues,
so that a fifth is reserve enough."""


HeldKind = Literal["uploads", "replays", "diagnoses", "computations", "exports", "streams"]
"""Kind of what is held; computations are forecasts, simulations, plans and risks."""


class OverQuotaError(RuntimeError):
    """A slot that may not be taken now; the text says what is held and what is allowed.

    Parameters
    ----------
    own
        Whether the caller's own site or token holds too much, rather than all together.
    """

    def __init__(self, text: str, *, own: bool) -> None:
        super().__init__(text)
        self.own = own


def may_take(held: int, free: int, alpha: int = ALPHA) -> bool:
    """Whether who holds so many may take one more while so many are free."""
    return free > 0 and held < alpha * free


@dataclasses.dataclass(eq=False, slots=True)
class QuotaHolding:
    """Something that is held: given back by `release`, or ended from outside by `cancel`.

    Parameters
    ----------
    what
        Said to who asks what holds their site up.
    on_cancel
        Ends it; None for what ends by itself at once.
    """

    quota: "Quota"
    holder: Holder
    what: str
    on_cancel: Callable[[], object] | None
    id: str = dataclasses.field(default_factory=lambda: secrets.token_hex(8))
    since_s: float = dataclasses.field(default_factory=time.time)

    @property
    def kind(self) -> HeldKind:
        """Kind of what is held."""
        return self.quota.kind

    def release(self) -> None:
        """Give the slot back; again does nothing."""
        self.quota.release(self)


class Quota:
    """Slots of one kind; may be used from any thread.

    Parameters
    ----------
    kind
        What is held.
    most, of_site, of_token
        At once in all, of one site, and of one token; None for no bound beside the thresholds.
    setting
        Name of the setting of `most`, for texts.
    """

    def __init__(
        self,
        kind: HeldKind,
        most: int,
        *,
        setting: str,
        of_site: int | None = None,
        of_token: int | None = None,
    ) -> None:
        self.kind, self.most, self._setting = kind, most, setting
        self._of_site, self._of_token = of_site, of_token
        self._lock = threading.Lock()
        self._held: dict[str, QuotaHolding] = {}
        self._sites, self._tokens = Counter[str](), Counter[Holder]()
        self.refused = Counter[str]()

    @property
    def count(self) -> int:
        """Number of slots that are held."""
        return len(self._held)

    def held(self) -> list[QuotaHolding]:
        """Return all that are held."""
        with self._lock:
            return list(self._held.values())

    def of_site(self, site: str) -> int:
        """Return the number that a site holds."""
        return self._sites[site]

    def take(
        self, holder: Holder, what: str, on_cancel: Callable[[], object] | None = None
    ) -> QuotaHolding:
        """Take a slot.

        Raises
        ------
        OverQuotaError
            Where site or token hold too much, or all are held.
        """
        holding = QuotaHolding(self, holder, what, on_cancel)
        with self._lock:
            self._check(holder)
            self._held[holding.id] = holding
            self._sites[holder.site] += 1
            self._tokens[holder] += 1
        return holding

    def check(self, holder: Holder) -> None:
        """Refuse what could not be taken now.

        Raises
        ------
        OverQuotaError
            As `take`.
        """
        with self._lock:
            self._check(holder)

    def release(self, holding: QuotaHolding) -> None:
        """Give a slot back."""
        with self._lock:
            if self._held.pop(holding.id, None) is None:
                return
            self._sites[holding.holder.site] -= 1
            self._tokens[holding.holder] -= 1
            self._sites += Counter()  # forgets who has none
            self._tokens += Counter()

    def _check(self, holder: Holder) -> None:
        free = self.most - len(self._held)
        of_site, of_token = self._sites[holder.site], self._tokens[holder]
        whose, held, allowed = "", 0, 0
        if holder == ALONE:
            if self._of_site is not None and of_site >= self._of_site:
                whose, held, allowed = "on this server", of_site, self._of_site
        elif of_site >= (self._of_site or self.most) or (free and not may_take(of_site, free)):
            allowed = min(self._of_site or self.most, of_site)
            whose, held = "of your sites", of_site
        elif of_token >= (self._of_token or self.most) or not may_take(
            of_token, self._site_most - of_site, ALPHA_OF_TOKEN
        ):
            allowed = min(self._of_token or self.most, of_token)
            whose, held = "of your token", of_token
        if whose or free <= 0:
            self.refused[holder.site] += 1
        if whose:
            raise OverQuotaError(
                f"{held} {self.kind} {whose} are under way. Allowed now: {allowed} "
                f"({self._setting}). Wait until one ends, or cancel one: GET "
                "/api/v1/holdings lists them.",
                own=True,
            )
        if free <= 0:
            raise OverQuotaError(
                f"The server has no room for more {self.kind}. Allowed: {self.most} at once "
                f"({self._setting}). Try again later.",
                own=False,
            )

    @property
    def _site_most(self) -> int:
        """What one site alone may hold, at least 1."""
        alone = -(-self.most * ALPHA // (1 + ALPHA))
        return min(alone, self._of_site or alone)
