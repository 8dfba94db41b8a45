"""Settings of a twin server, from a file, the environment and flags.

A flag overrules the environment (``SLOWTIME_TWIN_*``, nested with ``__``), which overrules the
file named by `config` (TOML or JSON). Units are in the names.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator
from pydantic_settings import SettingsConfigDict

from slowtime_schemas.quantities import Immutable
from slowtime_services.configuration import ProcessSettings
from slowtime_services.shards import Share

from .events.receivers import AlarmSettings
from .registration.twin import Registration

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]

YEAR_2000_NS = 946_684_800_000_000_000


class AdmissionSettings(Immutable):
    """Which messages are let in."""

    max_payload_bytes: Annotated[int, Field(ge=1_024)] = 5 * 2**20
    """Of any stream, each of which may have less: as much as a registration has."""
    max_ahead_s: NotNegative = 300.0
    """How far a sender's clock may be from ours, and a live sensor's time ahead of it."""
    max_age_s: Positive = 30 * 86_400.0
    """Readings of a live sensor that are older on arrival are taken in by their sensor time all
    the same, since a spool may have held them; an event `old_readings` says so."""
    not_before_ns: Annotated[int, Field(ge=0)] = YEAR_2000_NS
    """No sensor time is earlier: a clock that was never set."""
    max_jump: Count = 1_000_000
    """How far a sequence may be ahead of the one expected: ten a second for a day. What is
    farther ahead is taken in where the agent's account lists it and the agent delivers it."""
    max_boots: Count = 10_000
    """Boots of one asset that are remembered: one start an hour for more than a year. Further
    ones are refused, and stay in the agent's spool; an event `too_many_boots` says so."""
    max_assets_of_site: Count = 20_000
    """Assets of one site that are taken in without being registered first; twice the
    largest fleet that was measured on one machine (docs/benchmarks.md). Registered twins have
    no limit."""


class BackfillSettings(Immutable):
    """Requests for missing features."""

    grace_s: NotNegative = 0.25
    """How long a hole may close by itself before the edge is asked."""
    ask_timeout_s: Positive = 5.0
    backoff_s: Positive = 0.25
    """Before the second question; doubled with each, up to `max_backoff_s`."""
    max_backoff_s: Positive = 10.0
    tries: Count = 3
    """Answers without what is missing until it is given up."""
    foreign_patience_s: NotNegative = 5.0
    """How long to wait for a sender that keeps no account of its own."""
    absent_patience_s: NotNegative = 86_400.0
    """How long to wait for an edge agent that is away."""
    max_held: Count = 20_000
    """Features of one boot kept out of order; more are asked for again when there is room."""
    max_held_bytes: Annotated[int, Field(ge=5 * 2**20)] = 64 * 2**20
    """Bytes of all features of one asset kept out of order: 20,000 of 3 KiB."""


class PipelineSettings(Immutable):
    """Sizes of batches and queues of the pipeline."""

    batch_messages: Count = 2_000
    gather_s: Annotated[float, Field(ge=0, le=10)] = 0.1
    """Batches begin at least so long after each other [s], so that messages of many assets
    share a transaction. A message after a pause is worked at once; 0 lets no message wait. The
    default is the interval of acknowledgements. It halved the processor time per feature at
    115 features a second (docs/shards.md)."""
    inbox_messages: Count = 200_000
    inbox_bytes: Annotated[int, Field(ge=2**20)] = 256 * 2**20
    states_per_batch: Count = 200
    """A batch with more states than this publishes the latest of each twin only."""


class ProgressSettings(Immutable):
    """Budget of the work on messages, and how long the server may stand still."""

    step_s: Positive = 5.0
    """Processor time of one step on messages [s]; ten times what the slowest known takes."""
    step_s_per_message: NotNegative = 0.5
    """Added for each message of the step [s]; twice what one of a twin of elements takes."""
    step_s_per_parameter: NotNegative = 1.0
    """Added for each free parameter of a twin of elements, for each of its messages [s]; three
    times what it takes to find which of thirty groups has changed (11 s)."""
    silent_s: Annotated[float, Field(ge=2, le=600)] = 10.0
    """How long a step may stand still, and the process give no sign of life [s]. Beyond it the
    stacks are logged, the claim to lead is released and the process ends, all within 15 s."""
    store_s: Annotated[float, Field(ge=10)] = 120.0
    """How long the database may take for one statement, or a request for its turn, without any
    progress [s]; as long as PostgreSQL may take to fail over."""
    end_s: Annotated[float, Field(ge=1)] = 15.0
    """How long the server may take to end after SIGTERM, beside `shutdown_s` [s]; then it is
    ended. Longer than a busy machine needs, shorter than containers are waited for (30 s)."""
    max_aside: Count = 1_000
    """Messages that are kept aside; more are refused until some are released or dropped."""
    max_aside_of_one: Count = 100
    """Of these, those of one asset."""
    max_aside_bytes: Annotated[int, Field(ge=2**20)] = 64 * 2**20
    """Of all of them together."""


