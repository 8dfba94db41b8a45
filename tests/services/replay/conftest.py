"""A recording as a house makes it, and a receiver that keeps an account as the twin does."""

import json
import threading
import time

import pytest

from slowtime_schemas.codec import decode_sample, encode
from slowtime_schemas.messages import Acknowledgement, Features, Health
from slowtime_schemas.streams import ACK, FEATURES, HEALTH, request_key
from slowtime_services.bus import Inbox, Sample
from slowtime_services.record import RecordingWriter


class Ledger:
    """A minimal twin: `per_s` features a second at most, gaps asked for, all confirmed.

    It misses the features of the sequences `deaf` once; its first `mute` words are lost.
    """

    def __init__(self, bus, *, per_s=1e9, inbox_items=10**6, deaf=(), mute=0):
        self.bus, self.pause_s, self.deaf, self.mute = bus, 1 / per_s, set(deaf), mute
        self.kept: dict[tuple[str, str, str], dict[int, bytes]] = {}
        self.asked, self.replayed, self.order = 0, [], []
        self.inbox: Inbox[Sample] = Inbox(max_items=inbox_items)
        self.handles = [
            bus.subscribe(stream.everywhere, self.inbox.put) for stream in (FEATURES, HEALTH)
        ]
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        while not self.stop.is_set():
            for sample in self.inbox.take(10, timeout_s=0.02):
                message = decode_sample(sample.key, sample.payload)
                self.replayed.append(sample.replayed)
                if isinstance(message, Health):
                    self.heal(message)
                elif isinstance(message, Features):
                    self.accept(message, sample.payload)
                    time.sleep(self.pause_s if self.pause_s > 1e-4 else 0)

    def accept(self, message, payload):
        if message.sequence in self.deaf:
            self.deaf.remove(message.sequence)
            return
        run = (message.site, message.asset, message.boot)
        kept = self.kept.setdefault(run, {})
        if kept.setdefault(message.sequence, payload) is payload:
            self.order.append((run, message.sequence))
        self.confirm(run)

    def heal(self, health):
        run = (health.site, health.asset, health.boot)
        kept, floor = self.kept.setdefault(run, {}), max(health.first_held, 0)
        missing = [s for s in range(floor, health.last_sequence + 1) if s not in kept]
        if self.inbox:
            return
        if not missing:
            self.confirm(run)
            return
        self.asked += 1
        parameters = {"boot": run[2], "first": str(missing[0]), "last": str(missing[-1])}
        for answer in self.bus.ask(request_key(*run[:2], "features"), parameters, timeout_s=60):
            message = decode_sample(answer.key, answer.payload)
            assert isinstance(message, Features)
            self.accept(message, answer.payload)

    def confirm(self, run):
        if self.mute > 0:
            self.mute -= 1
            return
        kept = self.kept[run]
        top = min(kept)
        while top + 1 in kept:
            top += 1
        ack = Acknowledgement(
            site=run[0], asset=run[1], boot=run[2], sequence=top, t_ns=time.time_ns()
        )
        self.bus.publish(ACK.key(*run[:2]), encode(ack), encoding=ACK.encoding)

    def account(self, site, asset):
        answers = self.bus.ask(request_key(site, asset, "account"))
        return [json.loads(answer.payload) for answer in answers]

    def close(self):
        self.stop.set()
        self.thread.join(60)
        for handle in self.handles:
            handle.close()


@pytest.fixture
def ledger():
    """Make ledgers, and close them."""
    made = []

    def make(bus, **settings):
        made.append(Ledger(bus, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def house(tmp_path, features_of):
    """A recording of two assets, one restarted, with health, and features out of order."""

    def make(count=300):
        path = tmp_path / "house.mcap"
        late = features_of(count, asset="beam", boot="b1")
        late[-5], late[-9] = late[-9], late[-5]
        runs = [
            late,
            features_of(count, asset="fan", boot="f1", first=40),
            features_of(count // 2, asset="beam", boot="b2"),
        ]
        with RecordingWriter(path) as writer:
            log_ns = 10**9
            for messages in runs:
                for message in messages:
                    log_ns += 10**7
                    where = (message.site, message.asset)
                    writer.write(FEATURES, *where, encode(message), log_ns)
                    if message.sequence % 50 == 49:
                        health = Health(
                            site=message.site,
                            asset=message.asset,
                            boot=message.boot,
                            sequence=message.sequence // 50,
                            t_ns=log_ns,
                            last_sequence=message.sequence,
                            first_held=messages[0].sequence,
                            uptime_s=1.0,
                        )
                        writer.write(HEALTH, *where, encode(health), log_ns)
        expected = {
            (m[0].site, m[0].asset, m[0].boot): {f.sequence: encode(f) for f in m} for m in runs
        }
        return path, expected

    return make
