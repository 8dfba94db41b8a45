"""Receivers of events, declared by an operator in the server's settings.

A registration names a receiver and cannot say more of it: no request makes the server call an
address, or read a file, that an operator has not written down here.
"""

from pathlib import Path
from typing import Annotated, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, model_validator

from slowtime_schemas.quantities import Immutable

ReceiverName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$")]
Host = Annotated[str, Field(pattern=r"^[A-Za-z0-9._:-]{1,253}$")]
Port = Annotated[int, Field(ge=1, le=65_535)]
Address = Annotated[str, Field(pattern=r"^[^@\s<>\",]{1,64}@[A-Za-z0-9.-]{1,253}$")]
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


class _Receiver(Immutable):
    sites: Annotated[
        tuple[str, ...] | None, Field(description="Whose twins may use it; null for all.")
    ] = None
    timeout_s: Annotated[float, Field(gt=0, le=300)] = 10.0
    """For how long one attempt may last."""
    concurrency: Annotated[int, Field(ge=1, le=8)] = 2
    """Messages that are being sent to it at once."""
    local: bool = False
    """Whether its name may lead to this machine, its link or a metadata service; an address
    that is written out, or localhost, always may."""

    def may_serve(self, site: str) -> bool:
        """Whether twins of a site may use it."""
        return self.sites is None or site in self.sites


class WebhookReceiver(_Receiver):
    """An HTTP server that receives a signed POST.

    Examples
    --------
    >>> WebhookReceiver(kind="webhook", url="https://a.example/x", secret_env="S").timeout_s
    10.0
    """

    kind: Literal["webhook"]
    url: Annotated[str, Field(max_length=2_000)]
    secret_file: Path | None = None
    """Its content, without blanks at the ends, is the secret of the signature."""
    secret_env: str | None = None
    """Or the name of an environment variable that holds it."""
    ca: Path | None = None
    """Certificates to trust instead of the system's (PEM)."""
    insecure: bool = False
    """Whether http is allowed beyond this machine."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.username:
            raise ValueError(
                "The url of a webhook was given that is none. Give https://HOST/PATH, "
                "without user or password."
            )
        if (self.secret_file is None) == (self.secret_env is None):
            raise ValueError(
                "A webhook is signed with one secret. Give secret_file or secret_env."
            )
        secure = parts.scheme == "https" or parts.hostname in _LOOPBACK or self.insecure
        if not secure:
            raise ValueError(
                f"A webhook at {parts.hostname} was given over http, which others can read. "
                "Give https, or insecure=true for a network of your own."
            )
        return self


class EmailReceiver(_Receiver):
    """People, by a mail server that takes messages from this machine."""

    kind: Literal["email"]
    host: Host
    port: Port = 587
    security: Literal["starttls", "tls", "none"] = "starttls"
    """`tls` from the first byte (port 465), `starttls` after a greeting (port 587)."""
    credentials_file: Path | None = None
    """Two lines: user and password."""
    sender: Address
    to: Annotated[tuple[Address, ...], Field(min_length=1, max_length=50)]
    ca: Path | None = None

    @model_validator(mode="after")
    def _says_no_password_in_the_clear(self) -> Self:
        if self.security == "none" and self.credentials_file and self.host not in _LOOPBACK:
            raise ValueError(
                "A password was given for a mail server without encryption. Give security = "
                "'starttls' or 'tls'."
            )
        return self


class MqttReceiver(_Receiver):
    """A topic of an MQTT broker; needs the extra `mqtt`."""

    kind: Literal["mqtt"]
    host: Host
    port: Port = 1883
    topic: Annotated[str, Field(pattern=r"^[^#+\x00-\x1f]{1,200}$")] = (
        "slowtime/{site}/{asset}/alarms"
    )
    """May name {site}, {asset}, {kind} and {severity} of the event."""
    qos: Literal[1, 2] = 1
    tls: bool = False
    ca: Path | None = None
    credentials_file: Path | None = None
    insecure: bool = False
    """Whether a password may travel without TLS beyond this machine."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        try:
            self.topic_of(site="s", asset="a", kind="k", severity="alarm")
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            raise ValueError(
                f"The topic {self.topic!r:.80} cannot be filled in ({error}). Allowed in "
                "braces: {site}, {asset}, {kind}, {severity}."
            ) from None
        clear = not self.tls and self.host not in _LOOPBACK and not self.insecure
        if clear and self.credentials_file is not None:
            raise ValueError(
                "A password was given for a broker without encryption. Give tls = true, or "
                "insecure = true for a network of your own."
            )
        return self

    def topic_of(self, *, site: str, asset: str, kind: str, severity: str) -> str:
        """Return the topic of a message."""
        return self.topic.format(site=site, asset=asset, kind=kind, severity=severity)