class ServeSettings(Immutable):
    """Limits of requests."""

    max_body_bytes: Annotated[int, Field(ge=1_024)] = 65_536
    default_points: Annotated[int, Field(ge=2)] = 1_000
    max_points: Annotated[int, Field(ge=2)] = 100_000
    max_live_clients: Count = 500
    max_live_of_one: Count = 50
    """Of these, those of one token; a site may have half of all."""
    max_connections: Annotated[int, Field(ge=2)] = 2_000
    """More at once are answered with 503; those on which nothing was asked give way."""
    max_connections_of_one: Count = 1_000
    """Of these, those of one address; behind a proxy that is the proxy's to bound."""
    head_s: Positive = 10.0
    """Time for the head of a request, and for a first one."""
    body_s: Positive = 30.0
    """How long a body, or the taking of an answer, may be slower than the following."""
    slowest_bytes_per_s: Positive = 8_192.0
    upload_s: Positive = 3_600.0
    """Time for a whole body."""
    live_backlog: Annotated[int, Field(ge=16)] = 2_000
    """Events a slow client may be behind, or a returning one may have missed."""
    max_measured: Annotated[int, Field(ge=0)] = 200
    """Twins whose estimates are among the metrics; where there are more, none are."""
    forecast_refresh_readings: Count = 25
    max_forecast_points: Annotated[int, Field(ge=2)] = 200
    workers: Count = 2
    """Processes that forecast, learn and simulate; one is kept free of what takes longest. A
    site has so many at once."""
    spare_workers: Annotated[int, Field(ge=0)] = 4
    """Further such processes, each for a site that has none while others have all."""
    max_waiting: Count = 64
    """Requests that wait for these; more are answered with 503, those of a site that has half
    of them with 429."""
    max_waiting_of_one: Count = 8
    """Of these, forecasts of one twin; and simulations of one site."""
    work_timeout_s: Positive = 120.0
    """How long one of them may take until it is ended."""
    max_exports: Count = 32
    """Tables that are given at once, half of them to one site."""
    reading_threads: Count = 8
    """Threads that answer what only has to be read."""


class DiagnoseSettings(Immutable):
    """Limits of diagnoses, and the samples they may use."""

    recordings: Path | None = None
    """Folder of recordings (MCAP) that diagnoses may be made from; None for none."""
    effects: tuple[str, ...] = ()
    """Installed parts of one's own (entry points of `slowtime.effects`) that a diagnosis in
    fast time may name. No request names any."""
    max_raw_s: Positive = 600.0
    """Most seconds of raw samples that the edge is asked for, or that are read."""
    max_samples: Count = 20_000_000
    """Most numbers of one diagnosis, all channels together."""
    max_queued: Count = 4
    """Diagnoses of one site that wait while one of it runs."""
    max_queued_of_all: Count = 64
    """Diagnoses that wait, of all sites."""
    max_running: Count = 6
    """Diagnoses that run at once, of different sites; each may take `max_memory_bytes`. Those
    beyond the processors take turns."""
    max_kept: Count = 50
    """Diagnoses kept of each twin."""
    max_s: Positive = 900.0
    """How long one may run until it is ended."""
    max_memory_bytes: Annotated[int, Field(ge=2**28)] = 2 * 2**30
    """Beyond what it has loaded of libraries and their code."""
    max_history: Annotated[int, Field(ge=100)] = 4_000
    """Epochs that a diagnosis in slow time looks back."""
    ask_timeout_s: Positive = 5.0
    """How long to wait for the edge's raw samples."""


class RecordingSettings(Immutable):
    """Recordings that are given by REST, into the folder `diagnose.recordings`."""

    max_bytes: Annotated[int, Field(ge=1_024)] = 256 * 2**20
    """Of one."""
    max_total_bytes: Annotated[int, Field(ge=1_024)] = 4 * 2**30
    """Of all in the folder, whoever put them there; no more is taken in then."""
    max_files: Count = 500
    patience_s: Positive = 30.0
    """How long one that is being sent may fall behind `slowest_bytes_per_s`."""
    slowest_bytes_per_s: Positive = 8_192.0
    """Rate at which one is to be sent."""
    max_at_once: Count = 32
    """That are being sent at the same time, half of them by one site."""
    max_replays: Count = 8
    """Replays at once, of different sites; one goes on at a time."""
    max_replay_s: Positive = 86_400.0
    """How long a replay may take; a speed at which it would take longer is refused."""


