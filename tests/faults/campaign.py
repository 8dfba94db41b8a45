"""One recording through a fleet of shards whose processes are killed at seeded instants.

    python -m tests.faults.campaign --shards 2 --events 50 --seed 1        kills, PostgreSQL
    python -m tests.faults.campaign --what rolling --sqlite --events 8     restarts in turn
    python -m tests.faults.campaign --what backup --sqlite --events 8      copies under load

Edge agents, as some sessions that connect like them, play a recording, keep what is not
acknowledged, and answer for it. At seeded instants, `kills` kills a shard, the router or
PostgreSQL by SIGKILL; `rolling` ends one shard after the other; `backup` copies the database of
a shard. At the end the hash of every history is compared with that of a single server that was
given the same recording in peace, and every reading is counted. The recovery of an event lasts
until each shard has acknowledged a feature that was made after it.

Leaves with 1 where a hash differs, or anything is missing or there twice.
"""

import argparse
import collections
import contextlib
import functools
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slowtime_services.shards import Share
from tests.postgres import kill, restart, schema_of, server
from twin_server.persist import backup, open_store
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

from . import processes
from .history import databases, look, shares
from .house import RETRY, _free_port, context
from .instruments import Dial
from .player import BOOT, SITE, Player, Recorded, recording, sample_of

PATIENCE_S = 300.0
"""How long all may take to become durable after the last event [s]."""

AWAY_S = (0.0, 3.0)
"""How long router or PostgreSQL stay away, at least and at most [s]; a shard's supervisor
decides itself."""


class Event(NamedTuple):
    """Something that happens at `at_s`; router and PostgreSQL come back `for_s` later."""

    at_s: float
    kind: str
    who: str
    for_s: float


def events(given: argparse.Namespace) -> list[Event]:
    """Draw what happens when: the same seed gives the same events."""
    rng = np.random.default_rng(given.seed)
    names = [f"shard-{index}" for index in range(given.shards)]
    instants = np.sort(rng.uniform(2.0, given.seconds, given.events)).tolist()
    if given.what != "kills":
        kind = {"rolling": "end", "backup": "backup"}[given.what]
        even = np.linspace(2.0, given.seconds, given.events, endpoint=False).tolist()
        return [Event(at_s, kind, names[i % len(names)], 0.0) for i, at_s in enumerate(even)]
    kinds = ["router"] if given.router_only else ["shard", "router"]
    if not given.sqlite and not given.router_only:
        kinds.append("postgres")
    made = []
    for at_s in instants:
        who = str(rng.choice(kinds))
        named = str(rng.choice(names))
        made.append(
            Event(at_s, "kill", named if who == "shard" else who, float(rng.uniform(*AWAY_S)))
        )
    return made


class Fleet:
    """Router, PostgreSQL and shards, each of which can be killed and come back."""

    def __init__(
        self, home: Path, given: argparse.Namespace, database: str, postgres: Path | None
    ) -> None:
        self._home, self._postgres = home, postgres
        self._context, count = context(), given.shards
        self.endpoint = f"tcp/127.0.0.1:{_free_port()}"
        self._dials = [Dial(home / f"shard-{index}.pid", 0.0) for index in range(count)]
        Dial(home / "twin.clock", 0.0)
        Dial(home / "shards.up", 0.0)
        self._router = self._start(processes.router, self.endpoint)
        settings = {
            "port": 0, "database": database, "connect": (self.endpoint,), "zenoh": RETRY,
            "connect_timeout_s": 600.0, "healing": {"max_backoff_s": 2.0},
            "serve": {"workers": 1}, "shards": {"count": count, "max_backoff_s": 2.0},
        }  # fmt: skip
        self._front = self._start(processes.fleet, settings, given.quick)
        self._away: dict[str, int] = collections.Counter()

    def _start(self, target: Callable[..., None], *given: Any) -> Any:
        process = self._context.Process(target=target, args=(self._home, *given))
        process.start()
        return process

    def pid(self, who: str) -> int:
        """Return the process of a shard; 0 while there is none."""
        return int(self._dials[int(who.rpartition("-")[2])].value)

    def inflict(self, event: Event) -> Callable[[], None]:
        """Kill or end a process; what is returned brings it back."""
        if event.who == "router":
            self._away["router"] += 1
            self._router.kill()
            self._router.join()
            return self._router_back
        if event.who == "postgres":
            assert self._postgres is not None
            self._away["postgres"] += 1
            kill(self._postgres)
            return self._postgres_back
        by = signal.SIGKILL if event.kind == "kill" else signal.SIGTERM
        if pid := self.pid(event.who):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, by)
        return lambda: None

    def _router_back(self) -> None:
        self._away["router"] -= 1
        if not self._away["router"]:
            self._router = self._start(processes.router, self.endpoint)

    def _postgres_back(self) -> None:
        self._away["postgres"] -= 1
        if not self._away["postgres"]:
            assert self._postgres is not None
            restart(self._postgres)

    def close(self) -> int | None:
        """End all; give the exit status of the front."""
        self._front.terminate()
        self._front.join(60.0)
        self._front.kill()
        status = self._front.exitcode
        self._router.terminate()
        self._router.join(15.0)
        self._router.kill()
        return None if status is None else int(status)


