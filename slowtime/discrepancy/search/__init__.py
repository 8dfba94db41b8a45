"""Search for the effects that a model lacks, one after the other."""

from .loop import search
from .settings import DEFAULT_OPTIONS, SearchOptions, SearchSettings

__all__ = ["DEFAULT_OPTIONS", "SearchOptions", "SearchSettings", "search"]
