"""A URL says where, what and how much; what it cannot say is refused with the cure."""

import asyncio
import json
import socket
import sys
import threading
import time

import numpy as np
import pytest
from pydantic import ValidationError

from edge_agent.acquire import SCHEMES, check_input, open_source
from edge_agent.acquire.live import registry
from edge_agent.inputs import LiveInput
from edge_agent.layouts import CsvLayout, JsonLayout, read_layout
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import SensorSamples
from slowtime_schemas.streams import SAMPLES
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import SystemClock

from .listening import opened

LINES = "layout=csv&counter=0&channels=x,y&rate_hz=200"


def listen(live, samples, *, bus=None, patience_s=60.0):
    """Blocks of a source until so many samples have come, and what it counted."""
    stop = threading.Event()
    source = opened(live, stop, bus)
    timer = threading.Timer(patience_s, stop.set)
    timer.start()
    blocks, taken = [], 0
    for block in source:
        blocks.append(block)
        taken += len(block.samples)
        if taken >= samples:
            stop.set()
    timer.cancel()
    return blocks, source.counts()


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_url_is_taken_apart_into_source_layout_and_limits():
    live = LiveInput.of(
        "mqtt://pi@10.0.0.2:1884/bridge/+/accel?channels=x,y&counter=n&counter_bits=16"
        "&stamp=t.us&scale=0.5&unit=g&rate_hz=100&qos=0&silent_after_s=3"
    )
    assert live.source == "mqtt://pi@10.0.0.2:1884/bridge/+/accel?qos=0"
    assert (live.rate_hz, live.silent_after_s) == (100.0, 3.0)
    assert isinstance(live.layout, JsonLayout)
    assert live.layout.counter is not None
    assert live.layout.counter.bits == 16
    assert live.layout.stamp is not None
    assert live.layout.stamp.at == "t.us"
    assert [c.scale for c in live.layout.channels] == [0.5, 0.5]
    check_input(live)


@pytest.mark.parametrize(
    ("url", "says"),
    [
        (
            "carrier-pigeon://coop",
            r"has the scheme 'carrier-pigeon'. Allowed: mqtt, mqtts, tcp",
        ),
        ("mqtt://10.0.0.2/t?qoss=1", r"has no parameter \['qoss'\]. Allowed: qos, client_id"),
        ("just words", r"names no scheme. Give a URL such as"),
        ("mqtt://pi:secret@10.0.0.2/t", r"holds a password.*give password_file"),
        (
            "udp://127.0.0.1:5005?layout=xml",
            r"layout='xml' is not a valid layout. Allowed: json, csv",
        ),
        ("udp://127.0.0.1:5005?layout=none.toml", r"none.toml cannot be read"),
    ],
)
def test_what_a_url_cannot_be_is_refused_with_the_cure(url, says):
    with pytest.raises((ValueError, ValidationError), match=says):
        check_input(LiveInput.of(url))


def test_a_library_that_is_missing_is_named_with_its_install_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    monkeypatch.delitem(sys.modules, f"{registry.__package__}.transports.mqtt", raising=False)
    live = LiveInput.of("mqtt://127.0.0.1/t?rate_hz=1")
    with pytest.raises(ValueError, match=r"needs paho-mqtt.*pip install 'slowtime\[mqtt\]'"):
        check_input(live)


def test_every_scheme_has_its_module_and_its_extra():
    project = (registry.__file__,)
    assert project
    for scheme in SCHEMES.values():
        assert bool(scheme.library) == bool(scheme.extra)
        assert callable(registry.importing(scheme))


def test_rate_and_layout_that_nobody_says_are_asked_for():
    stop = threading.Event()
    for url, says in (
        ("udp://127.0.0.1:1", "does not say what its messages hold"),
        ("udp://127.0.0.1:1?layout=csv", "does not say its nominal rate"),
    ):
        with pytest.raises(ValueError, match=says):
            open_source(LiveInput.of(url), SystemClock(), stop)


