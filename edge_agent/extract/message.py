"""Makes the features message of a span of samples."""

from typing import NamedTuple

from edge_agent.settings import ExtractSettings, Origin
from slowtime.signals.block import Block
from slowtime_schemas.messages import Features, Quality

from .channels import covariate_means, units_of
from .reader import ModeReading
from .windows import Rows


class Extent(NamedTuple):
    """The samples that a message is about.

    Parameters
    ----------
    block
        The last of them that came.
    rows
        Samples, or such as have the same means.
    start_ns, last_ns
        Sensor time of the first and of the last one.
    samples, missing, outliers
        How many there are, and how many of them were missing or outliers.
    flags
        What is to be said of the span itself.
    """

    block: Block
    rows: Rows
    start_ns: int
    last_ns: int
    samples: int
    missing: int
    outliers: int
    flags: tuple[str, ...]


def message_of(
    settings: ExtractSettings, origin: Origin, sequence: int, span: Extent, reading: ModeReading
) -> Features:
    """Make the message of one span."""
    block, flags = span.block, span.flags
    covariates = covariate_means(settings, span.rows, block)
    if settings.covariates.keys() - covariates:
        flags += ("no_covariate",)
    slow_time = block.slow_time
    return Features(
        **origin.model_dump(),
        sequence=sequence,
        t_ns=span.last_ns,
        slow_time=(span.start_ns + span.last_ns) / 2e9 if slow_time is None else slow_time,
        start_ns=span.start_ns,
        method=reading.method,
        channels=reading.channels,
        units=units_of(reading.channels, block),
        modes=reading.modes,
        quality=Quality(
            samples=span.samples,
            missing=span.missing,
            outliers=span.outliers,
            flags=flags + reading.why + reading.doubts,
        ),
        covariates={**block.covariates, **covariates},
        truth=dict(block.truth) or None,
    )
