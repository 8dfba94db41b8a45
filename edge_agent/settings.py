"""Settings of an edge agent, from a file, the environment and flags.

A flag overrules the environment (``SLOWTIME_EDGE_*``, nested with ``__``), which overrules the
file named by `config` (TOML or JSON). Units are in the names.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    Field,
    PlainValidator,
    ValidationError,
    model_validator,
)
from pydantic_settings import SettingsConfigDict

from slowtime_schemas.messages import About, LinkProfile, TimeBase
from slowtime_schemas.quantities import AS_STORED, BootId, Immutable, Name, Plain, PlainText
from slowtime_services.configuration import ProcessSettings
from slowtime_services.link_profiles import INTERVALS, KEEP_ALIVE_BYTES, LEASES
from slowtime_services.virtual_sensors.settings import Asked, PointCurve

from .inputs import BoardsInput, LiveInput

if TYPE_CHECKING:
    from slowtime.estimation.virtual import VirtualSettings
    from slowtime_services.simulate import EvolvingStructure
else:
    EvolvingStructure = VirtualSettings = Any

LONGEST_MONTH_S = 31 * 86_400.0

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Band = tuple[NotNegative, Positive]
Hour = Annotated[float, Field(ge=0, le=24)]


class Origin(Immutable):
    """Origin of features: site, asset, boot and other fields of all messages of a stream."""

    site: Name
    asset: Name
    boot: BootId
    time_base: TimeBase = "live"
    slow_time_unit: PlainText = "s"


def _structure(given: Any = None) -> "EvolvingStructure":
    """Make the structure that is described; an edge beside a sensor imports no simulator."""
    from slowtime_services.simulate import EvolvingStructure, simulated_structure

    if isinstance(given, EvolvingStructure):
        return given
    try:
        return simulated_structure(given or {})
    except ValidationError as error:
        faults = (
            f"{'.'.join(map(str, fault['loc'])) or 'structure'}={fault['input']!r}: "
            f"{fault['msg'].removeprefix('Value error, ')}"
            for fault in error.errors(include_url=False)
        )
        raise ValueError("; ".join(faults)) from error


class SimulatedInput(Immutable):
    """Samples of a structure that exists in software only."""

    kind: Literal["simulated"] = "simulated"
    structure: Annotated[EvolvingStructure, PlainValidator(_structure)] = Field(
        default_factory=_structure
    )
    every_s: NotNegative = 0.5
    """From one epoch to the next on the wall's clock; 0 for as fast as possible."""
    first_epoch: Annotated[int, Field(ge=0)] = 0
    hold: Path | None = None
    """While this file exists, no epoch begins: a sped-up calendar stands still as long as
    something takes real time."""


class FileInput(Immutable):
    """Samples out of a table of measurements: text, NumPy, MATLAB."""

    kind: Literal["file"] = "file"
    path: Path
    rate_hz: Positive | None = None
    channels: tuple[str, ...] | None = None
    skip_lines: Annotated[int, Field(ge=0)] | None = None
    columns: tuple[PlainText, ...] | None = None
    time_column: str | None = None
    time_unit: Literal["s", "ms", "us", "ns", "min", "h", "d"] | None = None
    """Unit of that column, where the file does not say."""
    wrapped: bool | None = None
    """Whether all columns are one series, several values a line; None to find out."""
    repeated: Literal["drop", "keep"] | None = None
    """Whether rows that repeat the row before are left out or kept; None to find out."""
    keep: tuple[str, ...] = ()
    """Columns to keep that would be set aside, as counters or constants; `all` for each. Those
    of covariates are kept in any case."""
    units: tuple[str, ...] = ()
    """Units of the samples, `UNIT` of all channels or `CHANNEL=UNIT`; they override the file.
    Motion is converted to SI."""
    sensitivities: tuple[str, ...] = ()
    """What volts or counts mean: `100mV/g`, `CHANNEL=256LSB/g`."""
    block_s: Positive = 0.1
    start_ns: Annotated[int, Field(ge=0)] | None = None
    speed: NotNegative = 0.0
    """Seconds of the file in one second on the wall; 0 for as fast as possible."""


