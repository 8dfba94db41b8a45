"""Settings in; shards that each run a whole twin server of their assets, behind one front."""

from .ray_actors import EngineError
from .run import begun, run

__all__ = ["EngineError", "begun", "run"]