class GapSettings(Immutable):
    """How a model with inputs is compared with incoming samples."""

    every_s: NotNegative = 30.0
    """Between two comparisons; 0 for none."""
    seconds: Positive = 20.0
    """Of raw samples asked from the edge for each."""
    learn: Annotated[int, Field(ge=4, le=1_000)] = 12
    """Comparisons from which it is learnt how far model and structure are apart anyway."""
    tune: Annotated[int, Field(ge=1, le=20)] = 3
    """Of these, the first, to which the model's constants are fitted within its tolerance."""
    refit: bool = False
    """Whether the model's constants are fitted to each record within its tolerance before the
    comparison. It keeps weather and age from being called a disagreement; what constants within
    tolerance can make up for is then no disagreement either."""
    readings_between_false_alarms: Annotated[float, Field(ge=100)] = 1e5
    kept: Annotated[int, Field(ge=10)] = 500
    """Comparisons of a twin kept for the page."""


class OpenIdSettings(Immutable):
    """An OpenID provider whose JWTs are accepted."""

    issuer: Annotated[str, Field(min_length=1)]
    audience: Annotated[str, Field(min_length=1)]
    """What a token must be for: this server."""
    jwks: Annotated[str, Field(pattern=r"^(https://.+|[^:]+)$")]
    """Its keys: a file, or an address that begins with https."""
    algorithms: tuple[Literal["RS256", "PS256", "ES256", "ES384", "EdDSA"], ...] = (
        "RS256",
        "ES256",
    )
    scope_claim: str = "slowtime_scope"
    """Name of the claim that says viewer, operator or admin."""
    sites_claim: str = "slowtime_sites"
    """Name of the claim that lists sites, or `*`."""
    leeway_s: Annotated[float, Field(ge=0, le=300)] = 30.0


class TlsSettings(Immutable):
    """Encryption of REST and page."""

    certificate: Path
    key: Path


class AccessSettings(Immutable):
    """Access control and rates. Without `tokens` and `openid`, local callers only."""

    tokens: Path | None = None
    """File of tokens, made by `slowtime tokens`."""
    openid: OpenIdSettings | None = None
    behind_proxy: bool = False
    """A proxy on this machine or network does the encryption, and says who it asks for."""
    published_on_loopback: bool = False
    """Whoever reaches the port is on this machine, wherever it listens: a container's port
    that is published on 127.0.0.1 alone."""
    hosts: tuple[str, ...] = ()
    """Further names of this machine, for a server without tokens."""
    requests_per_s: Positive = 100.0
    """Of one token; of one address, for what needs none."""
    burst: Count = 1_000
    failures_per_s: Positive = 1.0
    """Tokens that are refused, of one address."""
    failures_burst: Count = 20

    @property
    def required(self) -> bool:
        """Whether callers must authenticate."""
        return self.tokens is not None or self.openid is not None


HttpUrlText = Annotated[str, Field(pattern=r"^https?://[^/\s]+(/\S*)?$", max_length=2_000)]


class LedgerSettings(Immutable):
    """How accepted rows are signed."""

    key: Path | None = None
    """File of the private key that `slowtime db ledger key` made; without one, rows are chained
    all the same, but no signed head covers them."""
    every_s: Positive = 60.0
    """A head is signed so often, where anything has changed."""
    audit_every_s: Annotated[float, Field(ge=0)] = 86_400.0
    """The running server compares its whole database with the ledger so often; 0 for never. A
    server that starts does so in any case, before it signs."""
    witness_file: Path | None = None
    """Each head is appended to this file too, one JSON object a line; it belongs where the
    server can append but not overwrite. A server that starts compares its last line with the
    database."""
    witness_url: HttpUrlText | None = None
    """Each head is sent there too, by POST, as JSON."""
    timestamp_url: HttpUrlText | None = None
    """Authority that stamps heads (RFC 3161); needs `slowtime[timestamps]`."""
    timestamp_every_s: Positive = 3_600.0
    """A head is stamped at most so often."""
    timestamp_folder: Path = Path("timestamps")
    """Where stamped heads (`head-7.json`) and their time stamps (`head-7.tsr`) are kept."""
    continue_after_head: Annotated[int, Field(ge=1)] | None = None
    """Sign again although the database does not prove consistent with this head, its last one.
    All rows are chained anew as they stand, and every later audit against this head or one
    before says so."""