class RecordingInput(Immutable):
    """Raw blocks out of an MCAP recording."""

    kind: Literal["recording"] = "recording"
    path: Path
    site: Name | None = None
    asset: Name | None = None
    """Whose blocks, where the recording holds those of several."""
    units: tuple[str, ...] = ()
    """Units of the samples, `UNIT` of all channels or `CHANNEL=UNIT`; they override the
    recording, and motion is then converted to SI. Without any, blocks stay as recorded."""
    sensitivities: tuple[str, ...] = ()
    """What volts or counts mean: `100mV/g`, `CHANNEL=256LSB/g`."""
    speed: NotNegative = 0.0
    """Seconds of the recording in one second on the wall; 0 for as fast as possible."""


Input = Annotated[
    SimulatedInput | FileInput | RecordingInput | LiveInput | BoardsInput,
    Field(discriminator="kind"),
]


class BlockAdmissionSettings(Immutable):
    """Which blocks are let in."""

    max_ahead_s: Positive = 60.0
    """How far a live sensor's time may be ahead of ours before its block is refused."""
    max_behind_s: Positive | None = None
    """How far it may be behind; None for any, as of a device that was offline."""
    clock_tolerance_s: Positive = 1.0
    """How far a block's time may be from what its index and the rate say."""


class ConditionSettings(Immutable):
    """Processing of samples before identification."""

    spikes: bool = True
    spike_threshold: Positive = 8.0
    """In standard deviations of the deviation from the neighbours' mean."""
    max_gap_s: NotNegative = 0.25
    """Longest run of missing samples that is bridged; a longer one starts a new segment."""
    highpass_hz: Positive | None = None
    lowpass_hz: Positive | None = None
    order: Annotated[int, Field(ge=1, le=12)] = 4
    decimate: Annotated[int, Field(ge=1, le=1000)] = 1


class TrackingSettings(Immutable):
    """Tracking of modes from window to window."""

    confirm: Annotated[int, Field(ge=1)] = 5
    """Windows that must show a mode before it is given an identity."""
    quiet: Annotated[int, Field(ge=1)] = 10
    """Windows in a row without a mode before it counts as missing."""
    patience: Annotated[int, Field(ge=1)] = 2000
    """Windows in a row without a mode before it is given up."""
    false_modes: Positive = 0.3
    """Expected in a window, per unit of ln f."""
    most: Annotated[int, Field(ge=1, le=1000)] = 64
    """Modes followed at once, those without an identity included."""

    @model_validator(mode="after")
    def _gives_up_last(self) -> "TrackingSettings":
        if self.patience < self.quiet:
            raise ValueError(
                f"patience={self.patience} is less than quiet={self.quiet}. A mode is missing "
                "before it is given up: raise patience."
            )
        return self


FEWEST_CYCLES = 50
"""Cycles of the lowest frequency that a memory holds, as recursive identification asks."""


