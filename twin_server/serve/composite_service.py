"""The protocol by which the serve stage reads and changes composites."""

from collections.abc import Mapping
from typing import Any, Protocol

from twin_server.composites.composite import Composite
from twin_server.identity.principals import Principal

from .http.problems import ProblemError


class CompositeService(Protocol):
    """Service of composites; refusals are raised as `ProblemError`.

    It is asked with a principal, and tells of composites that this one may see.
    """

    def all(self, principal: Principal) -> Mapping[str, Composite]:
        """Composites of which every part may be seen, in the order of their registration."""
        ...

    def exists(self, composite_id: str) -> bool:
        """Whether there is a composite of this id, for who may see the site of the id."""
        ...

    def register(self, composite_id: str, wanted: Composite, principal: Principal) -> bool:
        """Register a composite; True where it is new."""
        ...

    def delete(self, composite_id: str, principal: Principal) -> None:
        """Delete a composite that is no member of another that may be seen."""
        ...

    def revisions(self, composite_id: str, principal: Principal) -> list[dict[str, Any]]:
        """Registrations of a composite of which every part may be seen, in order."""
        ...

    def events(
        self, composite_id: str, *, after: int, limit: int, newest: bool
    ) -> list[tuple[int, str]]:
        """Find number and body of events of a composite in order."""
        ...

    def note_deleted_twin(self, twin_id: str) -> None:
        """Tell the sites of the composites that held a twin that it was deleted."""
        ...


def out_of_reach(composite_id: str) -> ProblemError:
    """Make the refusal of a composite that holds what the caller may not see."""
    return ProblemError(
        403,
        "site-out-of-reach",
        f"{composite_id} has members of sites that the token does not reach. Ask an admin for "
        "a token that reaches the sites of all members.",
    )
