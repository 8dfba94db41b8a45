"""Settings of the outputs: the server that is read, and the receivers."""

import fnmatch
from pathlib import Path
from typing import Annotated, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, model_validator
from pydantic_settings import SettingsConfigDict

from slowtime_schemas.quantities import Immutable
from slowtime_services.configuration import ProcessSettings

OutputName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$")]
Host = Annotated[str, Field(pattern=r"^[A-Za-z0-9._:-]{1,253}$")]
Port = Annotated[int, Field(ge=1, le=65_535)]
TopicLevel = Annotated[str, Field(pattern=r"^[^#+/\x00-\x1f]{1,100}$")]
Seconds = Annotated[float, Field(gt=0, le=86_400)]
LOOPBACK = ("localhost", "127.0.0.1", "::1")


class _OutputSettings(Immutable):
    twins: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)] = ("*",)
    """Patterns of twin ids, such as ``lab.*``."""
    begin: Literal["first", "latest"] = "latest"
    """Where a twin that is new to the output begins: at its first state, or at its latest."""
    every_s: Seconds = 1.0
    """Between two looks for what is new."""
    timeout_s: Annotated[float, Field(gt=0, le=300)] = 10.0
    """How long the receiver may take for one answer."""
    backoff_s: Seconds = 1.0
    """Before the second attempt; doubled with each, up to `max_backoff_s`."""
    max_backoff_s: Seconds = 60.0

    def takes(self, twin_id: str) -> bool:
        """Whether a twin is sent.

        Examples
        --------
        >>> InfluxSettings(kind="influx", url="http://127.0.0.1:8086", database="d",
        ...     twins=["lab.*"]).takes("lab.beam")
        True
        """
        return any(fnmatch.fnmatchcase(twin_id, pattern) for pattern in self.twins)


class _BrokerSettings(_OutputSettings):
    host: Host
    port: Port = 1883
    tls: bool = False
    ca: Path | None = None
    """Certificates to trust instead of the system's (PEM)."""
    credentials_file: Path | None = None
    """Two lines: user and password."""
    insecure: bool = False
    """Whether a password may travel without TLS beyond this machine."""

    @model_validator(mode="after")
    def _says_no_password_in_the_clear(self) -> Self:
        clear = not self.tls and self.host not in LOOPBACK and not self.insecure
        if clear and self.credentials_file is not None:
            raise ValueError(
                "A password was given for a broker without encryption. Give tls = true, or "
                "insecure = true for a network of your own."
            )
        return self


class MqttSettings(_BrokerSettings):
    """Topics of plain JSON at an MQTT broker; needs the extra `mqtt`."""

    kind: Literal["mqtt"]
    prefix: Annotated[str, Field(pattern=r"^[^#+\x00-\x1f]{1,100}$")] = "slowtime"
    """Topics are PREFIX/SITE/ASSET/state, .../event and .../status."""
    home_assistant: TopicLevel | None = None
    """Prefix of discovery, `homeassistant` by default there; null for no discovery."""


class SparkplugSettings(_BrokerSettings):
    """An edge node by Sparkplug B, with a device for each twin; needs the extra `sparkplug`."""

    kind: Literal["sparkplug"]
    group: TopicLevel = "slowtime"
    node: TopicLevel
    """Id of the edge node; no other client of the broker may have it."""
    primary_host: TopicLevel | None = None
    """Host application without which nothing is sent; what it misses is sent as historical."""


class InfluxSettings(_OutputSettings):
    """A database that takes the line protocol of InfluxDB by HTTP."""

    kind: Literal["influx"]
    begin: Literal["first", "latest"] = "first"
    url: Annotated[str, Field(max_length=2_000)]
    """Of the server, such as ``http://127.0.0.1:8086``."""
    database: str | None = None
    """Version 1, and VictoriaMetrics: sent to ``/write``."""
    bucket: str | None = None
    """Version 2 and 3: sent to ``/api/v2/write``."""
    org: str | None = None
    token_file: Path | None = None
    """Its content, without blanks at the ends, is the token of version 2."""
    credentials_file: Path | None = None
    """Two lines, user and password, of version 1."""
    ca: Path | None = None
    insecure: bool = False
    """Whether http is allowed beyond this machine."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.username:
            raise ValueError(
                "The url of a database was given that is none. Give https://HOST:PORT, "
                "without user or password."
            )
        if parts.scheme == "http" and parts.hostname not in LOOPBACK and not self.insecure:
            raise ValueError(
                f"A database at {parts.hostname} was given over http, which others can read. "
                "Give https, or insecure = true for a network of your own."
            )
        if (self.database is None) == (self.bucket is None):
            raise ValueError(
                "Give either database (version 1, VictoriaMetrics) or bucket (version 2 and 3)."
            )
        return self


class OpcUaSettings(_OutputSettings):
    """An OPC UA server of the latest states; needs the extra `opcua`."""

    kind: Literal["opcua"]
    host: Host = "127.0.0.1"
    port: Port = 4840
    certificate: Path | None = None
    """Of this server (PEM or DER); with one, clients must sign and encrypt."""
    key: Path | None = None
    credentials_file: Path | None = None
    """Two lines: user and password that clients must give; they travel encrypted."""
    insecure: bool = False
    """Whether clients of other machines may read without encryption."""

    @model_validator(mode="after")
    def _is_secure(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key go together. Give both.")
        if self.certificate is None and self.host not in LOOPBACK and not self.insecure:
            raise ValueError(
                f"An OPC UA server at {self.host} was given without a certificate. Give "
                "certificate and key, or insecure = true for a network of your own."
            )
        if self.credentials_file is not None and self.certificate is None:
            raise ValueError(
                "A password was given for an OPC UA server without encryption. Give "
                "certificate and key."
            )
        return self


OutputSettings = Annotated[
    MqttSettings | SparkplugSettings | InfluxSettings | OpcUaSettings,
    Field(discriminator="kind"),
]


class OutputsSettings(ProcessSettings):
    """All settings of the process that sends to receivers.

    Examples
    --------
    >>> OutputsSettings(outputs={"db": {"kind": "influx", "url": "http://127.0.0.1:8086",
    ...     "database": "plant"}}).outputs["db"].begin
    'first'
    """

    model_config = SettingsConfigDict(env_prefix="SLOWTIME_OUTPUTS_")

    server: str = "http://127.0.0.1:8000"
    """The twin server that is read."""
    token_file: Path | None = None
    """Its content is the token for the server; without one, that of SLOWTIME_TOKEN."""
    ca: Path | None = None
    """Certificates to trust instead of the system's, such as a site's own (PEM)."""
    folder: Path = Path("outputs")
    """Where the position of each output is kept."""
    outputs: Annotated[dict[OutputName, OutputSettings], Field(min_length=1, max_length=16)]
