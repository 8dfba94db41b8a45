"""The messages between edge and twin, each with its current version."""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, StringConstraints, model_validator

from .quantities import (
    BootId,
    Count,
    Covariates,
    Estimate,
    Finite,
    Flags,
    Free,
    Frozen,
    Name,
    Nanoseconds,
    PlainText,
    Quantity,
    Sd,
    Sequence,
    UnitName,
)

TimeBase = Literal["live", "recorded", "simulated"]
"""Whose clock `t_ns` is: a device's now, a recording's then, or a simulator's own."""


class Message(Frozen):
    """What every message says of itself."""

    MESSAGE: ClassVar[str]
    VERSION: ClassVar[int]

    version: int
    site: Name
    asset: Name
    boot: BootId
    sequence: Sequence
    t_ns: Nanoseconds

    @property
    def twin_id(self) -> str:
        """The twin this message is about."""
        return f"{self.site}.{self.asset}"


class Smoothed(Frozen):
    """The median → EWMA smoothed frequency, offered beside the measured one, with its delay."""

    value: Finite
    sd: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    lag_epochs: Annotated[float, Field(ge=0, allow_inf_nan=False)]


def _positive(frequency: Quantity) -> Quantity:
    if frequency.value <= 0:
        raise ValueError(f"A frequency of {frequency.value} Hz is not positive.")
    return frequency


Components = Annotated[tuple[Finite, ...], Field(min_length=1, max_length=4096)]

UNIT_NORM_WITHIN = 1e-3
"""Shapes are rounded before they travel; what is farther from unit norm was never scaled."""


class Shape(Frozen):
    """What each channel shows while a mode rings, up to one complex factor.

    Of unit norm, largest component real and positive; one component a channel, in the order
    and the units of the channels.
    """

    re: Components
    im: Components
    sd: Annotated[
        tuple[Sd, ...],
        Field(
            min_length=1,
            max_length=4096,
            description="Of the complex deviation of each component.",
        ),
    ]

    @model_validator(mode="after")
    def _is_one_shape(self) -> "Shape":
        if not len(self.re) == len(self.im) == len(self.sd):
            raise ValueError(
                f"A shape of {len(self.re)} real parts, {len(self.im)} imaginary parts and "
                f"{len(self.sd)} standard deviations. Give one of each per channel."
            )
        norm = math.hypot(*self.re, *self.im)
        if abs(norm - 1.0) > UNIT_NORM_WITHIN:
            raise ValueError(
                f"A shape of norm {norm:.6g}. Divide it by its norm; leave out the shape of a "
                "mode that no channel sees."
            )
        return self


class Mode(Frozen):
    """One identified mode of vibration, or the line of a machine."""

    frequency_hz: Annotated[
        Quantity,
        AfterValidator(_positive),
        Field(description="Undamped natural frequency, |pole| / (2 pi) [Hz]."),
    ]
    damping_ratio: Quantity
    correlation: Annotated[float, Field(ge=-1, le=1)] = 0.0
    smoothed_frequency_hz: Smoothed | None = None
    snr_db: Finite | None = None
    flags: Flags = ()
    identity: Annotated[
        Count | None,
        Field(description="Lasting name within the boot; null for what is nobody's yet."),
    ] = None
    kind: Annotated[
        Literal["structural", "harmonic"],
        Field(description="A harmonic is a machine's line, whose damping means nothing."),
    ] = "structural"
    shape: Shape | None = None


class Quality(Frozen):
    """How good the samples behind a feature were."""

    samples: Count
    missing: Count = 0
    outliers: Count = 0
    flags: Flags = ()


class SensorSamples(Message):
    """Samples that any program may publish for an edge agent with `--source zenoh:`."""

    MESSAGE: ClassVar[str] = "samples"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    rate_hz: Annotated[
        float, Field(gt=0, allow_inf_nan=False, description="Nominal samples per second.")
    ]
    first_index: Annotated[
        Count,
        Field(
            description="Index of the first sample since the device began, counting lost "
            "samples too: by it each loss is noticed."
        ),
    ]
    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=4096)]
    units: Annotated[tuple[UnitName, ...], Field(min_length=1, max_length=4096)]
    samples: Annotated[
        tuple[tuple[Finite | None, ...], ...],
        Field(
            min_length=1,
            max_length=100_000,
            description="One array a sample, one number a channel; null where one is missing.",
        ),
    ]

    @model_validator(mode="after")
    def _is_a_table(self) -> "SensorSamples":
        columns = {len(row) for row in self.samples} | {len(self.units)}
        if columns != {len(self.channels)}:
            raise ValueError(
                f"{len(self.channels)} channels, {len(self.units)} units and samples of "
                f"{sorted(columns)} numbers. Give one of each per channel."
            )
        return self


