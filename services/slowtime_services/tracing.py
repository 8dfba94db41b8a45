"""Traces of OpenTelemetry, where they are asked for: from the edge to REST, nothing on the bus.

The trace of a features message follows from its own name, twin, boot and sequence, so that edge
and twin agree on it without telling each other: payloads, attachments and recordings are the
same with tracing as without, and features that are asked for again, or replayed, are of the
trace that they always were.
"""

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import Span, SpanContext

ASKED_BY = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
"""Variables of OpenTelemetry itself that turn traces on; its others are heeded, too."""

EDGE, TWIN = "features at the edge", "features in the twin"


class NoTelemetryError(ValueError):
    """Traces were requested, and their library is not installed."""


class Made(NamedTuple):
    """Identity of a features message."""

    twin_id: str
    boot: str
    sequence: int

    @property
    def trace_id(self) -> int:
        """128 bits, never 0."""
        return self._hash("trace") >> 128 or 1

    @property
    def span_id(self) -> int:
        """64 bits of the edge's span, which is the first of the trace; never 0."""
        return self._hash("edge") >> 192 or 1

    def _hash(self, what: str) -> int:
        text = f"{what} {self.twin_id} {self.boot} {self.sequence}"
        return int.from_bytes(hashlib.sha256(text.encode()).digest())


class SpanTraces:
    """Spans of one process.

    Parameters
    ----------
    provider
        Made by `provider_of`, or one of a test's.
    """

    def __init__(self, provider: "TracerProvider") -> None:
        self._provider = provider
        self._tracer = provider.get_tracer("slowtime")
        self._latest: dict[str, Made] = {}

    def at_edge(self, made: Made, start_ns: int, end_ns: int) -> None:
        """Report that features were stored and sent."""
        from opentelemetry import trace
        from opentelemetry.context import Context

        token = _AGREED.set((made.trace_id, made.span_id))
        try:
            span = self._tracer.start_span(
                EDGE,
                Context(),
                kind=trace.SpanKind.PRODUCER,
                attributes=_named(made),
                start_time=start_ns,
            )
        finally:
            _AGREED.reset(token)
        span.end(end_ns)

    def in_twin(self, made: Made, start_ns: int, end_ns: int) -> None:
        """Report that features were estimated and are durable."""
        from opentelemetry import trace

        span = self._tracer.start_span(
            TWIN,
            trace.set_span_in_context(trace.NonRecordingSpan(_context(made))),
            kind=trace.SpanKind.CONSUMER,
            attributes=_named(made),
            start_time=start_ns,
        )
        span.end(end_ns)
        self._latest[made.twin_id] = made

    @contextmanager
    def answering(
        self, method: str, route: str, twin_id: str | None, headers: Mapping[str, str]
    ) -> "Iterator[Span]":
        """Report a request; about a twin, it is linked to the features that the answer uses."""
        from opentelemetry import trace
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        made = None if twin_id is None else self._latest.get(twin_id)
        with self._tracer.start_as_current_span(
            f"{method} {route}",
            TraceContextTextMapPropagator().extract(dict(headers)),
            kind=trace.SpanKind.SERVER,
            attributes={"http.request.method": method, "http.route": route}
            | ({} if twin_id is None else {"slowtime.twin": twin_id}),
            links=[] if made is None else [trace.Link(_context(made), _named(made))],
        ) as span:
            yield span

    def close(self) -> None:
        """Send the spans that wait."""
        self._provider.shutdown()


def asked_for(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether the environment asks for traces."""
    return any(environment.get(name) for name in ASKED_BY)


def traces_of(service: str) -> SpanTraces | None:
    """Make the traces of a process, over OTLP; None where the environment does not ask.

    Raises
    ------
    NoTelemetryError
        Where it asks and they cannot be made.
    """
    if not asked_for():
        return None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        raise NoTelemetryError(
            f"{' or '.join(ASKED_BY)} asks for traces, and OpenTelemetry is not installed. "
            "Install it with `pip install 'slowtime[telemetry]'`, or unset the variable."
        ) from error
    provider = provider_of(service)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return SpanTraces(provider)


def provider_of(service: str) -> "TracerProvider":
    """Make a provider whose first spans have the given identifiers."""
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.id_generator import RandomIdGenerator

    class Agreed(RandomIdGenerator):
        def generate_trace_id(self) -> int:
            agreed = _AGREED.get()
            return super().generate_trace_id() if agreed is None else agreed[0]

        def generate_span_id(self) -> int:
            agreed = _AGREED.get()
            return super().generate_span_id() if agreed is None else agreed[1]

    resource = Resource.create({"service.name": service, "service.namespace": "slowtime"})
    return TracerProvider(resource=resource, id_generator=Agreed(), shutdown_on_exit=False)


_AGREED: ContextVar[tuple[int, int] | None] = ContextVar("agreed", default=None)


def _context(made: Made) -> "SpanContext":
    from opentelemetry import trace

    return trace.SpanContext(
        made.trace_id, made.span_id, is_remote=True, trace_flags=trace.TraceFlags(1)
    )


def _named(made: Made) -> dict[str, str | int]:
    return {
        "slowtime.twin": made.twin_id,
        "slowtime.boot": made.boot,
        "slowtime.sequence": made.sequence,
    }
