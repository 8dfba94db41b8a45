"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .core import Pipeline
from .knowledge import Herald, TwinKnowledge
from .news import Listener, News
from .ordering import Orders

__all__ = ["Herald", "Listener", "News", "Orders", "Pipeline", "TwinKnowledge"]
