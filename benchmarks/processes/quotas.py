"""Sites that take all they can: how long another's upload, replay, forecast and diagnosis take.

    python -m benchmarks.processes.quotas                    some 10 minutes
    python -m benchmarks.processes.quotas --greedy 1 --times 9 --what forecast

A real twin server with tokens of five sites runs in a process of its own. For 1, 2 and 4 greedy
sites, each piece of work of another site is timed alone and beside them by turns, so that what
else the machine does falls on both; the figure is the ratio of the medians. A greedy site does
all of it at once, as often as it is let: uploads at full speed and of a byte a second, replays
at full speed, diagnoses, forecasts of the past, simulations of the largest size, exports, and
streams that it does not read. Leaves with 1 where a ratio is above the number of greedy sites
+ 0.3.
"""

import argparse
import asyncio
import contextlib
import datetime
import json
import math
import multiprocessing
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from slowtime_services.record import RecordingWriter
from twin_server import __main__ as twin_process
from twin_server.identity.tokens import TokenFile
from twin_server.settings import TwinSettings

MODEST, GREEDY = "modest", ("greedy-1", "greedy-2", "greedy-3", "greedy-4")
SLACK = 0.3
"""What may be lost beside the share of each greedy site."""
HISTORY, LONG = 300, 1_500
"""Features of the twin that is asked about, and of a recording that is replayed."""
AGAIN_S = 0.3
"""Pause of a greedy client that was refused [s], far shorter than `Retry-After`."""
PATIENCE_S = 600.0
V1 = "/api/v1"


class HttpAnswer(NamedTuple):
    """What a request was answered with."""

    status: int
    body: bytes

    @property
    def document(self) -> Any:
        """The JSON of it."""
        return json.loads(self.body)


