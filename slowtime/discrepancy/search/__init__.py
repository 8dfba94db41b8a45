"""Search for the effects that a model lacks, one after the other."""

from .flow import search
from .settings import SearchSettings

__all__ = ["SearchSettings", "search"]
