"""Bodies of the requests of a front to its shards; both are of one version."""

from typing import Any

from pydantic import BaseModel

from twin_server.composites.composite import Failing

PREFIX = "/shard/"
"""Path below which a shard answers the front alone."""


class TwinsAsked(BaseModel):
    """Twins of one shard."""

    twins: list[str]


class FailureAsked(BaseModel):
    """What is asked about the failure of one twin."""

    horizon: float | None
    failing: Failing | None


class FailuresAsked(BaseModel):
    """What is asked about the failure of twins of one shard."""

    asked: dict[str, FailureAsked]


class AssetsAsked(BaseModel):
    """Twins for a graph: one, those of a site, or all."""

    twin: str | None = None
    site: str | None = None


class CompositeOrder(BaseModel):
    """A composite to be registered, as `Composite.to_json` writes it.

    Of its members, and of its own id, `twins` names those that are twins of any shard.
    """

    id: str
    registration: str
    principal: dict[str, Any]
    twins: list[str]


class Deletion(BaseModel):
    """A composite to be deleted."""

    id: str
    principal: dict[str, Any]


class RevisionsAsked(BaseModel):
    """Registrations of a composite, and who wants to see them."""

    id: str
    principal: dict[str, Any]


class EventsAsked(BaseModel):
    """Events of a composite."""

    id: str
    after: int
    limit: int
    newest: bool


class DeletedTwin(BaseModel):
    """A twin of any shard that was deleted."""

    id: str