class Features(Message):
    """What one epoch of samples said about frequencies, damping and shapes."""

    MESSAGE: ClassVar[str] = "features"
    VERSION: ClassVar[int] = 3

    version: Literal[3] = 3
    time_base: TimeBase = "live"
    slow_time: Finite
    slow_time_unit: UnitName = "s"
    start_ns: Nanoseconds
    method: Literal["free_decay", "ambient", "peak", "ssi", "none"]
    channels: Annotated[
        tuple[str, ...],
        Field(max_length=4096, description="Whose components the shapes hold, in order."),
    ] = ()
    units: Annotated[
        tuple[str, ...],
        Field(
            max_length=4096,
            description="Of the channels, in order, such as m/s^2; an empty text where nobody "
            "said one, and none at all where the agent does not tell units.",
        ),
    ] = ()
    modes: Annotated[
        tuple[Mode, ...], Field(max_length=64, description="Ascending in frequency.")
    ]
    quality: Quality
    covariates: Covariates = Field(default_factory=dict)
    truth: Covariates | None = None

    @model_validator(mode="after")
    def _is_ordered(self) -> "Features":
        if self.start_ns > self.t_ns:
            raise ValueError(
                f"start_ns={self.start_ns} is later than t_ns={self.t_ns}. start_ns is the "
                "first sample's time, t_ns the last's."
            )
        if len(self.modes) > 1:
            frequencies = [mode.frequency_hz.value for mode in self.modes]
            if frequencies != sorted(frequencies):
                raise ValueError(
                    f"Modes at {frequencies} Hz are not in order. Give them ascending."
                )
        return self

    @model_validator(mode="after")
    def _has_one_shape_and_name_each(self) -> "Features":
        sizes = {len(mode.shape.re) for mode in self.modes if mode.shape is not None}
        if sizes - {len(self.channels)}:
            raise ValueError(
                f"Shapes of {sorted(sizes)} components for {len(self.channels)} channels. "
                "Give one component per channel."
            )
        if len(self.units) not in (0, len(self.channels)):
            raise ValueError(
                f"{len(self.units)} units for {len(self.channels)} channels. Give one unit "
                "per channel, or none at all."
            )
        names = [mode.identity for mode in self.modes if mode.identity is not None]
        if len(set(names)) < len(names):
            raise ValueError(
                f"Identities {names} name more than one mode alike. Give each its own, or null."
            )
        return self


ACK_VERSION = "ack_version"
"""Counter of `Health`: newest version of `Acknowledgement` the agent reads; 1 if absent."""

FOREIGN_ACKS = "foreign_acks"
"""Counter of `Health`: acknowledgements of readings that another agent must have made."""


class Health(Message):
    """How an edge agent is doing; also the tail of its account (`last_sequence`)."""

    MESSAGE: ClassVar[str] = "health"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    last_sequence: Annotated[
        int,
        Field(
            ge=-1,
            lt=2**63,
            description="Newest features sequence of this boot; -1 before the first.",
        ),
    ]
    first_held: Annotated[
        int,
        Field(
            ge=-1,
            lt=2**63,
            description="Oldest features sequence of this boot still in the spool; -1 if none.",
        ),
    ]
    dropped: Annotated[
        int, Field(ge=0, lt=2**63, description="Features the full spool has dropped unsent.")
    ] = 0
    uptime_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    counters: dict[str, Count] = Field(default_factory=dict)


class About(Message):
    """What an edge agent is: its software and the settings that decide its features."""

    MESSAGE: ClassVar[str] = "about"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    software: str
    settings: Free


class Acknowledgement(Message):
    """The twin's word that features are durable, up to and including `sequence` of `boot`.

    An agent whose own features from `first` to `sequence` have another digest deletes nothing:
    another agent sends under its name.
    """

    MESSAGE: ClassVar[str] = "ack"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    first: Annotated[
        Sequence | None,
        Field(description="From where on `digest` counts; null where there is none."),
    ] = None
    digest: Annotated[
        Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{16}$")] | None,
        Field(
            description="Sum modulo 2^64, in hexadecimal, of the digests of the features from "
            "`first` to `sequence`: BLAKE2b of 8 bytes of each payload, little-endian, keyed "
            "with its sequence as 8 bytes, little-endian."
        ),
    ] = None


