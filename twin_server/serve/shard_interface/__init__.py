"""Requests of the front in; what one shard knows, as the front composes it with others, out."""

from .key import HEADER, ShardDoor
from .messages import (
    PREFIX,
    AssetsAsked,
    CompositeOrder,
    DeletedTwin,
    Deletion,
    EventsAsked,
    FailuresAsked,
    RevisionsAsked,
    TwinsAsked,
)
from .routes import create_shard_interface

__all__ = [
    "HEADER",
    "PREFIX",
    "AssetsAsked",
    "CompositeOrder",
    "DeletedTwin",
    "Deletion",
    "EventsAsked",
    "FailuresAsked",
    "RevisionsAsked",
    "ShardDoor",
    "TwinsAsked",
    "create_shard_interface",
]
