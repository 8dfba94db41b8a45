"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .core import Pipeline
from .knowledge import Herald, TwinKnowledge
from .lookout import Lookout
from .news import Listener, News
from .ordering import Orders
from .recordings import Recordings
from .tracing import Tracing

__all__ = [
    "Herald",
    "Listener",
    "Lookout",
    "News",
    "Orders",
    "Pipeline",
    "Recordings",
    "Tracing",
    "TwinKnowledge",
]