class ExtractSettings(Immutable):
    """Identification of frequency, damping and shapes from conditioned samples."""

    channels: tuple[str, ...] | None = None
    """Those to identify from; None for all accelerations, by name or unit, else for all."""
    covariates: Annotated[dict[str, str], Plain] = Field(default_factory=dict)
    """Temperature, load: name of a covariate, with its unit, such as `temperature_c`, and the
    channel whose mean over a window it is. Nothing is identified from these channels."""
    method: Literal["auto", "ambient", "free_decay", "peak", "modes", "recursive"] = "auto"
    """One way to identify the first mode, or `auto` for what the record calls for; or `modes`
    for all of them, with shapes and identities, by stochastic subspaces; or `recursive` for all
    of them from a stream without windows, in bounded memory, with a message each `hop_s`."""
    identifier: PlainText | None = None
    """Installed part of one's own (entry point of `slowtime.identifiers`) that reads windows
    in the place of `method`."""
    identifier_timeout_s: Positive = 30.0
    """How long it may take over a window until it is ended, and the window given up."""
    band_hz: Band | None = None
    """Where to look for modes; None for everywhere."""
    order: Annotated[int, Field(ge=2, le=100)] = 30
    """Highest model order of one band, of `modes`."""
    most: Annotated[int, Field(ge=1, le=64)] = 16
    """Structural modes told of a window, of `modes`; those of most evidence."""
    max_channels: Annotated[int, Field(ge=1, le=4096)] = 64
    """More are not read at once, of `modes`: it bounds memory, and the size of a message."""
    tracking: TrackingSettings = TrackingSettings()
    follow: bool = False
    """Whether to try first what is nearest to the mode of the window before."""
    window_s: Positive = 60.0
    """Window of a continuous stream; an epoch is a window of its own."""
    hop_s: Positive | None = None
    """From one window to the next; None for windows that touch."""
    memory_s: Positive = 1800.0
    """Time in which old samples lose their weight by e, of `recursive`: a message knows as much
    as a window of twice that length."""
    min_samples: Annotated[int, Field(ge=8)] = 64
    max_missing: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Fraction of a window above which it is not read."""
    max_samples: Annotated[int, Field(ge=64)] = 20_000_000
    """Of one window; what an epoch has beyond is left out."""
    smooth: bool = True
    median_window: Annotated[int, Field(ge=1, le=99)] = 5
    ewma_a: Annotated[float, Field(gt=0, le=1)] = 0.3

    @model_validator(mode="after")
    def _has_order(self) -> "ExtractSettings":
        if self.band_hz is not None and self.band_hz[0] >= self.band_hz[1]:
            raise ValueError(
                f"band_hz={self.band_hz} is upside down. Give the lower frequency first."
            )
        if self.band_hz is not None and self.method == "recursive":
            least = FEWEST_CYCLES / self.band_hz[0]
            if self.memory_s < least:
                raise ValueError(
                    f"memory_s={self.memory_s:g} holds fewer than {FEWEST_CYCLES} cycles of "
                    f"{self.band_hz[0]:g} Hz, the lower edge of band_hz. Give at least "
                    f"{least:g} s, or a higher band."
                )
        if self.median_window % 2 == 0:
            raise ValueError(
                f"median_window={self.median_window} has no middle. Give an odd number."
            )
        return self

    @property
    def every_s(self) -> float:
        """From one message of a continuous stream to the next [s]."""
        return self.hop_s or self.window_s

    @property
    def lowest_remembered_hz(self) -> float:
        """Lowest frequency of which the memory of `recursive` holds enough cycles [Hz]."""
        return FEWEST_CYCLES / self.memory_s


class Processing(Immutable):
    """Everything that decides the features of given blocks; travels in `About`."""

    condition: ConditionSettings = ConditionSettings()
    extract: ExtractSettings = ExtractSettings()

    @classmethod
    def from_about(cls, about: About) -> "Processing":
        """Read the settings from an agent's `About`."""
        return cls.model_validate(about.settings["processing"], context=AS_STORED)


class SpoolSettings(Immutable):
    """Where features wait until the twin has them for good."""

    folder: Path = Path("var/spool")
    max_bytes: Annotated[int, Field(ge=65_536)] = 256 * 2**20
    segment_bytes: Annotated[int, Field(ge=4_096)] = 256 * 2**10
    fsync: Literal["never", "segment", "always"] = "always"
    """When the disk is waited for: before each feature is sent, when a segment is full, or
    never. Only the first loses nothing where the power fails; a killed process loses nothing
    either way."""
    keep_acknowledged_s: NotNegative = 0.0
    """How long features stay once the twin has acknowledged them. A recorder that finds the
    router again later than the twin asks the spool for what it has missed: give as long as an
    outage may last, such as 600, where recordings must be whole."""