class Site:
    """A client with the token of one site; each request has a connection of its own."""

    def __init__(self, name: str, token: str, port: int, recording: bytes) -> None:
        self.name, self._token, self._port = name, token, port
        self.twin, self.recording = f"{V1}/twins/{name}.beam", recording
        self.statuses = Counter[int]()
        self._number = 0

    async def ask(self, method: str, path: str, body: bytes = b"") -> HttpAnswer:
        """Send a request, and wait for the whole answer."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        try:
            writer.write(self.head(method, path, len(body)) + body)
            status = int((await reader.readline()).split()[1])
            length = None
            while (line := await reader.readline()) not in (b"\r\n", b""):
                key, _, value = line.partition(b":")
                length = int(value) if key.lower() == b"content-length" else length
            told = await (reader.read() if length is None else reader.readexactly(length))
            self.statuses[status] += 1
            return HttpAnswer(status, told)
        finally:
            writer.close()

    def head(self, method: str, path: str, length: int) -> bytes:
        """Return the head of a request."""
        return (
            f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
            f"Authorization: Bearer {self._token}\r\nContent-Type: application/json\r\n"
            f"Content-Length: {length}\r\n\r\n"
        ).encode()

    async def slow_upload(self, name: str) -> None:
        """Send a byte a second of a long recording, until the server has enough of it."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        with contextlib.suppress(OSError):
            writer.write(self.head("PUT", f"{V1}/recordings/{name}", 10**6))
            while not reader.at_eof() and not writer.is_closing():
                writer.write(b"x")
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(reader.read(1), 1.0)
        writer.close()

    async def deaf_stream(self) -> None:
        """Open a stream, and read nothing of it."""
        _, writer = await asyncio.open_connection("127.0.0.1", self._port)
        writer.write(self.head("GET", f"{self.twin}/live", 0))
        await asyncio.sleep(30.0)
        writer.close()

    # The work, whether it is timed or only keeps the server busy.

    async def upload(self) -> HttpAnswer:
        """Give a recording, and delete it."""
        self._number += 1
        name = f"upload-{self._number}.mcap"
        given = await self.ask("PUT", f"{V1}/recordings/{name}", self.recording)
        if given.status == 201:
            await self.ask("DELETE", f"{V1}/recordings/{name}")
        return given

    async def replay(self) -> HttpAnswer:
        """Replay a recording as fast as the twins take it in, and wait for its end."""
        path = f"{V1}/recordings/long.mcap/replay"
        answer = await self.ask("POST", path, b"{}")
        while answer.status in (200, 202):
            found = {one["name"]: one for one in answer.document["recordings"]}
            if found["long.mcap"]["replay"]["state"] != "playing":
                break
            await asyncio.sleep(0.05)
            answer = await self.ask("GET", f"{V1}/recordings")
        return answer

    async def forecast(self) -> HttpAnswer:
        """Ask for a forecast as of a moment of which nothing has been learnt yet."""
        self._number += 1
        at = HISTORY - 1 - self._number % (HISTORY // 2) - self._number * 1e-4
        return await self.ask("GET", f"{self.twin}/forecast?points=100&at=slow:{at}")

    async def diagnosis(self) -> HttpAnswer:
        """Order a diagnosis of the history, and wait for its end."""
        answer = await self.ask("POST", f"{self.twin}/diagnoses", b'{"clock":"slow"}')
        while answer.status in (200, 202):
            told = answer.document
            if told["state"] not in ("queued", "running"):
                break
            await asyncio.sleep(0.1)
            answer = await self.ask("GET", f"{self.twin}/diagnoses/{told['number']}")
        return answer

    async def simulation(self) -> HttpAnswer:
        """Order a simulation of nearly the largest size."""
        self._number += 1
        load = {"kind": "white", "psd": 1e-3}
        order = {"load": load, "rate_hz": 100.0, "duration_s": 190.0, "seed": self._number}
        return await self.ask("POST", f"{self.twin}/simulate", json.dumps(order).encode())

    async def export(self) -> HttpAnswer:
        """Fetch the whole history as a table."""
        return await self.ask("GET", f"{self.twin}/history/export")

    async def give_back(self) -> None:
        """End all that is under way for the site, and wait until it has ended."""
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            listed = (await self.ask("GET", f"{V1}/holdings")).document["holdings"]
            if not listed:
                return
            for one in listed:
                await self.ask("DELETE", f"{V1}/holdings/{one['id']}")
            await asyncio.sleep(0.2)
        raise TimeoutError(f"Work of {self.name} did not end in {PATIENCE_S:g} s.")

    async def take_all(self) -> None:
        """Do all of it at once, for ever."""
        many: dict[Callable[[], Awaitable[Any]], int] = {
            self.upload: 4, self.replay: 2, self.forecast: 8, self.diagnosis: 6,
            self.simulation: 4, self.export: 4, self.deaf_stream: 20,
        }  # fmt: skip

        async def for_ever(work: Callable[[], Awaitable[Any]]) -> None:
            while True:
                with contextlib.suppress(OSError, ValueError, IndexError, KeyError, EOFError):
                    answer = await work()
                    if not isinstance(answer, HttpAnswer) or answer.status < 400:
                        continue
                await asyncio.sleep(AGAIN_S)

        async def slowly(number: int) -> None:
            await for_ever(lambda: self.slow_upload(f"slow-{number}.mcap"))

        await asyncio.gather(
            *(for_ever(work) for work, number in many.items() for _ in range(number)),
            *map(slowly, range(12)),
        )


WORK: dict[str, Callable[[Site], Awaitable[HttpAnswer]]] = {
    "upload": Site.upload,
    "replay": Site.replay,
    "forecast": Site.forecast,
    "diagnosis": Site.diagnosis,
}


def recording(path: Path, site: str, count: int) -> bytes:
    """Write a recording of features; its bytes."""
    rng = np.random.default_rng(0)
    with RecordingWriter(path) as writer:
        for sequence in range(count):
            t_ns = 1_767_225_600_000_000_000 + sequence * 10**10
            hertz = 3.0 * math.sqrt(1.0 - 0.1 * sequence / count) + 1e-3 * rng.normal()
            mode = Mode(
                frequency_hz=Quantity(value=hertz, sd=2e-3),
                damping_ratio=Quantity(value=0.02 + 1e-4 * rng.normal(), sd=1e-3),
            )
            message = Features(
                site=site, asset="beam" if count == HISTORY else "long", boot="b1",
                sequence=sequence, t_ns=t_ns, start_ns=t_ns - 10**9, time_base="simulated",
                slow_time=float(sequence), method="ambient", modes=(mode,),
                quality=Quality(samples=1000),
            )  # fmt: skip
            writer.write(FEATURES, site, message.asset, encode(message), t_ns)
    return path.read_bytes()


def serve(settings: dict[str, Any], pipe: Connection) -> None:
    """Run the server in this process, until the pipe ends."""
    stop = threading.Event()

    def ended() -> None:
        with contextlib.suppress(EOFError, OSError):
            pipe.recv()
        stop.set()

    threading.Thread(target=ended, daemon=True).start()
    with MemoryBus() as bus:
        twin_process.run(TwinSettings(**settings), bus=bus, stop=stop, ready=pipe.send)


def be_greedy(site: Site, pipe: Connection) -> None:
    """Take all one can, between "go" and "stop"."""
    while pipe.recv() == "go":

        async def until_told() -> None:
            greedy = asyncio.ensure_future(site.take_all())
            await asyncio.to_thread(pipe.recv)
            greedy.cancel()

        asyncio.run(until_told())
        pipe.send(site.statuses)


class Crowd:
    """Greedy sites, each in a process of its own."""

    def __init__(self, sites: list[Site]) -> None:
        context = multiprocessing.get_context("spawn")
        self._sites, self.statuses = sites, Counter[int]()
        self._pipes: list[Connection] = []
        for site in sites:
            ours, theirs = context.Pipe()
            context.Process(target=be_greedy, args=(site, theirs), daemon=True).start()
            self._pipes.append(ours)

    def tell(self, word: str, count: int) -> None:
        """Have some of them begin or stop."""
        for pipe in self._pipes[:count]:
            pipe.send(word)
        if word == "stop":
            for pipe in self._pipes[:count]:
                self.statuses.update(pipe.recv())
            for site in self._sites[:count]:
                asyncio.run(site.give_back())


async def prepare(site: Site) -> None:
    """Give the twin of a site a history."""
    await site.ask("POST", f"{V1}/recordings/history.mcap/replay", b"{}")
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        listed = (await site.ask("GET", f"{V1}/recordings")).document["recordings"]
        if all((one["replay"] or {}).get("state") != "playing" for one in listed):
            return
        await asyncio.sleep(0.1)
    raise TimeoutError(f"The history of {site.name} was not replayed in {PATIENCE_S:g} s.")


@contextlib.contextmanager
def running(home: Path, names: list[str]) -> Iterator[list[Site]]:
    """Run a server with a twin, its history and two recordings of each site."""
    tokens, day = TokenFile(home / "tokens.json"), datetime.timedelta(days=1)
    words = {name: tokens.add(name, "admin", [name], day) for name in names}
    settings = {
        "port": 0, "database": home / "twin.sqlite", "synchronous": "NORMAL",
        "diagnose": {"recordings": home / "recordings"},
        "access": {"tokens": tokens.path, "requests_per_s": 1000.0, "burst": 10_000},
        "gap": {"every_s": 0},
    }  # fmt: skip
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    server = context.Process(target=serve, args=(settings, theirs))
    server.start()
    try:
        port = int(ours.recv().rpartition(":")[2])
        sites = []
        for name in names:
            folder = home / "recordings" / name  # where those of its site are kept
            folder.mkdir(parents=True)
            recording(folder / "history.mcap", name, HISTORY)
            content = recording(folder / "long.mcap", name, LONG)
            sites.append(Site(name, words[name], port, content))
            asyncio.run(prepare(sites[-1]))
        yield sites
    finally:
        with contextlib.suppress(OSError):
            ours.send("stop")
        server.join(30.0)
        server.kill()


def timed(site: Site, work: str) -> float:
    """Time of one piece of work [s], which must succeed."""
    began_s = time.monotonic()
    answer = asyncio.run(asyncio.wait_for(_done(site, work), PATIENCE_S))
    assert answer.status < 300, answer
    took_s = time.monotonic() - began_s
    print(f"{work}: {took_s:.2f} s", file=sys.stderr, flush=True)
    return took_s


async def _done(site: Site, work: str) -> HttpAnswer:
    return await WORK[work](site)


def measured(
    modest: Site, crowd: Crowd, greedy: int, works: list[str], times: int
) -> dict[str, tuple[list[float], list[float]]]:
    """Time each work alone and beside greedy sites, by turns."""
    found: dict[str, tuple[list[float], list[float]]] = {work: ([], []) for work in works}
    for _ in range(times):
        for work in works:
            found[work][0].append(timed(modest, work))
        crowd.tell("go", greedy)
        time.sleep(5.0)
        for work in works:
            found[work][1].append(timed(modest, work))
        crowd.tell("stop", greedy)
    return found


def main(given: list[str]) -> int:
    """Print the ratios; 1 where one is too large."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--greedy", type=int, nargs="+", default=[1, 2, 4], choices=[1, 2, 4])
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--what", nargs="+", default=list(WORK), choices=list(WORK))
    asked = parser.parse_args(given)
    names = [MODEST, *GREEDY[: max(asked.greedy)]]
    fails = 0
    with tempfile.TemporaryDirectory() as home, running(Path(home), names) as sites:
        for work in asked.what:
            timed(sites[0], work)  # what is loaded and compiled once
        crowd = Crowd(sites[1:])
        for greedy in asked.greedy:
            told = measured(sites[0], crowd, greedy, asked.what, asked.times)
            for work, (alone, beside) in told.items():
                once, then = statistics.median(alone), statistics.median(beside)
                fails += then / once > greedy + SLACK
                print(
                    f"{then / once:6.2f}  {work} beside {greedy} greedy: {once:.2f} s alone "
                    f"({min(alone):.2f} to {max(alone):.2f}), {then:.2f} s beside them "
                    f"({min(beside):.2f} to {max(beside):.2f}); at most {greedy + SLACK}",
                    flush=True,
                )
        print(f"answers to the greedy, by status: {dict(sorted(crowd.statuses.items()))}")
    return int(fails > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
