"""Selects the channels of a block: vibration, temperature, load."""

import math

from edge_agent.settings import ExtractSettings
from slowtime.signals.block import Block
from slowtime_services.files.record import accelerations, find_column

from .windows import Rows


def columns_of(settings: ExtractSettings, block: Block) -> tuple[list[int], tuple[str, ...]]:
    """Return places and names of the channels to identify from."""
    chosen = settings.channels or _vibrating(settings, block)
    columns = [find_column(name, block.channels) for name in chosen]
    return columns, tuple(block.channels[column] for column in columns)


def covariate_means(settings: ExtractSettings, rows: Rows, block: Block) -> dict[str, float]:
    """Return means of the temperature and load channels that are present."""
    found: dict[str, float] = {}
    for name, channel in settings.covariates.items():
        if channel in block.channels and len(rows):
            mean = float(rows[:, block.channels.index(channel)].mean())
            found |= {name: mean} if math.isfinite(mean) else {}
    return found


def units_of(channels: tuple[str, ...], block: Block) -> tuple[str, ...]:
    """Return the units of some channels of a block, in their order."""
    unit = dict(zip(block.channels, block.units, strict=True))
    return tuple(unit[name] for name in channels)


def _vibrating(settings: ExtractSettings, block: Block) -> tuple[str, ...]:
    """Channels to identify from, if the settings name none."""
    taken = settings.covariates.values()
    rest = [
        (name, unit)
        for name, unit in zip(block.channels, block.units, strict=True)
        if name not in taken
    ]
    names, units = zip(*rest, strict=True) if rest else ((), ())
    return accelerations(names, units)
