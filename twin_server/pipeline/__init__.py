"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .alarming import Alarms, Bell
from .asset_events import AssetEvents, orders_in
from .compositing import Compositions
from .core import Pipeline
from .knowledge import Herald, TwinKnowledge
from .lookout import Lookout
from .news import Listener, News
from .ordering import Orders
from .recordings import Recordings
from .tracing import Tracing
from .workers import Here, Processes, Workers

__all__ = [
    "Alarms",
    "AssetEvents",
    "Bell",
    "Compositions",
    "Herald",
    "Here",
    "Listener",
    "Lookout",
    "News",
    "Orders",
    "Pipeline",
    "Processes",
    "Recordings",
    "Tracing",
    "TwinKnowledge",
    "Workers",
    "orders_in",
]
