"""Reports a trace span for each features message, from its arrival until it is durable."""

from slowtime_services.clock import Clock
from slowtime_services.tracing import Made, SpanTraces

from .ingestion.pipeline import Pipeline
from .ingestion.updates import TwinUpdate


class FeatureTraces:
    """Reports trace spans of features that have become durable."""

    def __init__(self, pipeline: Pipeline, traces: SpanTraces, clock: Clock) -> None:
        self._pipeline, self._traces, self._clock = pipeline, traces, clock

    def tell(self, news: TwinUpdate) -> None:
        """Report a span for each new state."""
        now_ns = self._clock.now_ns()
        heard_ns = self._pipeline.heard_ns(news.twin_id) or now_ns
        sequences = news.states["sequence"].tolist()
        for (_, boot, _), sequence in zip(news.runs, sequences, strict=True):
            made = Made(news.twin_id, boot, sequence)
            self._traces.in_twin(made, min(heard_ns, now_ns), now_ns)

    def reset(self, twin_id: str) -> None:
        """Do nothing: features that are estimated again have spans already."""
