"""The modes file that `slowtime identify --out` writes: of a record, or window by window."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field, StringConstraints, model_validator

from slowtime_schemas.messages import Shape
from slowtime_schemas.quantities import Finite, Flags, Frozen, Quantity

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class ModelMode(Frozen):
    """The mode of a model file that is meant."""

    mode: Annotated[int, Field(ge=1, description="Counted from the lowest, which is 1.")]
    frequency_hz: Positive
    difference: Annotated[
        Finite, Field(description="Measured over model, minus 1: of the frequencies.")
    ]
    mac: Annotated[
        float | None,
        Field(
            ge=0, le=1 + 1e-9, description="Likeness of the shapes; null where not comparable."
        ),
    ]


class FoundMode(Frozen):
    """One mode of vibration, or the line of a machine; ± is one standard deviation."""

    frequency_hz: Annotated[
        Quantity, Field(description="Undamped natural frequency, |pole| / (2 pi) [Hz].")
    ]
    damping_ratio: Quantity
    correlation: Annotated[Finite, Field(description="Between the errors of the two.")]
    shape: Annotated[
        Shape | None,
        Field(description="One component a channel of the file; null where none was sought."),
    ]
    kind: Annotated[
        Literal["structural", "harmonic"],
        Field(description="A harmonic is a machine's line, whose damping means nothing."),
    ]
    quality: Annotated[
        float | None,
        Field(ge=0, le=1, description="1 for a mode that is plain to see; null if not judged."),
    ]
    snr_db: Finite | None
    method: Annotated[str, StringConstraints(min_length=1, max_length=32)]
    span_s: Annotated[
        tuple[NotNegative, NotNegative],
        Field(description="Part of the record that it was read from [s from its start]."),
    ]
    flags: Annotated[Flags, Field(description="Words of mistrust.")]
    model: ModelMode | None = None


Modes = tuple[FoundMode, ...]


class Window(Frozen):
    """One window of a record."""

    start_s: NotNegative
    end_s: NotNegative
    modes: Modes
    refused: Annotated[
        str | None, Field(description="Why the window could not be read, where it was not.")
    ] = None


class ModesFile(Frozen):
    """Modes of a record: either `modes` of all of it, or `epochs` of `window_s` each."""

    MESSAGE: ClassVar[str] = "modes_file"
    VERSION: ClassVar[int] = 1

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": ["modes"]}, {"required": ["window_s", "epochs"]}]
        }
    )

    slowtime_modes: Literal[1]
    record: Annotated[str, Field(description="Name of the file that was read.")]
    rate_hz: Positive
    channels: Annotated[
        tuple[str, ...],
        Field(min_length=1, description="Those identified from; the order of components."),
    ]
    duration_s: NotNegative
    start_ns: Annotated[
        int | None,
        Field(description="Time of the first sample [ns since 1970-01-01 UTC], if known."),
    ] = None
    assumptions: Annotated[
        tuple[str, ...],
        Field(description="What was taken for granted in reading the record, a sentence each."),
    ] = ()
    modes: Annotated[Modes | None, Field(description="Of the whole record.")] = None
    window_s: Positive | None = None
    epochs: tuple[Window, ...] | None = None

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> "ModesFile":
        windows = (self.window_s is None, self.epochs is None)
        if windows not in ((True, True), (False, False)) or (self.modes is None) == windows[0]:
            raise ValueError(
                "A file of modes has `modes`, or `window_s` and `epochs`. Give one of the two."
            )
        return self
