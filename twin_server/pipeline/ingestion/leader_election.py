"""Elects one twin server of a bus to publish: the one that announced itself first.

Two servers that acknowledge would let edges delete what only one of them has. Each announces
itself by a liveliness token; its name is greater than those it finds, so that all agree on who
was first. The others keep a history of their own, and publish and acknowledge nothing. Shards
of one count have different assets, so that each is compared with the same shard of another
fleet, with fleets of other counts, and with servers of all assets.
"""

import contextlib
import datetime
import logging
import math
import platform
import re
import secrets
import threading
import time

from slowtime_schemas.streams import server_key
from slowtime_services.bus import Bus, Handle
from slowtime_services.clock import Clock
from slowtime_services.shards import Share

logger = logging.getLogger(__name__)

_LONGEST_HOST = 30
"""Characters of the host name in a liveliness token."""

_CLAIM = re.compile(
    rf"(\d{{20}})-[0-9a-f]{{6}}-[a-z0-9-]{{1,{_LONGEST_HOST}}}(?:\.(\d{{1,4}}of\d{{1,4}}))?",
    re.ASCII,
)
"""Name of a server, as `LeaderElection.step` makes it; no other token is a claim."""

_LATEST_NS = 2**63 + 2**62
"""Instants in names are below this [ns]: clocks end at 2**63 ns, in 2262, and each server that
starts beside others adds one. Their 20 digits sort as the numbers do."""

MOST_EARLIER = 1_000
"""Names of servers before this one that are kept [1]. A site has two or three; an operator who
starts as many has made a mistake, or they are false."""


class LeaderElection:
    """Decides whether this twin server is the first on its bus.

    Parameters
    ----------
    bus
        None for a pipeline without one, which is always first.
    share
        The assets of this server; None for all.
    """

    def __init__(self, bus: Bus | None, clock: Clock, share: Share | None = None) -> None:
        self._bus, self._clock = bus, clock
        self._share = "" if share is None else str(share)
        self._name = ""
        self._others: set[str] = set()
        self._let_go = ""
        """First of the earlier servers whose names were not kept, since there were too many."""
        self._sought = ""
        """The same, while it is looked for again."""
        self._seconds = 0
        self._handles: list[Handle] = []
        self._looks_s: float | None = None
        self._told: str | None = None
        self._lock = threading.Lock()

    def start(self) -> None:
        """Watch the tokens of other servers."""
        if self._bus is None:
            return
        self._handles = [self._bus.watch(server_key("*"), self._see)]

    def step(self) -> None:
        """Announce this server after the present ones are known."""
        if self._bus is None:
            return
        if self._name:
            self._look_again(self._bus)
            return
        if not self._has_looked(self._bus):
            return
        with self._lock:
            latest = max(map(_began, self._others), default=0)
            began_ns = min(max(self._clock.now_ns(), latest + 1), _LATEST_NS - 1)
            self._name = f"{began_ns:020d}-{secrets.token_hex(3)}-{_host()}"
            if self._share:
                self._name += f".{self._share}"
            self._others = {name for name in self._others if name < self._name}
            self._let_go = self._let_go if self._let_go < self._name else ""
        self._handles.append(self._bus.announce(server_key(self._name)))
        self._tell()

    def _has_looked(self, bus: Bus) -> bool:
        """Whether a bus that may open late has been watched for long enough."""
        now_s, delay_s = time.monotonic(), bus.watch_delay_s
        if not math.isfinite(delay_s):
            return False
        if self._looks_s is None:
            self._looks_s = now_s
        return now_s >= self._looks_s + delay_s

    def _look_again(self, bus: Bus) -> None:
        """Watch anew once all names that were kept have gone, and others were let go."""
        if self._others:
            self._sought = ""
            return
        if self._let_go:
            self._sought, self._let_go, self._looks_s = self._let_go, "", None
            self._handles[0].close()
            self._handles[0] = bus.watch(server_key("*"), self._see)
        if self._sought and self._has_looked(bus) and not self._others:
            self._sought = ""
            self._tell()

    def resign(self) -> None:
        """Withdraw this server's token, so that another leads; `step` announces it anew."""
        if self._bus is None or not self._name:
            return
        with self._lock:
            self._name = self._sought = self._let_go = ""
            self._others.clear()
        for handle in reversed(self._handles):
            handle.close()
        self._looks_s = None
        # Of later servers none was kept, and one of them is first from now on.
        self._handles = [self._bus.watch(server_key("*"), self._see)]

    def stop(self) -> None:
        """Be there no longer."""
        for handle in reversed(self._handles):
            handle.close()
        self._handles.clear()

    @property
    def acknowledges(self) -> bool:
        """Whether this server is the first."""
        return self._bus is None or (bool(self._name) and self.first is None)

    @property
    def first(self) -> str | None:
        """Name of the server that was there before this one; None where there is none."""
        with self._lock:
            earliest = min(self._others, default=None)
            if earliest is None or (self._name and self._name < earliest):
                return self._let_go or self._sought or None
            return earliest

    @property
    def trouble(self) -> str:
        """Describe the server that was first; empty where this one is."""
        first = self.first
        if first is None:
            return ""
        return (
            f"Another twin server was already on this bus: {_described(first)}. This "
            "server keeps its own history, but publishes and acknowledges nothing. Stop "
            "one of the two."
        )

    def _see(self, key: str, alive: bool) -> None:
        name = key.rpartition("/")[2]
        if not _is_claim(name):
            logger.warning("%.60r is announced as a twin server and is none; ignored.", name)
            return
        with self._lock:
            if name == self._name or not _compete(self._share, _share_in(name)):
                return
            # Who was announced later never leads before this one: its name need not be kept.
            earlier = not self._name or name < self._name
            if alive and earlier:
                self._keep(name)
            else:
                self._others.discard(name)
        if self._name:
            self._tell()
            if alive and self.first is None:
                self._say_second(name)

    def _keep(self, name: str) -> None:
        """Remember an earlier server; of too many, those that would lead first."""
        self._others.add(name)
        if len(self._others) > MOST_EARLIER:
            last = max(self._others)
            self._others.discard(last)
            self._let_go = min(self._let_go or last, last)

    def _say_second(self, name: str) -> None:
        self._seconds += 1
        if self._seconds & (self._seconds - 1) == 0:  # the 1st, 2nd, 4th, 8th ...
            logger.warning(
                "A second twin server is on this bus: %s. It publishes and acknowledges "
                "nothing. Stop one of the two.",
                _described(name),
            )

    def _tell(self) -> None:
        """Log changes."""
        before, self._told = self._told, self.first
        if self._told is not None and self._told != before:
            logger.error("%s", self.trouble)
        elif self._told is None and before is not None:
            logger.warning("The other twin server has stopped; this one publishes from now on.")


