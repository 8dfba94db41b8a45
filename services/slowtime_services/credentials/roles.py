"""Rights of each kind of process on the bus, by streams of the registry.

An edge writes its own asset's keys and hears its own requests and acknowledgements; that is
all. The server reads what edges write and writes what twins say. An observer (recorder,
status) reads everything and writes nothing. A player puts recordings back onto the bus, and so
may write what any edge of the site may.
"""

import dataclasses
import hashlib
from collections.abc import Mapping

from slowtime_schemas.streams import (
    ABOUT,
    ACK,
    EVENT,
    FATIGUE,
    FEATURES,
    HEALTH,
    RAW,
    REGISTRATION,
    REQUESTS,
    SAMPLES,
    STATE,
    STREAMS,
    VIRTUAL,
    alive_key,
    any_key,
    former_key,
    request_key,
    server_key,
)

OF_EDGES = (FEATURES, HEALTH, ABOUT, RAW, FATIGUE, VIRTUAL)
OF_TWINS = (ACK, STATE, EVENT, REGISTRATION)
ASKED_OF_EDGES = ("account", "features", "raw", "about", "fatigue", "flush")
ASKED_OF_TWINS = ("registration",)
LONGEST_NAME = 44
"""So that a common name keeps within the 64 characters of X.509."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """Rights of a credential's holders; each field is a tuple of key expressions.

    Parameters
    ----------
    writes, hears
        Keys of messages sent, and of messages received.
    subscribes
        Key expressions of subscriptions; each as wide as the process declares it.
    answers, replies
        Keys of questions answered, and of the messages that answer them.
    asks
        Keys of questions put to others; their answers are among `hears`.
    announces, watches
        Keys of liveliness.
    """

    writes: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    replies: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    announces: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()


def edge(site: str, asset: str) -> Role:
    """Rights of the edge agent of one asset."""
    written = tuple(stream.key(site, asset) for stream in OF_EDGES)
    return Role(
        # Samples: a program beside the sensor publishes them with the edge's own credential.
        writes=(*written, SAMPLES.key(site, asset)),
        hears=(ACK.key(site, asset), SAMPLES.key(site, asset)),
        subscribes=(ACK.key(site, asset), SAMPLES.key(site, asset)),
        answers=tuple(request_key(site, asset, what) for what in ASKED_OF_EDGES),
        replies=(*written, *(request_key(site, asset, what) for what in ("account", "flush"))),
        announces=(alive_key(site, asset),),
        watches=(alive_key(site, asset),),  # for the health check beside it
    )


def server() -> Role:
    """Rights of the twin server."""
    said = tuple(stream.everywhere for stream in OF_TWINS)
    heard = tuple(stream.everywhere for stream in (*OF_EDGES, REGISTRATION))
    return Role(
        writes=said,
        hears=heard,
        subscribes=heard,
        answers=tuple(request_key("*", "*", what) for what in ASKED_OF_TWINS),
        replies=(REGISTRATION.everywhere,),
        asks=tuple(request_key("*", "*", what) for what in ASKED_OF_EDGES),
        announces=(server_key("*"),),
        watches=(alive_key("*", "*"), server_key("*")),
    )


def observer() -> Role:
    """Rights of a recorder, and of processes that monitor."""
    everything = tuple(stream.everywhere for stream in STREAMS)
    return Role(
        hears=(any_key(), *everything),
        subscribes=(any_key(), *everything),
        asks=tuple(request_key("*", "*", what) for what in REQUESTS),
        watches=(alive_key("*", "*"),),
    )


def player() -> Role:
    """Rights of `slowtime replay`: those of all edges, and registrations, states and events."""
    every = edge("*", "*")
    heard = (ACK.everywhere, REGISTRATION.everywhere, *every.writes)
    return dataclasses.replace(
        every,
        writes=(*every.writes, REGISTRATION.everywhere, STATE.everywhere, EVENT.everywhere),
        hears=heard,
        asks=tuple(request_key("*", "*", what) for what in REQUESTS),
        watches=(alive_key("*", "*"),),
    )


ROLES: Mapping[str, str] = {
    "router": "carries everything; what others connect to",
    "server": "the twin server",
    "observer": "`slowtime record` and `slowtime router status`: reads all, writes nothing",
    "player": "`slowtime replay`: writes what any edge of the site may",
    "edge": "the edge agent of one asset, which writes that asset's keys only",
}


def rights(role: str, site: str, asset: str | None) -> Role:
    """Rights of a role of `ROLES`, on keys of both versions; those of a router are its own."""
    if role == "edge":
        assert asset is not None
        return _in_both_versions(edge(site, asset))
    return _in_both_versions({"server": server, "observer": observer, "player": player}[role]())


def _in_both_versions(role: Role) -> Role:
    """Add the former keys: an edge may be older than its router, which reads this."""
    named = {field.name: getattr(role, field.name) for field in dataclasses.fields(role)}
    both = {
        name: (*keys, *(former for key in keys if (former := former_key(key)) is not None))
        for name, keys in named.items()
    }
    return Role(**both)


def common_name(role: str, site: str, asset: str | None, serial: int) -> str:
    """Name in a certificate; each certificate has its own, so that one can be withdrawn.

    Examples
    --------
    >>> common_name("edge", "lab", "beam", 0x1234_5678_9ABC)
    'edge:lab.beam:12345678'
    >>> len(common_name("observer", "s" * 63, "a" * 63, 1 << 80)) <= 64
    True
    """
    name = site if asset is None else f"{site}.{asset}"
    if len(name) > LONGEST_NAME:
        digest = hashlib.sha256(name.encode()).hexdigest()[:16]
        name = f"{name[: LONGEST_NAME - 17]}~{digest}"  # no name of ours has a tilde
    return f"{role}:{name}:{serial:x}"[: len(f"{role}:{name}:") + 8]
