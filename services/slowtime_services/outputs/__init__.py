"""Sends features, states and events of a twin server to brokers, databases and OPC UA clients.

A process of its own reads them from the server's REST interface, so that no receiver can stop
or slow the server. Each output keeps its position in the history; the history is the queue.
"""

from .batch import Batch, NotSentError, Output
from .positions import Positions
from .process import run
from .settings import OutputsSettings

__all__ = ["Batch", "NotSentError", "Output", "OutputsSettings", "Positions", "run"]