class PublishSettings(Immutable):
    """Messages that are sent, their intervals, and what is kept for requests."""

    raw: Literal["off", "on"] = "off"
    ring_s: Positive = 60.0
    """Seconds of raw samples kept for those who ask; a diagnosis wants thirty or more."""
    ring_bytes: Annotated[int, Field(ge=1_024)] = 64 * 2**20
    health_every_s: Positive = 1.0
    """Longest time from one health message to the next; a change is sent within a second."""
    about_every_s: Positive = 30.0
    features_every_s: NotNegative = 0.0
    """How long features are gathered into a batch; 0 to send each as it is made. Surprises are
    sent at once, with all that waits."""
    surprise_sd: Positive = 5.0
    """Deviation of a frequency from the median of the last readings that is a surprise, in
    standard deviations of both."""
    send_hours: tuple[Hour, Hour] | None = None
    """Hours of the day (UTC) between which batches are sent, such as 22 and 4; None for any."""
    budget_mb: Positive | None = None
    """Megabytes (10^6) of a calendar month (UTC), both directions and all headers included.
    Batches become longer to keep it, and wait once it is spent."""
    lease_s: Annotated[float, Field(ge=1, le=86_400)] = 5.0
    """Time after which a silent agent is offline; one that ends or is killed is so at once."""
    keep_alives: Annotated[int, Field(ge=2, le=100)] = 4
    """Keep-alives in that time."""
    linger_s: NotNegative = 10.0
    """How long to wait, once the input has ended, for the twin to acknowledge everything."""

    @model_validator(mode="after")
    def _hours_differ(self) -> "PublishSettings":
        if self.send_hours is not None and self.send_hours[0] == self.send_hours[1]:
            raise ValueError(
                f"send_hours={self.send_hours} begin and end at the same hour. Give two "
                "different hours (UTC), or leave them out to send at any."
            )
        return self

    @property
    def budget_bytes(self) -> int | None:
        """Bytes that a month may take."""
        return None if self.budget_mb is None else round(1e6 * self.budget_mb)

    @property
    def keep_alive_s(self) -> float:
        """Time from one keep-alive to the next [s]."""
        return self.lease_s / self.keep_alives

    def of_profile(self, profile: LinkProfile) -> "PublishSettings":
        """Return the settings with the defaults of a profile for all that was not given.

        Examples
        --------
        >>> chosen = PublishSettings(lease_s=60).of_profile("metered")
        >>> chosen.lease_s, chosen.features_every_s
        (60.0, 900.0)
        """
        defaults = {**INTERVALS[profile], **LEASES[profile]._asdict()}
        given = self.model_fields_set
        return self.model_copy(
            update={name: value for name, value in defaults.items() if name not in given}
        )


class VirtualStageSettings(Immutable):
    """Unmeasured quantities, estimated from a model and the accelerations."""

    model: Path
    """Model file; its sensors are named as the channels are, and give their noise. Its
    tolerance is what the model may be wrong by."""
    outputs: Annotated[tuple[Asked, ...], Field(min_length=1, max_length=64)]
    """What is asked for: displacement, drift, force or moment, with a factor for stress."""
    tell_hz: NotNegative = 10.0
    """Values a second of each quantity on the bus; 0 for none, as for fatigue alone."""
    lowest_hz: Positive | None = None
    """Lower edge of the band [Hz]; None for a quarter of the lowest natural frequency."""
    window_s: Positive | None = None
    """Seconds that are worked together; None for 40 periods of the lowest mode."""
    moving_base: bool = False
    """Whether the base moves without being measured."""

    @model_validator(mode="after")
    def _names_differ(self) -> "VirtualStageSettings":
        names = [one.name for one in self.outputs]
        if len(set(names)) < len(names):
            raise ValueError(f"Outputs {names} are not told apart. Give each its own name.")
        return self

    @property
    def estimation(self) -> "VirtualSettings":
        """Settings of the virtual sensor."""
        from slowtime.estimation.virtual import VirtualSettings

        return VirtualSettings(lowest_hz=self.lowest_hz, window_s=self.window_s)