def test_a_layout_file_says_where_it_is_wrong(tmp_path):
    path = tmp_path / "board.toml"
    path.write_text('kind = "csv"\n[[channels]]\nname = "x"\nscael = 2\n')
    with pytest.raises(ValueError, match=r"board.toml: .*scael.*Extra inputs"):
        read_layout(path)
    path.write_text('kind = "csv"\n[[channels]]\nname = "x"\nscale = 2\n')
    assert isinstance(read_layout(path), CsvLayout)


def test_datagrams_become_blocks_and_a_full_queue_drops_what_it_counts():
    port = free_port(socket.SOCK_DGRAM)
    lines = LINES.replace("rate_hz=200", "rate_hz=1000")
    live = LiveInput.of(f"udp://127.0.0.1:{port}?{lines}", block_s=0.1)
    stop = threading.Event()

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            n = 0
            while not stop.is_set():
                sender.sendto(b"%d,%d,1\n" % (n, n), ("127.0.0.1", port))
                n += 2 if n == 100 else 1
                time.sleep(0.001)

    thread = threading.Thread(target=send)
    thread.start()
    blocks, counts = listen(live, 300)
    stop.set()
    thread.join()
    for block in blocks:
        np.testing.assert_array_equal(
            np.diff(block.samples[:, 0]), np.ones(len(block.samples) - 1)
        )
    assert counts["samples_lost"] <= 1
    assert blocks[0].clock is not None


def test_a_device_that_goes_away_is_connected_to_again():
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]

    def serve():
        for boot in range(2):
            connection, _ = listener.accept()
            for n in range(150):
                connection.sendall(b"%d,%d,0\n" % (150 * boot + n, n))
                time.sleep(0.002)
            connection.close()

    thread = threading.Thread(target=serve)
    thread.start()
    blocks, counts = listen(LiveInput.of(f"tcp://127.0.0.1:{port}?{LINES}", block_s=0.1), 300)
    thread.join()
    listener.close()
    assert sum(len(block.samples) for block in blocks) == 300
    assert counts["sensor_reconnects"] >= 1
    assert counts["samples_lost"] == 0


def test_samples_on_the_bus_bring_their_layout_along():
    bus, stop = MemoryBus(), threading.Event()
    key = SAMPLES.key("lab", "beam")

    def publish():
        n = 0
        while not stop.is_set():
            message = SensorSamples(
                site="lab", asset="beam", boot="a", sequence=n, t_ns=0, rate_hz=500.0,
                first_index=10 * n, channels=("z",), units=("g",),
                samples=tuple((float(10 * n + i),) for i in range(10)),
            )  # fmt: skip
            bus.publish(key, encode(message), encoding=SAMPLES.encoding)
            bus.publish(key, b"not a message", encoding=SAMPLES.encoding)
            n += 1
            time.sleep(0.02)

    thread = threading.Thread(target=publish)
    thread.start()
    blocks, counts = listen(LiveInput(source="zenoh:"), 100, bus=bus)
    stop.set()
    thread.join()
    bus.close()
    assert (blocks[0].channels, blocks[0].units, blocks[0].rate_hz) == (
        ("z",),
        ("m/s^2",),
        500.0,
    )
    assert counts["garbage_bytes"] > 0
    assert counts["samples_lost"] == 0


def test_what_waits_is_bounded_and_what_is_dropped_leaves_a_gap():
    port = free_port(socket.SOCK_DGRAM)
    lines = LINES.replace("rate_hz=200", "rate_hz=2000")
    live = LiveInput.of(f"udp://127.0.0.1:{port}?{lines}", block_s=0.05, queue_samples=100)
    stop, began = threading.Event(), threading.Event()
    source = opened(live, stop)

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            n = 0
            while not stop.is_set():
                sender.sendto(b"%d,%d,1\n" % (n, n), ("127.0.0.1", port))
                n += 1
                if n == 20:
                    began.wait(30)
                time.sleep(0.0005)

    thread = threading.Thread(target=send)
    thread.start()
    blocks = []
    for block in source:
        blocks.append(block)
        if not began.is_set():
            began.set()
            while source.counts()["samples_dropped"] < 500:
                time.sleep(0.01)
        if block.next_index > 520 + 50:
            stop.set()
    thread.join()
    counts = source.counts()
    assert counts["samples_dropped"] >= 500
    assert counts["samples_lost"] == 0
    for block in blocks:
        np.testing.assert_array_equal(
            block.samples[:, 0], np.arange(block.first_index, block.next_index)
        )


