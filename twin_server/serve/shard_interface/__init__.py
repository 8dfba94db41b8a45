"""Requests of the front in; what one shard knows, as the front composes it with others, out."""

from .key import HEADER, ShardDoor
from .messages import (
    PREFIX,
    AssetsAsked,
    CompositeOrder,
    Deletion,
    FailuresAsked,
    TwinsAsked,
)
from .routes import create_shard_interface

__all__ = [
    "HEADER",
    "PREFIX",
    "AssetsAsked",
    "CompositeOrder",
    "Deletion",
    "FailuresAsked",
    "ShardDoor",
    "TwinsAsked",
    "create_shard_interface",
]