class PointSettings(PointCurve):
    """A point at which stress is counted, and its S-N curve."""

    at: PlainText
    """A virtual output, or a channel that measures stress."""


class FatigueSettings(Immutable):
    """Points at which fatigue is counted, and the interval of its messages."""

    points: Annotated[tuple[PointSettings, ...], Field(max_length=256)] = ()
    every_s: Positive = 60.0
    """From one message to the next; a process that is killed loses at most so much."""

    @model_validator(mode="after")
    def _places_differ(self) -> "FatigueSettings":
        places = [point.at for point in self.points]
        if len(set(places)) < len(places):
            raise ValueError(f"Points {places} name a place twice. Give each place one curve.")
        return self


class EdgeSettings(ProcessSettings):
    """All settings of an edge agent.

    Examples
    --------
    >>> EdgeSettings(site="lab", asset="beam", extract={"band_hz": (1, 9)}).extract.band_hz
    (1.0, 9.0)
    """

    model_config = SettingsConfigDict(env_prefix="SLOWTIME_EDGE_")

    site: Name = "demo"
    asset: Name = "tower"
    boot: BootId | None = None
    """Name of this run; None for the time and a few random letters."""
    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Where the router is; of several, the agent uses one that answers, and another when it
    dies."""
    connect_wait_s: NotNegative = 3.0
    """How long to wait for the router before listening begins. Features are not lost without
    it, since they are asked for again; raw blocks would be."""
    credentials: Path | None = None
    """Folder that `slowtime keys` made for this edge; None to speak in the clear."""
    zenoh: dict[str, Any] = Field(default_factory=dict, repr=False)
    """Further settings of Zenoh, key to value."""
    input: Input = Field(default_factory=SimulatedInput)
    admission: BlockAdmissionSettings = BlockAdmissionSettings()
    condition: ConditionSettings = ConditionSettings()
    extract: ExtractSettings = ExtractSettings()
    virtual: VirtualStageSettings | None = None
    fatigue: FatigueSettings = FatigueSettings()
    spool: SpoolSettings = SpoolSettings()
    publish: PublishSettings = PublishSettings()
    link: LinkProfile = "lab"
    """What the link to the router may cost: it gives `publish` its defaults."""

    @model_validator(mode="after")
    def _keeps_the_mean_of_covariates(self) -> "EdgeSettings":
        if self.extract.covariates and self.condition.highpass_hz is not None:
            raise ValueError(
                "condition.highpass_hz takes the mean off every channel, and the mean is what "
                "extract.covariates are. Leave highpass_hz out: identification needs none."
            )
        return self

    @model_validator(mode="after")
    def _can_keep_its_budget(self) -> "EdgeSettings":
        publishing = self.publishing
        least_mb = LONGEST_MONTH_S * KEEP_ALIVE_BYTES / publishing.keep_alive_s / 1e6
        if publishing.budget_mb is not None and publishing.budget_mb < 2 * least_mb:
            raise ValueError(
                f"publish.budget_mb={publishing.budget_mb:g} is too small: keep-alives every "
                f"{publishing.keep_alive_s:g} s take {least_mb:.3g} MB a month. Give at least "
                f"{2 * least_mb:.3g} MB, or a longer publish.lease_s."
            )
        return self

    @property
    def publishing(self) -> PublishSettings:
        """Settings of publishing, with the defaults of the link's profile."""
        return self.publish.of_profile(self.link)

    @property
    def processing(self) -> Processing:
        """Settings that determine the features."""
        return Processing(condition=self.condition, extract=self.extract)
