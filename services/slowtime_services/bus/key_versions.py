"""A bus on which agents with keys of the former version are heard and answered too.

Servers and recorders are brought up to date before the edges of a site are. They speak of keys
of the present version alone; this bus listens on those of the former version as well, and
turns a message, a query or a token of the former version into one of the present. What is for
one asset goes out on the keys that its agent listens to.
"""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping

from slowtime_schemas.streams import (
    ABOUT,
    ACK,
    FATIGUE,
    FEATURES,
    HEALTH,
    LONGEST_KEY,
    RAW,
    VIRTUAL,
    address_of,
    current_key,
    former_key,
)

from .forwarding import ForwardingBus
from .keys import matches
from .protocol import MOST_ANSWER_BYTES, Answers, Bus, Handle, Query, Sample

Handler = Callable[[Query], Iterable[tuple[str, bytes]]]

OF_EDGES = frozenset(s.name for s in (FEATURES, HEALTH, ABOUT, RAW, FATIGUE, VIRTUAL))
"""Streams that edge agents send, which show the version of the keys they know."""

MOST_FORMER = 100_000
"""Agents with keys of the former version that are known [1]; of others, both versions are
tried. More than ten times the assets that a server is measured with."""


class _Both:
    """What was declared in two versions, as one."""

    def __init__(self, handles: Iterable[Handle]) -> None:
        self._handles = tuple(handles)

    def close(self) -> None:
        """Undeclare it in both."""
        for handle in self._handles:
            handle.close()


class TwoVersionBus(ForwardingBus):
    """A bus that hears keys of both versions, and shows its user those of the present one.

    Parameters
    ----------
    bus
        Carries the messages; is closed with this one.
    """

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        self._lock = threading.Lock()
        self._former: set[tuple[str, str]] = set()

    @property
    def former(self) -> frozenset[tuple[str, str]]:
        """Site and asset of the agents that were last heard on keys of the former version."""
        return frozenset(self._former)

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send; an acknowledgement goes to the key that the asset's agent listens to."""
        if self._former and f"/{ACK.name}/" in key:
            key = self._known_to_agent(key)
        self._bus.publish(key, payload, encoding=encoding, replayed=replayed)

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback`, from threads of the bus, for each message of either version."""
        former = former_key(key_expression)
        if former is None:
            return self._bus.subscribe(key_expression, callback)

        def hear(sample: Sample) -> None:
            if self._former:
                self._note(sample.key, former=False)
            callback(sample)

        def hear_former(sample: Sample) -> None:
            key = current_key(sample.key)
            if len(key) <= LONGEST_KEY and matches(
                key_expression, key
            ):  # the former one may be wider: it has no partition
                self._note(key, former=True)
                callback(sample._replace(key=key))

        return _Both(
            (
                self._bus.subscribe(key_expression, hear),
                self._bus.subscribe(former, hear_former),
            )
        )

    def answer(self, key: str, handler: Handler) -> Handle:
        """Answer queries on `key` and on its former version."""
        former = former_key(key)
        if former is None:
            return self._bus.answer(key, handler)

        def answer_former(query: Query) -> Iterator[tuple[str, bytes]]:
            for reply, payload in handler(query._replace(key=current_key(query.key))):
                yield former_key(reply) or reply, payload

        return _Both((self._bus.answer(key, handler), self._bus.answer(former, answer_former)))

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
        max_bytes: int = MOST_ANSWER_BYTES,
    ) -> Answers:
        """Return all answers; of one asset, from its agent's version, else from the other."""
        former, own = former_key(key_expression), address_of(key_expression)
        versions = [key_expression] if former is None else [key_expression, former]
        if own in self._former:
            versions.reverse()
        answers = Answers()
        for version in versions:
            found = self._bus.ask(version, parameters, timeout_s=timeout_s, max_bytes=max_bytes)
            both = [one._replace(key=current_key(one.key)) for one in found]
            answers = Answers([*answers, *both], (*answers.errors, *found.errors))
            if answers.errors or (answers and own is not None and "*" not in own):
                break
        return answers

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call `callback(key, alive)`; who is alive under both versions is alive once."""
        former = former_key(key_expression)
        if former is None:
            return self._bus.watch(key_expression, callback)
        seen: dict[str, set[str]] = {}
        changing = threading.Lock()

        def change(given: str, alive: bool) -> None:
            key = current_key(given)
            if len(key) > LONGEST_KEY or not matches(key_expression, key):
                return
            with changing:  # while told, so that changes are told in their order
                versions = seen.setdefault(key, set())
                before = bool(versions)
                (versions.add if alive else versions.discard)(given)
                if alive:
                    self._mark(key, former=given != key)
                if not versions:
                    del seen[key]
                if bool(versions) != before:
                    callback(key, alive)

        return _Both((self._bus.watch(key_expression, change), self._bus.watch(former, change)))

    def _known_to_agent(self, key: str) -> str:
        return former_key(key) or key if address_of(key) in self._former else key

    def _note(self, key: str, *, former: bool) -> None:
        """Note the version of an agent by a message that only it sends."""
        if key.split("/")[3:4] and key.split("/")[3] in OF_EDGES:
            self._mark(key, former=former)

    def _mark(self, key: str, *, former: bool) -> None:
        address = address_of(key)
        if address is None or (address in self._former) == former:
            return
        with self._lock:
            if not former:
                self._former.discard(address)
            elif len(self._former) < MOST_FORMER:
                self._former.add(address)
