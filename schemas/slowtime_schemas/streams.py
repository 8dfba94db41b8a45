"""The registry of streams: which key carries which message, how often, recorded or not.

Nothing else in the house spells a key.

The name of the stream comes before the asset, since a Zenoh router (1.10) compares a key that
nobody has declared with every declared key beside it, level by level. Each asset declares some
keys: a token, acknowledgements, requests. Where they share a level with what is published, a
publication costs the more the more assets there are; where streams come first, nothing is
declared beside `features`. The partition bounds the comparisons of a declaration likewise, and
divides the assets among servers.
"""

import dataclasses
import functools
from typing import Literal

from .asset_events import AssetEvent
from .messages import (
    About,
    Acknowledgement,
    Event,
    Fatigue,
    Features,
    Health,
    LedgerUpdate,
    Message,
    Registered,
    SensorSamples,
    TwinState,
    Virtual,
)
from .partitions import partition_of
from .raw_header import RawHeader

ROOT = "slowtime/v2"
FORMER_ROOT = "slowtime/v1"
"""Root of the former keys, SITE/ASSET/STREAM, of older edges and recordings."""
LONGEST_KEY = 256
"""Characters of the longest key of ours [1]: site and asset have 63 at most, and all other
levels together fewer than 64; the rest is margin."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """One kind of message on its way.

    Parameters
    ----------
    name
        Last part of the key.
    message
        The class that is carried; None for the binary raw block (see `raw`).
    nominal_rate_hz
        How often a healthy process sends one; None where nothing is promised.
    recorded
        Whether `slowtime record` writes it unless told otherwise.
    sender
        Which process writes it.
    max_bytes
        Largest payload that is looked at; a larger one is refused before it is parsed.
    """

    name: str
    message: type[Message] | None
    nominal_rate_hz: float | None
    recorded: bool
    sender: Literal["sensor", "edge", "twin"]
    encoding: str
    says: str
    max_bytes: int = 2**20

    def key(self, site: str, asset: str, *, partition: int | None = None) -> str:
        """Key expression of one asset; give ``"*"`` for any site or asset.

        Parameters
        ----------
        partition
            With any asset, only those of this partition, 0 to 255.
        """
        return f"{ROOT}/{site}/{self.name}/{_within(asset, partition)}"

    @property
    def everywhere(self) -> str:
        """Key expression of all assets of all sites."""
        return self.key("*", "*")


JSON = "application/json"

SAMPLES = Stream(
    name="samples",
    message=SensorSamples,
    nominal_rate_hz=None,
    recorded=False,
    sender="sensor",
    encoding=JSON,
    max_bytes=16 * 2**20,
    says="any program beside a sensor to edge: samples as they are taken",
)
FEATURES = Stream(
    name="features",
    message=Features,
    nominal_rate_hz=None,
    recorded=True,
    sender="edge",
    encoding=JSON,
    says="edge to twin: frequencies, damping and shapes of one epoch; or a batch of several",
)
HEALTH = Stream(
    name="health",
    message=Health,
    nominal_rate_hz=None,
    recorded=True,
    sender="edge",
    encoding=JSON,
    says="edge to twin: how the agent is, and the end of its account",
)
ABOUT = Stream(
    name="about",
    message=About,
    nominal_rate_hz=None,
    recorded=True,
    sender="edge",
    encoding=JSON,
    says="edge to all: software and settings; also answered on request",
)
RAW = Stream(
    name="raw",
    message=None,
    nominal_rate_hz=None,
    recorded=True,
    sender="edge",
    encoding="application/x-slowtime-raw",
    max_bytes=64 * 2**20,
    says="edge to recorder: samples, where asked for",
)
ACK = Stream(
    name="ack",
    message=Acknowledgement,
    nominal_rate_hz=None,
    recorded=False,
    sender="twin",
    encoding=JSON,
    says="twin to edge: durable up to here",
)
STATE = Stream(
    name="state",
    message=TwinState,
    nominal_rate_hz=None,
    recorded=True,
    sender="twin",
    encoding=JSON,
    says="twin to all: what it knows now",
)
EVENT = Stream(
    name="event",
    message=Event,
    nominal_rate_hz=None,
    recorded=True,
    sender="twin",
    encoding=JSON,
    says="twin to all: what a person may want to know",
)

REGISTRATION = Stream(
    name="registration",
    message=Registered,
    nominal_rate_hz=0.1,
    recorded=True,
    sender="twin",
    encoding=JSON,
    # A model of the 4 MiB that a server takes, and all else that it was told.
    max_bytes=5 * 2**20,
    says="twin to all: what it was told of its structure, so that a replay knows it too",
)

LEDGER = Stream(
    name="ledger",
    message=LedgerUpdate,
    nominal_rate_hz=None,
    recorded=True,
    sender="twin",
    encoding=JSON,
    max_bytes=4 * 2**20,
    says="twin to all: what it has accepted, chained and signed",
)

ASSET_EVENT = Stream(
    name="asset_event",
    message=AssetEvent,
    nominal_rate_hz=None,
    recorded=True,
    sender="twin",
    encoding=JSON,
    says="twin to all: what people have told of the asset, such as a repair",
)
FATIGUE = Stream(
    name="fatigue",
    message=Fatigue,
    nominal_rate_hz=None,
    recorded=True,
    sender="edge",
    encoding=JSON,
    says="edge to twin: stress cycles and damage since the boot began",
)
VIRTUAL = Stream(
    name="virtual",
    message=Virtual,
    nominal_rate_hz=None,
    recorded=True,
    sender="edge",
    encoding=JSON,
    max_bytes=4 * 2**20,
    says="edge to all: quantities that nobody measures, with standard deviations",
)

STREAMS: tuple[Stream, ...] = (
    SAMPLES,
    FEATURES,
    HEALTH,
    ABOUT,
    RAW,
    ACK,
    STATE,
    EVENT,
    REGISTRATION,
    LEDGER,
    ASSET_EVENT,
    FATIGUE,
    VIRTUAL,
)


def alive_key(site: str, asset: str) -> str:
    """Key of the liveliness token of an edge agent."""
    return f"{ROOT}/{site}/{ALIVE}/{_within(asset)}"


def server_key(name: str) -> str:
    """Key of the liveliness token of a twin server.

    The same in every version, so that servers of two versions know of each other.
    """
    return f"{FORMER_ROOT}/server/{name}"


def any_key(site: str = "*", asset: str = "*") -> str:
    """Key expression of every stream at once, so that one subscription keeps their order."""
    return f"{ROOT}/{site}/*/{_within(asset)}"


def request_key(site: str, asset: str, what: str) -> str:
    """Key of a request to an edge agent; `what` is a word of `REQUESTS`."""
    if what not in REQUESTS:
        raise ValueError(
            f"No request is called {what!r}. Allowed: {', '.join(sorted(REQUESTS))}."
        )
    return f"{ROOT}/{site}/{REQUEST}/{what}/{_within(asset)}"


ALIVE = "alive"
"""Level of liveliness tokens, where a stream has its name."""

REQUEST = "request"
"""Level of requests, before the word of `REQUESTS`."""

REQUESTS = {
    "account": "what the spool holds: one JSON object per boot, {boot, first, last, "
    "ack_version}, and where records are damaged {damaged: [[first, last], …]}, and where "
    "another agent's were acknowledged {withheld: true}",
    "features": "features messages again; parameters boot, first, last",
    "raw": "the last samples from the ring buffer; parameter seconds",
    "about": "the about message",
    "fatigue": "the newest fatigue message of each boot that the agent remembers",
    "flush": "features that wait at the agent are sent at once; one JSON object, {sent}",
    "registration": "registrations; the twin server answers, for all its twins that match",
}


def parse_key(key: str) -> tuple[Stream, str, str]:
    """Stream, site and asset of a key, present or former.

    Raises
    ------
    ValueError
        If no stream of the registry has such a key.
    """
    parts = current_key(key).split("/") if len(key) <= LONGEST_KEY else []
    stream = BY_NAME.get(parts[3]) if len(parts) == 6 else None
    if stream is None or "/".join(parts[:2]) != ROOT:
        raise ValueError(
            f"{key!r:.200} is no key of ours. Allowed: {ROOT}/SITE/STREAM/PARTITION/ASSET, "
            f"STREAM one of {', '.join(BY_NAME)}."
        )
    site, partition, asset = parts[2], parts[4], parts[5]
    if partition != _partition(asset):
        raise ValueError(
            f"{key!r:.200} names partition {partition:.20}. Allowed for {asset:.60}: "
            f"{_partition(asset)}, the first byte of the SHA-256 of its name."
        )
    return stream, site, asset


def address_of(key: str) -> tuple[str, str] | None:
    """Site and asset of any key of an asset, present or former; None of another key.

    Examples
    --------
    >>> address_of(alive_key("lab", "beam")), address_of("slowtime/v1/lab/beam/alive")
    (('lab', 'beam'), ('lab', 'beam'))
    >>> address_of(server_key("one")) is None
    True
    """
    parts = current_key(key).split("/")
    is_ours = "/".join(parts[:2]) == ROOT and len(parts) in (6, 7) and len(key) <= LONGEST_KEY
    return (parts[2], parts[-1]) if is_ours else None


def is_of_features(key: str) -> bool:
    """Whether a key, present or former, is of the features of an asset.

    Examples
    --------
    >>> is_of_features(FEATURES.key("lab", "beam")), is_of_features(HEALTH.key("lab", "beam"))
    (True, False)
    """
    parts = current_key(key).split("/")
    return parts[3:4] == [FEATURES.name] and "/".join(parts[:2]) == ROOT


def former_key(key: str) -> str | None:
    """Key, or key expression, of the same in the former version; None of others.

    A former expression has no partition: one of a single partition becomes that of all.

    Examples
    --------
    >>> former_key(FEATURES.key("lab", "beam"))
    'slowtime/v1/lab/beam/features'
    >>> former_key(request_key("*", "*", "raw"))
    'slowtime/v1/*/*/request/raw'
    """
    parts = key.split("/")
    if "/".join(parts[:2]) != ROOT or len(parts) not in (6, 7):
        return None
    site, names, asset = parts[2], parts[3:-2], parts[-1]
    return "/".join((FORMER_ROOT, site, asset, *names))


def current_key(key: str) -> str:
    """Key of the present version; every other key unchanged.

    Examples
    --------
    >>> current_key("slowtime/v1/lab/beam/features")
    'slowtime/v2/lab/features/174/beam'
    """
    # Not even remembered: peers choose their keys, and a bus carries 64 KiB of them.
    return _current_key(key) if len(key) <= LONGEST_KEY else key


@functools.lru_cache(maxsize=65536)
def _current_key(key: str) -> str:
    parts = key.split("/")
    requested = len(parts) == 6 and parts[4] == REQUEST
    if "/".join(parts[:2]) != FORMER_ROOT or not (len(parts) == 5 or requested):
        return key
    site, asset, names = parts[2], parts[3], parts[4:]
    return "/".join((ROOT, site, *names, _within(asset)))


def _within(asset: str, partition: int | None = None) -> str:
    """Last two levels of a key: partition and asset."""
    return f"{_partition(asset) if partition is None else partition}/{asset}"


@functools.lru_cache(maxsize=2**17)
def _partition(asset: str) -> str:
    """Level of the partition of an asset, or of any asset, or of a placeholder."""
    if asset == "*":
        return "*"
    return "{partition}" if asset == "{asset}" else str(partition_of(asset))


MESSAGES: dict[str, type[Message]] = {RawHeader.MESSAGE: RawHeader} | {
    stream.message.MESSAGE: stream.message for stream in STREAMS if stream.message is not None
}
"""Every message by its name; the raw block by its header."""

BY_NAME: dict[str, Stream] = {stream.name: stream for stream in STREAMS}