class CurveOfMessage(Frozen):
    """A median S-N curve in ranges: life = constant × range^(-slope), or two slopes."""

    constant: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    slope: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    knee: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    lower_slope: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    cut_off: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    log10_sd: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0


NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class FatiguePoint(Frozen):
    """Fatigue at one point since the boot began: sums, of which the newest counts."""

    name: PlainText
    unit: UnitName
    source: Literal["channel", "virtual"] = "channel"
    bins: Annotated[
        tuple[int, ...],
        Field(
            max_length=4096,
            description="Number k of each bin of stress ranges, ascending: from 2^(k/16) to "
            "2^((k+1)/16) in the unit.",
        ),
    ] = ()
    half_cycles: Annotated[
        tuple[Count, ...],
        Field(max_length=4096, description="Half cycles counted in each bin."),
    ] = ()
    damage: Annotated[
        NotNegative,
        Field(description="Miner's sum by the median curve [1], open half cycles included."),
    ]
    closed_damage: Annotated[
        NotNegative, Field(description="Of it, what cycles have done that are closed [1].")
    ]
    ln_sd: Annotated[
        NotNegative, Field(description="Standard deviation of the logarithm of the sum [1].")
    ]
    slope: Annotated[NotNegative, Field(description="Slope of the curve that weighs [1].")]
    curve: CurveOfMessage
    seconds: Annotated[NotNegative, Field(description="How long stress was counted [s].")]
    skipped: Annotated[Count, Field(description="Samples that were not finite.")] = 0
    reasons: Flags = ()

    @model_validator(mode="after")
    def _is_one_histogram(self) -> "FatiguePoint":
        if len(self.bins) != len(self.half_cycles) or list(self.bins) != sorted(set(self.bins)):
            raise ValueError(
                f"{len(self.bins)} bins and {len(self.half_cycles)} counts. Give one count for "
                "each bin, bins ascending."
            )
        return self


class Fatigue(Message):
    """Fatigue at all points of an asset, as of `t_ns`, since the boot began."""

    MESSAGE: ClassVar[str] = "fatigue"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    time_base: TimeBase = "live"
    start_ns: Annotated[Nanoseconds, Field(description="Sensor time of the first sample.")]
    points: Annotated[tuple[FatiguePoint, ...], Field(min_length=1, max_length=256)]

    @model_validator(mode="after")
    def _names_differ(self) -> "Fatigue":
        names = [point.name for point in self.points]
        if len(set(names)) < len(names):
            raise ValueError(f"Points {names} are not told apart. Give each its own name.")
        return self


class VirtualQuantity(Frozen):
    """A quantity that nobody measures, over the time of its message."""

    name: PlainText
    unit: UnitName
    values: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=10_000)]
    sd: Annotated[
        tuple[Sd, ...],
        Field(min_length=1, max_length=10_000, description="Of the error of each value."),
    ]

    @model_validator(mode="after")
    def _has_deviations(self) -> "VirtualQuantity":
        if len(self.values) != len(self.sd):
            raise ValueError(
                f"{self.name}: {len(self.values)} values and {len(self.sd)} deviations. "
                "Give one of each."
            )
        return self


class Virtual(Message):
    """What virtual sensors estimate of one window: dynamic parts, within a band."""

    MESSAGE: ClassVar[str] = "virtual"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    time_base: TimeBase = "live"
    start_ns: Nanoseconds
    rate_hz: Annotated[float, Field(gt=0, allow_inf_nan=False, description="Of the values.")]
    lowest_hz: Annotated[
        NotNegative,
        Field(description="Slower motion is not in the values: accelerations do not show it."),
    ]
    valid: bool
    reasons: Flags = ()
    quantities: Annotated[tuple[VirtualQuantity, ...], Field(min_length=1, max_length=64)]


class SeenMode(Frozen):
    """One mode as the twin took it in."""

    identity: Annotated[
        Count | None,
        Field(description="Lasting name within the boot; null for what is nobody's yet."),
    ] = None
    model_mode: Annotated[
        Count | None,
        Field(description="Which mode of the twin's model it is, 0 for the lowest."),
    ] = None
    frequency_hz: Estimate
    damping_ratio: Estimate | None
    kind: Literal["structural", "harmonic"] = "structural"
    shape: Shape | None = None