def test_variables_of_an_opc_ua_server_become_channels():
    pytest.importorskip("asyncua")
    from asyncua.server.server import Server

    port, ready, stop = free_port(), threading.Event(), threading.Event()

    async def serve():
        server = Server()
        await server.init()
        server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/")
        space = await server.register_namespace("urn:test")
        nodes = [
            await server.nodes.objects.add_variable(f"ns={space};s={n}", n, 0.0) for n in "ab"
        ]
        async with server:
            ready.set()
            n = 0
            while not stop.is_set():
                n += 1
                await nodes[0].write_value(float(n))
                await nodes[1].write_value(float(-n))
                await asyncio.sleep(0.05)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(60)
    live = LiveInput.of(
        f"opcua://127.0.0.1:{port}/?channels=ns=2;s=a,ns=2;s=b&rate_hz=20&interval_ms=50",
        block_s=0.5,
    )
    try:
        blocks, _ = listen(live, 60)
    finally:
        stop.set()
        thread.join()
    assert blocks[0].channels == ("ns=2;s=a", "ns=2;s=b")
    rows = np.concatenate([block.samples for block in blocks])
    both = rows[np.isfinite(rows).all(axis=1)]
    assert len(both) > 20
    assert np.abs(both.sum(axis=1)).max() <= 1.0


def test_what_about_says_of_a_live_input_names_no_address():
    from edge_agent.__main__ import _about
    from edge_agent.settings import EdgeSettings

    live = LiveInput.of("mqtt://pi@10.9.8.7/secret/topic?channels=x&rate_hz=5")
    text = json.dumps(_about(EdgeSettings(input=live)))
    assert "10.9.8.7" not in text
    assert "secret" not in text


def test_boards_of_one_structure_are_kept_apart_as_assets_of_their_own(tmp_path, caplog):
    from edge_agent.__main__ import run
    from edge_agent.settings import EdgeSettings
    from slowtime_schemas.streams import HEALTH

    ports = [free_port(socket.SOCK_DGRAM) for _ in range(2)]
    boards = [
        {"name": name, **LiveInput.of(f"udp://127.0.0.1:{port}?{LINES}").model_dump()}
        for name, port in zip("ab", ports, strict=True)
    ]
    settings = EdgeSettings(
        site="lab", asset="beam", input={"kind": "boards", "boards": boards},
        spool={"folder": tmp_path}, publish={"health_every_s": 0.1, "linger_s": 0},
    )  # fmt: skip
    bus, stop, heard = MemoryBus(), threading.Event(), {}
    bus.subscribe(
        HEALTH.everywhere,
        lambda sample: heard.update({sample.key: json.loads(sample.payload)["counters"]}),
    )
    thread = threading.Thread(target=lambda: run(settings, bus=bus, stop=stop))
    thread.start()
    keys = [HEALTH.key("lab", f"beam-{name}") for name in "ab"]
    deadline, n = time.monotonic() + 60, 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while time.monotonic() < deadline and not all(
            heard.get(key, {}).get("samples_received", 0) > 50 for key in keys
        ):
            for port in ports:
                sender.sendto(b"%d,%d,1\n" % (n, n), ("127.0.0.1", port))
            n += 1
            time.sleep(0.005)
    stop.set()
    thread.join()
    bus.close()
    assert all(heard[key]["samples_received"] > 50 for key in keys)
    assert "2 boards are kept apart, as beam-a, beam-b" in caplog.text
