"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .core import Listener, News, Pipeline
from .knowledge import Herald, TwinKnowledge

__all__ = ["Herald", "Listener", "News", "Pipeline", "TwinKnowledge"]
