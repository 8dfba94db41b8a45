"""Third stage of the edge: conditioned blocks in, features out, one message for each window."""

from .stage import Extract as Extract
from .stage import ExtractState as ExtractState