class OwnReceiver(_Receiver):
    """Whatever an installed part of one's own sends to.

    Examples
    --------
    >>> OwnReceiver(kind="own", part="logbook", options={"path": "book"}).concurrency
    2
    """

    kind: Literal["own"]
    part: Annotated[str, Field(min_length=1, max_length=100)]
    """Name of an entry point of `slowtime.alarms`."""
    options: Annotated[dict[str, str], Field(max_length=32)] = Field(default_factory=dict)
    """What the part is told with each event."""


Receiver = Annotated[
    WebhookReceiver | EmailReceiver | MqttReceiver | OwnReceiver, Field(discriminator="kind")
]


class AlarmSettings(Immutable):
    """Receivers of events, and how they are sent.

    Examples
    --------
    >>> AlarmSettings().max_age_s
    86400.0
    """

    receivers: dict[ReceiverName, Receiver] = Field(default_factory=dict, max_length=32)
    """By name, which a registration's `alarm_routes` refer to."""
    max_reading_age_s: Annotated[float, Field(gt=0, le=1e9)] = 3_600.0
    """Events of readings that were older on arrival are not sent; an alarm among them is, once
    a newer reading has come and the alarm still holds."""
    max_age_s: Annotated[float, Field(gt=0, le=1e9)] = 86_400.0
    """For how long delivery is tried until it is given up, with an event that says so."""
    backoff_s: Annotated[float, Field(gt=0, le=3_600)] = 2.0
    """Before the second attempt; doubled with each, up to `max_backoff_s`."""
    max_backoff_s: Annotated[float, Field(gt=0, le=86_400)] = 300.0
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of the jitter, by which each pause is shortened to between a half and all of it."""
    kept_s: Annotated[float, Field(gt=0, le=1e9)] = 30 * 86_400.0
    """For how long it is kept what was delivered or given up."""
    simulated: bool = False
    """Whether events of simulated structures are sent too, for trying."""
    page_url: Annotated[str | None, Field(max_length=500)] = None
    """Where people reach the page, as it stands in messages."""

    def of_site(self, site: str) -> dict[str, Receiver]:
        """Receivers that twins of a site may use, by name."""
        return {name: one for name, one in self.receivers.items() if one.may_serve(site)}


class AlarmRoute(Immutable):
    """Which events of a twin go to a receiver."""

    receiver: Annotated[
        ReceiverName,
        Field(description="Name of one that the server's settings declare.", examples=["ops"]),
    ]
    severities: Annotated[
        tuple[Literal["info", "warning", "alarm"], ...], Field(min_length=1, max_length=3)
    ] = ("alarm",)
    kinds: Annotated[
        tuple[Annotated[str, Field(pattern=r"^[a-z_]{1,64}$")], ...] | None,
        Field(max_length=32, description="Of events; null for all of these severities."),
    ] = None
    acknowledgements: Annotated[
        bool, Field(description="Whether it is told who has acknowledged an alarm.")
    ] = False
    remind_s: Annotated[
        float | None,
        Field(
            ge=1,
            le=31_536_000,
            description="After how long it is told again of an alarm that holds and that "
            "nobody has acknowledged; null for never.",
        ),
    ] = None

    def takes(self, kind: str, severity: str) -> bool:
        """Whether an event is sent on this route."""
        if kind == "alarm_acknowledged":
            return self.acknowledgements
        return severity in self.severities and (self.kinds is None or kind in self.kinds)
