"""Schedules of faults by seed: the same seed gives the same schedule."""

import dataclasses
from typing import NamedTuple

import numpy as np

ASSETS = ("beam", "wing")
"""Of different shards of two, and of four."""

RATE_HZ = 4.0
"""Features a second of each asset; a burst makes ten times as many."""


class Fault(NamedTuple):
    """Something that goes wrong from `at_s` on, for `for_s`."""

    at_s: float
    for_s: float
    kind: str
    who: str
    amount: float = 0.0

    def __str__(self) -> str:
        amount = f" {self.amount:+g}" if self.amount else ""
        return f"{self.at_s:.2f} s {self.kind} of {self.who}{amount} for {self.for_s:.2f} s"


HOURS_S = 3600.0

# Kind, who it may befall, how long it may last, and how likely it is beside the others.
KINDS: dict[str, tuple[tuple[str, ...], tuple[float, float], float]] = {
    "kill": (("router", "twin", "twin", "twin", *ASSETS), (0.0, 5.0), 4.0),
    "end": (("router", "twin", *ASSETS), (0.0, 3.0), 1.0),
    "freeze": (("router", "twin", *ASSETS), (0.2, 4.0), 1.0),
    "cut": (("twin", *ASSETS), (0.2, 6.0), 2.0),
    "stall": (("twin", *ASSETS), (0.2, 8.0), 1.0),
    "burst": (ASSETS, (1.0, 10.0), 1.5),
    "poison": (ASSETS, (0.0, 0.0), 1.0),
    "echo": (ASSETS, (0.0, 0.0), 1.5),
    "clock": (("twin", *ASSETS), (1.0, 8.0), 1.5),
    "disk": (("twin", *ASSETS), (0.3, 5.0), 1.5),
    "lock": (("twin",), (0.3, 14.0), 0.7),
    "rot": (ASSETS, (0.0, 3.0), 1.0),
    "slow": (("bus", "live"), (2.0, 8.0), 0.7),
}
"""All that can go wrong here."""

FLEET = "fleet"
"""The front and all shards at once."""


def shard_names(shards: int) -> tuple[str, ...]:
    """Name the processes of the shards; none where the twin server is a single one."""
    return () if shards == 1 else tuple(f"shard-{index}" for index in range(shards))


def _befalls(kind: str, shards: int) -> tuple[str, ...]:
    """Say who a kind of fault may befall; shards are killed and frozen beside the others."""
    names = shard_names(shards)
    if kind == "kill" and names:
        return (*KINDS[kind][0], *names, *names, FLEET)
    return (*KINDS[kind][0], *names) if kind in ("end", "freeze") else KINDS[kind][0]


@dataclasses.dataclass(frozen=True, slots=True)
class Plan:
    """What happens under one seed.

    Parameters
    ----------
    time_base
        ``"live"``: sensors stamp with the edge's clock, jumps and all.
    spool_bytes
        Of each edge; a small one overflows while the twin is away.
    shards
        Of the twin server; 1 is a single one.
    link
        Profile of the edges' link.
    """

    seed: int
    seconds: float
    time_base: str
    spool_bytes: int
    faults: tuple[Fault, ...]
    shards: int = 1
    link: str = "lab"

    @property
    def may_lose(self) -> bool:
        """Whether anything in the schedule excuses a loss, which then must be reported."""
        edge_disk = any(f.kind == "disk" and f.who != "twin" for f in self.faults)
        clock = self.time_base == "live" and any(f.kind == "clock" for f in self.faults)
        rot = any(f.kind == "rot" for f in self.faults)
        return edge_disk or clock or rot or self.spool_bytes < 2**20


def plan(seed: int, seconds: float, shards: int = 1, link: str = "lab") -> Plan:
    """Draw a schedule: about a fault every three seconds, overlapping as they like."""
    rng = np.random.default_rng(seed)
    names = list(KINDS)
    weights = np.array([KINDS[name][2] for name in names])
    faults = []
    for _ in range(1 + rng.poisson(seconds / 3.0)):
        kind = str(rng.choice(names, p=weights / weights.sum()))
        _, (least, most), _weight = KINDS[kind]
        for_s = min(float(rng.uniform(least, most)), 0.6 * seconds)
        at_s = float(rng.uniform(0.5, max(0.6, seconds - for_s)))
        amount = float(rng.choice([-1, 1]) * rng.uniform(1, 6)) * HOURS_S
        who = str(rng.choice(_befalls(kind, shards)))
        faults.append(Fault(at_s, for_s, kind, who, amount if kind == "clock" else 0.0))
    return Plan(
        seed,
        seconds,
        str(rng.choice(["simulated", "live"])),
        int(rng.choice([2**26, 2**26, 2**16])),
        tuple(sorted(faults)),
        shards,
        link,
    )
