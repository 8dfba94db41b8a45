"""The order of the stages, and the one thread that keeps it: samples in, history out."""

from .core import Listener, News, Pipeline

__all__ = ["Listener", "News", "Pipeline"]