class ShardSettings(Immutable):
    """Division of the assets among several processes, each with a history of its own.

    Examples
    --------
    >>> ShardSettings(count=4).share is None, ShardSettings(count=4, index=1).share
    (True, Share(index=1, count=4))
    """

    count: Annotated[int, Field(ge=1, le=256)] = 1
    """Number of shards; 1 for a single server. At most one for each of the 256 partitions."""
    index: Annotated[int, Field(ge=0)] | None = None
    """Which shard this process is, from 0; None for the process that starts all of them."""
    engine: Annotated[str, Field(pattern=r"^(local|ray(:auto|://.+)?)$")] = "local"
    """Who runs the shards: `local` processes of this machine; `ray` on a cluster that is
    started on this machine; `ray:auto` on the cluster that this machine belongs to;
    `ray://HOST:PORT` on one that is reached by its client port."""
    cores: Annotated[float, Field(ge=0, le=1024)] = 1.0
    """Cores that Ray reserves on a node for each shard; 0 reserves none."""
    key: str = Field("", repr=False)
    """Secret of the front and its shards, which answer requests with it only. The process that
    starts the shards makes one for each start; leave it out."""
    backoff_s: Positive = 0.25
    """Before a shard that ended is started again; doubled each time up to `max_backoff_s`."""
    max_backoff_s: Positive = 10.0
    answer_timeout_s: Positive = 120.0
    """How long a shard may be silent until its answer is given up; forecasts take longest."""

    @model_validator(mode="after")
    def _among_all(self) -> Self:
        if self.index is not None and self.index >= self.count:
            raise ValueError(
                f"index {self.index} was given, and there are {self.count} shards. Allowed: 0 "
                f"to {self.count - 1}. Correct index or count."
            )
        return self

    @property
    def share(self) -> Share | None:
        """Assets of this process; None for all."""
        if self.index is None or self.count == 1:
            return None
        return Share(self.index, self.count)


class TwinSettings(ProcessSettings):
    """All settings of a twin server.

    Examples
    --------
    >>> TwinSettings(port=8080, healing={"tries": 5}).healing.tries
    5
    """

    model_config = SettingsConfigDict(
        env_prefix="SLOWTIME_TWIN_", nested_model_default_partial_update=True
    )

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65_535)] = 8000
    """0 for any that is free."""
    database: str | Path = Path("twin.sqlite")
    """SQLite file, or URL of a PostgreSQL database: postgresql://user@host/name. Give its
    password by libpq's PGPASSFILE or PGPASSWORD."""
    standby: bool = False
    """Wait while another server has the database, and go on when that has ended, instead of
    refusing to start."""
    synchronous: Literal["NORMAL", "FULL"] = "FULL"
    """FULL waits for the disk before anything is acknowledged, so that a power cut costs
    nothing; NORMAL survives the death of the process only."""
    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Where the router is."""
    connect_timeout_s: Positive = 30.0
    """How often the log says that there is no router yet; the server waits for one as long as
    it takes, and `/readyz` says so."""
    credentials: Path | None = None
    """Folder that `slowtime keys` made for the server; None to speak in the clear."""
    zenoh: dict[str, Any] = Field(default_factory=dict, repr=False)
    """Further settings of Zenoh, key to value."""
    registrations: Path | None = None
    """TOML or JSON file: twin id → registration, for twins that are not yet registered."""
    auto_register: bool = True
    """Whether an asset nobody registered gets a twin when its first features come."""
    default_registration: Registration = Registration()
    """What such a twin is registered as."""
    shutdown_s: Positive = 3.0
    """How long clients may take to finish when the server ends."""
    admission: AdmissionSettings = AdmissionSettings()
    healing: BackfillSettings = BackfillSettings()
    pipeline: PipelineSettings = PipelineSettings()
    progress: ProgressSettings = ProgressSettings()
    serve: ServeSettings = ServeSettings()
    access: AccessSettings = AccessSettings()
    tls: TlsSettings | None = None
    """Certificate and key of REST and page; None where there is a proxy, or nobody else."""
    diagnose: DiagnoseSettings = DiagnoseSettings()
    recordings: RecordingSettings = RecordingSettings()
    gap: GapSettings = GapSettings()
    ledger: LedgerSettings = LedgerSettings()
    shards: ShardSettings = ShardSettings()
    alarms: AlarmSettings = AlarmSettings()
    """Receivers of events, and how they are told."""
