"""Traces lead from the edge to REST, and change nothing of what travels."""

import subprocess
import sys
import threading

import httpx
import pytest
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import SpanKind

from edge_agent.__main__ import run as run_edge
from edge_agent.settings import EdgeSettings
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus, Sample
from slowtime_services.tracing import (
    EDGE,
    TWIN,
    Made,
    NoTelemetryError,
    SpanTraces,
    provider_of,
    traces_of,
)
from twin_server.__main__ import run as run_twin
from twin_server.settings import TwinSettings

EPOCHS = 4
PARENT = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"


def edge_settings(folder):
    structure = {"epochs": EPOCHS, "seconds": 20.0, "rate_hz": 50.0, "seed": 3}
    return EdgeSettings(
        site="lab", asset="mast", boot="b1", connect=(), spool={"folder": folder / "spool"},
        publish={"linger_s": 5.0},
        input={"kind": "simulated", "every_s": 0.0, "structure": structure},
    )  # fmt: skip


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """Spans of an edge, a twin and two requests, and what was on the bus."""
    folder = tmp_path_factory.mktemp("traced")
    kept, bus = InMemorySpanExporter(), MemoryBus()
    provider = provider_of("test")
    provider.add_span_processor(SimpleSpanProcessor(kept))
    traces = SpanTraces(provider)
    heard: list[Sample] = []
    bus.subscribe(FEATURES.everywhere, heard.append)
    stop, ready, urls = threading.Event(), threading.Event(), []

    def told(url):
        urls.append(url)
        ready.set()

    settings = TwinSettings(database=folder / "twin.sqlite", port=0)
    more = {"bus": bus, "stop": stop, "ready": told, "traces": traces}
    thread = threading.Thread(target=run_twin, args=(settings,), kwargs=more)
    thread.start()
    try:
        assert ready.wait(60)
        edge_bus = MemoryBus(joins=bus)
        run_edge(edge_settings(folder), bus=edge_bus, stop=threading.Event(), traces=traces)
        url = f"{urls[0]}/api/v1/twins/lab.mast"
        headers = {"traceparent": PARENT}
        assert httpx.get(url, headers=headers, timeout=300).status_code == 200
        nobody = httpx.get(f"{urls[0]}/api/v1/twins/lab.nobody", timeout=300)
        assert nobody.status_code == 404
    finally:
        stop.set()
        thread.join(60)
    yield kept.get_finished_spans(), heard
    bus.close()


def by_sequence(spans, name):
    found = [span for span in spans if span.name == name]
    return {span.attributes["slowtime.sequence"]: span for span in found}


@pytest.mark.long
def test_each_epoch_is_one_trace_from_the_edge_into_the_twin(traced):
    spans, _ = traced
    at_edge, in_twin = by_sequence(spans, EDGE), by_sequence(spans, TWIN)
    assert at_edge.keys() == in_twin.keys() == set(range(EPOCHS))
    assert len({span.context.trace_id for span in at_edge.values()}) == EPOCHS
    for sequence, span in at_edge.items():
        follower = in_twin[sequence]
        assert follower.context.trace_id == span.context.trace_id
        assert follower.parent.span_id == span.context.span_id
        assert span.parent is None
        assert (span.kind, follower.kind) == (SpanKind.PRODUCER, SpanKind.CONSUMER)
        assert span.start_time <= span.end_time
        assert span.start_time <= follower.end_time
        assert span.attributes["slowtime.twin"] == "lab.mast"


@pytest.mark.long
def test_a_request_is_of_the_callers_trace_and_linked_to_the_features_it_rests_on(traced):
    spans, _ = traced
    asked, refused = (s for s in spans if s.name == "GET /api/v1/twins/{twin_id}")
    assert f"{asked.context.trace_id:032x}" == PARENT.split("-")[1]
    assert f"{asked.parent.span_id:016x}" == PARENT.split("-")[2]
    assert asked.attributes["http.response.status_code"] == 200
    (link,) = asked.links
    newest = by_sequence(spans, EDGE)[EPOCHS - 1]
    assert link.context.span_id == newest.context.span_id
    assert refused.attributes["http.response.status_code"] == 404
    assert refused.links == ()


@pytest.mark.long
def test_what_travels_is_the_same_with_traces_as_without(traced, tmp_path):
    _, heard = traced
    bus = MemoryBus()
    plain: list[Sample] = []
    bus.subscribe(FEATURES.everywhere, plain.append)
    untraced = edge_settings(tmp_path).model_copy(
        update={"publish": edge_settings(tmp_path).publish.model_copy(update={"linger_s": 0.0})}
    )
    run_edge(untraced, bus=bus, stop=threading.Event())
    assert [sample.payload for sample in plain] == [sample.payload for sample in heard]
    bus.close()


def test_names_make_identifiers_of_their_own():
    made = [Made(t, b, s) for t in ("a.b", "a.c") for b in ("1", "2") for s in range(50)]
    assert len({one.trace_id for one in made}) == len({one.span_id for one in made}) == 200
    assert all(0 < one.trace_id < 2**128 and 0 < one.span_id < 2**64 for one in made)
    assert made[0].trace_id == Made("a.b", "1", 0).trace_id


def test_without_the_package_it_is_said_what_to_install(monkeypatch):
    assert traces_of("edge") is None
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:4318")
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace.export", None)
    with pytest.raises(NoTelemetryError, match=r"slowtime\[telemetry\]"):
        traces_of("edge")


@pytest.mark.slow
def test_nothing_of_opentelemetrys_sdk_is_loaded_unless_asked_for():
    code = (
        "import sys, edge_agent.__main__, twin_server.__main__;"
        "sys.exit(any(name.startswith('opentelemetry.sdk') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