def play(
    given: argparse.Namespace, fleet: Fleet, player: Player, parts: list[str]
) -> list[str]:
    """Play the recording while events happen; return what copies have said."""
    agenda: list[tuple[float, Callable[[], None]]] = []
    said: list[str] = []

    def happen(event: Event) -> None:
        player.note(f"{event.kind} {event.who}")
        if event.kind == "backup":
            said.append(_copy(event, parts, player))
            return
        agenda.append((event.at_s + event.for_s, fleet.inflict(event)))
        agenda.sort(key=lambda due: due[0])

    for event in events(given):
        agenda.append((event.at_s, functools.partial(happen, event)))
    agenda.sort(key=lambda due: due[0])
    player.begin(given.seconds + 2.0)
    while player.playing or agenda:
        now_s = player.step()
        while agenda and agenda[0][0] <= now_s:
            agenda.pop(0)[1]()
        time.sleep(0.01)
    until_s = time.monotonic() + PATIENCE_S
    while player.waiting and time.monotonic() < until_s:
        player.step()
        time.sleep(0.01)
    return said


def _copy(event: Event, parts: list[str], player: Player) -> str:
    """Copy the database of a shard; say what it holds, and what it lacks of what it must."""
    database = Path(parts[int(event.who.rpartition("-")[2])])
    out = database.with_name(f"copy-{event.at_s:.0f}-{database.name}")
    before = player.acknowledged()
    began_s = time.monotonic()
    backup(database, out)
    took_s = time.monotonic() - began_s
    held = collections.Counter(asset for (asset, _, _), _ in look([str(out)]).history)
    share = Share(int(event.who.rpartition("-")[2]), len(parts))
    lacks = sum(
        max(0, last + 1 - held[asset]) for asset, last in before.items() if share.has(asset)
    )
    return (
        f"copy of {event.who}: {sum(held.values())} features, "
        f"{out.stat().st_size / 1e6:.1f} MB in {took_s:.2f} s, {lacks} lacking of those "
        "acknowledged when it began"
    )


def in_peace(messages: list[Recorded], path: Path) -> dict[str, object]:
    """Give the recording to a single server; its hash of each asset's history."""
    with contextlib.closing(open_store(path)) as store:
        Pipeline(TwinSettings(), store).ingest(map(sample_of, messages))
        return {asset: store.digest(f"{SITE}.{asset}") for asset in {m.asset for m in messages}}


def judge(
    database: str, parts: list[str], messages: list[Recorded], expected: dict[str, object]
) -> list[str]:
    """Return what is wrong with the histories of the fleet."""
    found: dict[str, object] = {}
    for share in shares(len(parts)):
        with contextlib.closing(open_store(database, share=share)) as store:
            for asset in expected:
                if share is None or share.has(asset):
                    found[asset] = store.digest(f"{SITE}.{asset}")
    seen = look(parts)
    counted = collections.Counter(key for key, _ in seen.history)
    made = {(message.asset, BOOT, message.sequence) for message in messages}
    wrong = [asset for asset in expected if found[asset] != expected[asset]]
    twice = [key for key, count in counted.items() if count > 1]
    return [
        f"{len(these)} {what}, such as {sorted(these)[:3]}"
        for what, these in (
            ("histories with another hash", wrong),
            ("readings there twice", twice),
            ("readings missing", list(made - set(counted))),
            ("readings that nobody made", list(set(counted) - made)),
            ("ranges reported lost", seen.lost),
        )
        if these
    ]


def run(given: argparse.Namespace, home: Path, database: str, postgres: Path | None) -> int:
    """Run the campaign in the folder `home`, and print what was found."""
    messages = recording(given.assets, given.each, given.seed)
    expected = in_peace(messages, home / "peace.sqlite")
    fleet = Fleet(home, given, database, postgres)
    player = Player(fleet.endpoint, messages, given.sessions, given.shards)
    try:
        if not player.open(PATIENCE_S):
            print("The fleet did not acknowledge its first features.")
            return 1
        parts = databases(database, given.shards)
        said = play(given, fleet, player, parts)
        waiting = player.waiting
    finally:
        player.close()
        status = fleet.close()
    faults = judge(database, parts, messages, expected)
    if waiting:
        faults.append(f"{waiting} features not acknowledged within {PATIENCE_S:g} s")
    if status:
        faults.append(f"the front ended with {status}")
    print(*said, *player.report(), sep="\n")
    print(f"load of the machine: {os.getloadavg()[1]:.1f} in the last 5 minutes")
    print("; ".join(faults) or f"sound: {len(expected)} of {len(expected)} hashes identical")
    return 1 if faults else 0


def main(words: list[str] | None = None) -> int:
    """Run a campaign in a temporary folder, or in the one given."""
    parser = argparse.ArgumentParser(description="Kill the processes of a fleet of shards.")
    parser.add_argument("--what", choices=["kills", "rolling", "backup"], default="kills")
    parser.add_argument("--shards", type=int, default=2)
    parser.add_argument("--events", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--assets", type=int, default=40)
    parser.add_argument("--each", type=int, default=300, help="features of an asset")
    parser.add_argument("--sessions", type=int, default=4, help="of the edge agents")
    parser.add_argument("--sqlite", action="store_true", help="in place of PostgreSQL")
    parser.add_argument("--router-only", action="store_true", help="kill nothing else")
    parser.add_argument("--quick", action="store_true", help="start shards by a fork")
    parser.add_argument("--out", type=Path, help="folder of logs and databases")
    given = parser.parse_args(words)
    with contextlib.ExitStack() as stack:
        made = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="slowtime-fleet-")))
        home = given.out or made
        home.mkdir(parents=True, exist_ok=True)
        if given.sqlite:
            return run(given, home, str(home / "twin.sqlite"), None)
        folder = made / "pg"
        url = stack.enter_context(server(folder))
        return run(given, home, schema_of(url, "campaign"), folder)


if __name__ == "__main__":
    sys.exit(main())
