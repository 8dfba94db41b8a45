"""Settings in; shards that each run a whole twin server of their assets, behind one front."""

from .run import UnknownEngineError, run

__all__ = ["UnknownEngineError", "run"]