def _is_claim(name: str) -> bool:
    """Whether a token is that of a server.

    Examples
    --------
    >>> _is_claim("01767225600000000000-1a2b3c-host.0of2"), _is_claim("9" * 20 + "-1a2b3c-host")
    (True, False)
    """
    return _CLAIM.fullmatch(name) is not None and _began(name) < _LATEST_NS


def _began(name: str) -> int:
    return int(name.partition("-")[0])


def _share_in(name: str) -> str:
    """Return the share that a name tells, as `2of8`; empty for all assets."""
    return name.partition(".")[2]


def _compete(one: str, other: str) -> bool:
    """Whether two servers may have an asset in common.

    Examples
    --------
    >>> [_compete(*p) for p in (("", ""), ("", "0of2"), ("0of2", "0of2"), ("0of2", "1of3"))]
    [True, True, True, True]
    >>> _compete("0of2", "1of2")
    False
    """
    if not one or not other or one == other:
        return True
    return one.partition("of")[2] != other.partition("of")[2]


def _host() -> str:
    name = "".join(
        c for c in platform.node().lower() if c.isascii() and (c.isalnum() or c == "-")
    )
    return name[:_LONGEST_HOST].strip("-") or "host"


def _described(name: str) -> str:
    host = name.split("-", 2)[-1]
    with contextlib.suppress(ValueError, OverflowError, OSError):
        began = datetime.datetime.fromtimestamp(_began(name) // 10**9, datetime.UTC)
        return f"on {host}, since {began:%Y-%m-%dT%H:%M:%SZ}"
    return f"on {host}"
