"""Old versions brought up to date: v(n) to v(n+1), each step pure and independent of the rest.

A version that was once published never changes and never vanishes: recordings of it exist.
When a message changes shape, raise its `VERSION` and declare the step here:

    @MIGRATIONS.step("note", from_version=1)
    def _(payload):
        return {**payload, "new_field": None}

A step is given whatever claims to be of its version; what is wrong in it is left for the
message's own validation to refuse.
"""

from collections.abc import Callable, Mapping
from typing import Any

from .streams import MESSAGES

Payload = dict[str, Any]
Step = Callable[[Payload], Payload]


class UnknownVersionError(ValueError):
    """A message of a version nobody here can read."""


class Migrations:
    """The steps between versions.

    Parameters
    ----------
    current
        Name of each message and the version it is at now.

    Examples
    --------
    >>> registry = Migrations({"note": 2})
    >>> @registry.step("note", from_version=1)
    ... def _(payload):
    ...     return {"text": payload["body"]}
    >>> registry.migrate("note", {"version": 1, "body": "hello"})
    {'text': 'hello', 'version': 2}
    """

    def __init__(self, current: Mapping[str, int]) -> None:
        self._current = dict(current)
        self._steps: dict[tuple[str, int], Step] = {}

    def step(self, message: str, *, from_version: int) -> Callable[[Step], Step]:
        """Declare the function that takes `message` from one version to the next."""
        if not 1 <= from_version < self._current.get(message, 0) or (
            (message, from_version) in self._steps
        ):
            raise ValueError(
                f"A step of {message!r} from version {from_version} cannot be declared: it is "
                f"at version {self._current.get(message)}, with steps from "
                f"{sorted(v for m, v in self._steps if m == message)}. Raise VERSION first."
            )

        def declare(function: Step) -> Step:
            self._steps[message, from_version] = function
            return function

        return declare

    def versions(self, message: str) -> list[int]:
        """List the versions of `message` that can be read, the current one last."""
        newest = oldest = self._current[message]
        while (message, oldest - 1) in self._steps:
            oldest -= 1
        return list(range(oldest, newest + 1))

    def missing(self) -> list[tuple[str, int]]:
        """List the steps that ought to exist and do not, as (message, from version)."""
        return [
            (message, version)
            for message, newest in self._current.items()
            for version in range(1, newest)
            if (message, version) not in self._steps
        ]

    def migrate(self, message: str, payload: Mapping[str, Any]) -> Payload:
        """`payload` at the current version of `message`; what was given is left as it was.

        Raises
        ------
        UnknownVersionError
            Where no chain of steps leads from the payload's version to the current one.
        """
        version = payload.get("version")
        readable = self.versions(message)
        if type(version) is not int or version not in readable:
            raise UnknownVersionError(_what_to_do(message, version, readable))
        # Steps change nothing in what they are given; only the top level is changed here.
        migrated = dict(payload)
        while migrated["version"] != readable[-1]:
            before = int(migrated["version"])
            migrated = {**self._steps[message, before](migrated), "version": before + 1}
        return migrated


def _what_to_do(message: str, version: object, readable: list[int]) -> str:
    newer = type(version) is int and version > readable[-1]
    return (
        f"A {message} message of version {version!r:.40} was given. Allowed: "
        f"{', '.join(map(str, readable))}. "
        + (
            "It comes from newer software: update this process."
            if newer
            else 'Send "version" as one of these numbers.'
        )
    )


MIGRATIONS = Migrations({name: message.VERSION for name, message in MESSAGES.items()})


@MIGRATIONS.step("features", from_version=1)
def _features_1(payload: Payload) -> Payload:
    """Modes without shape, each of them structural and not followed."""
    modes = payload.get("modes")
    if isinstance(modes, list):
        new = {"identity": None, "kind": "structural", "shape": None}
        modes = [new | mode if isinstance(mode, dict) else mode for mode in modes]
        payload = {**payload, "modes": modes}
    return {"channels": [], **payload}


@MIGRATIONS.step("features", from_version=2)
def _features_2(payload: Payload) -> Payload:
    """Come from an agent that did not tell units."""
    return {"units": [], **payload}


@MIGRATIONS.step("health", from_version=1)
def _health_1(payload: Payload) -> Payload:
    """Come from an agent that sends everything at once."""
    return {"link": None} | payload


@MIGRATIONS.step("state", from_version=1)
def _state_1(payload: Payload) -> Payload:
    """Come from a twin of one mode, of whose elements nothing was asked."""
    none: Payload = {
        "elements": {}, "posterior_to_prior": {}, "suspects": [], "channels": [], "modes": [],
    }  # fmt: skip
    return none | payload


@MIGRATIONS.step("ack", from_version=1)
def _ack_1(payload: Payload) -> Payload:
    """Add no digest: version 1 has none."""
    return {"first": None, "digest": None} | payload


@MIGRATIONS.step("raw", from_version=1)
def _raw_1(payload: Payload) -> Payload:
    """Come from a sensor whose clock nobody measured."""
    return {"clock": None} | payload


@MIGRATIONS.step("ledger", from_version=1)
def _ledger_1(payload: Payload) -> Payload:
    """Come from a server that was told of no events of assets."""
    return payload


@MIGRATIONS.step("ledger", from_version=2)
def _ledger_2(payload: Payload) -> Payload:
    """Come from a server that chained no rows besides features and reports."""
    return {"tree": None} | payload


def migrate(message_name: str, payload_dict: Mapping[str, Any]) -> Payload:
    """`payload_dict` at the current version of `message_name`; see `Migrations.migrate`."""
    return MIGRATIONS.migrate(message_name, payload_dict)