class TwinState(Message):
    """What the twin knows after one features message."""

    MESSAGE: ClassVar[str] = "state"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    id: str
    slow_time: Finite
    slow_time_unit: UnitName = "s"
    frequency_hz: Estimate | None
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    correlation: Annotated[
        float,
        Field(ge=-1, le=1, description="Between the errors of stiffness and mass change."),
    ] = 0.0
    assumed: Flags = ()
    frequency_used: Literal["measured", "smoothed"] = "measured"
    valid: bool
    reasons: Flags = ()
    truth: Covariates | None = None
    elements: Annotated[
        dict[str, Estimate],
        Field(
            max_length=4096,
            description="Relative change of each free stiffness, by element, and of each free "
            "mass, by node and `.mass`; -0.1 once a tenth is gone.",
        ),
    ] = Field(default_factory=dict)
    posterior_to_prior: Annotated[
        dict[str, Finite],
        Field(
            max_length=4096,
            description="Of each of `elements`: 1 where the readings said nothing, 0 if sure.",
        ),
    ] = Field(default_factory=dict)
    suspects: Annotated[
        Flags,
        Field(description="What has changed: 'j2'; 'j1 or j4' where the readings cannot tell."),
    ] = ()
    channels: Annotated[
        tuple[str, ...],
        Field(max_length=4096, description="Whose components the shapes hold, in order."),
    ] = ()
    modes: Annotated[tuple[SeenMode, ...], Field(max_length=64)] = ()


class Registered(Message):
    """What a twin was told of its structure; with the features, it makes the history anew."""

    MESSAGE: ClassVar[str] = "registration"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    id: str
    registration: Free


class Event(Message):
    """Something a person may want to know of, once."""

    MESSAGE: ClassVar[str] = "event"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    kind: Annotated[str, StringConstraints(min_length=1, max_length=64)]
    severity: Literal["info", "warning", "alarm"]
    slow_time: Finite | None = None
    message: str
    details: Free = Field(default_factory=dict)


Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class Accepted(Frozen):
    """Entries of an asset's ledger in a row: features of one boot, or anything else."""

    kind: Annotated[
        Literal["f", "r", "a", "v", "e", "d"],
        Field(
            description="f features; r a registration; a an acknowledgement; v an event of the "
            "asset; e estimated anew; d deleted."
        ),
    ]
    boot: str = ""
    number: Annotated[int, Field(ge=0, description="Of the boot, as the server counts.")] = 0
    first: Annotated[int, Field(ge=0, description="Sequence, of features.")] = 0
    last: Annotated[int, Field(ge=0)] = 0
    key: Annotated[int, Field(ge=0, description="Of anything else.")] = 0
    digest: Sha256 | None = None


class Branch(Frozen):
    """What a hash is hashed with next, and on which side that stands."""

    side: Literal["left", "right"]
    hash: Sha256


class SignedHead(Frozen):
    """A signed hash over the ledgers of all assets of a server."""

    number: Annotated[int, Field(ge=1)]
    t_ns: int
    assets: Annotated[int, Field(ge=0, description="Leaves of the tree.")]
    root: Annotated[Sha256, Field(description="Of the Merkle tree over them (RFC 6962).")]
    previous: Annotated[Sha256, Field(description="Of the head before; zeros for the first.")]
    public: Annotated[str, Field(description="Ed25519 public key, base64.")]
    signature: Annotated[str, Field(description="Of number to public, base64.")]


class LedgerUpdate(Message):
    """Rows that the twin server accepted for an asset, with a signed head that covers them."""

    MESSAGE: ClassVar[str] = "ledger"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    count: Annotated[int, Field(ge=0, description="Entries of the asset's chain.")]
    link: Annotated[Sha256, Field(description="Hash of all of them in their order.")]
    history_count: Annotated[int, Field(ge=0)]
    history: Annotated[Sha256, Field(description="Of so many features with their states.")]
    accepted_after: Annotated[
        int, Field(ge=0, description="How many entries there were before those of `accepted`.")
    ]
    accepted: tuple[Accepted, ...] = ()
    proof: Annotated[
        tuple[Branch, ...],
        Field(description="What the asset's leaf is hashed with, up to the root of `head`."),
    ] = ()
    head: SignedHead
