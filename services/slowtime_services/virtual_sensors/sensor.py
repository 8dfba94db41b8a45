"""A model file and requested quantities → a virtual sensor.

Edge agent and command line share this. Without PyYAML, as on a light edge, a model file may be
JSON, which YAML contains.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from slowtime.dynamics.description import Description
from slowtime.dynamics.units import unit_factor
from slowtime.estimation.virtual import VirtualSensor, VirtualSettings
from slowtime_schemas.files.model import ModelFile
from slowtime_services.descriptions import description_of
from slowtime_services.documents.document_files import read_json_file

from .settings import Asked


def read_structure(path: Path) -> Description:
    """Read a model file; JSON without PyYAML.

    Raises
    ------
    ValueError
        Saying what is wrong with it, or what to install.
    """
    try:
        from slowtime_services.models import read_description
    except ImportError as error:
        if path.suffix != ".json":
            raise ValueError(
                f"{path.name} is YAML, and {error.name} is not installed. Install "
                "slowtime[analysis], or write the model as JSON and name it .json."
            ) from None
        try:
            return description_of(ModelFile.model_validate(read_json_file(path)))
        except ValidationError as wrong:
            raise ValueError(f"{path.name}: {wrong.errors()[0]['msg']}") from None
    return read_description(path)


def make_sensor(
    description: Description,
    present: Iterable[str],
    asked: Sequence[Asked],
    rate_hz: float,
    settings: VirtualSettings | None = None,
    *,
    moving_base: bool = False,
) -> tuple[VirtualSensor, tuple[str, ...]]:
    """Make a virtual sensor of a model for the channels that are there.

    Parameters
    ----------
    present
        Channels of the samples.

    Returns
    -------
    The sensor, and the channels that it listens to, in order.

    Raises
    ------
    ValueError
        Where none of the model's accelerations is among the channels.
    """
    present = tuple(present)
    known = [s.channel for s in description.sensors if s.quantity == "acceleration"]
    known += [e.channel for e in description.inputs if e.kind in ("force", "base_acceleration")]
    channels = tuple(channel for channel in known if channel in present)
    if not channels:
        raise ValueError(
            f"The samples have channels {', '.join(present)}; the model listens to "
            f"{', '.join(known) or 'none'}. Name the model's sensors as the channels are named."
        )
    outputs = [one.output() for one in asked]
    sensor = VirtualSensor(
        description, channels, outputs, rate_hz, settings, moving_base=moving_base
    )
    return sensor, channels


def si_factors(
    description: Description, channels: Sequence[str], units: Sequence[str]
) -> list[float]:
    """Return the factor of each channel from its unit to SI.

    Parameters
    ----------
    units
        Of the samples; where one is unknown or empty, the model's holds.
    """
    spoken: dict[str, tuple[Any, str]] = {
        sensor.channel: (sensor.quantity, sensor.unit) for sensor in description.sensors
    }
    for entry in description.inputs:
        quantity = entry.quantity
        spoken[entry.channel] = (quantity, entry.unit)
    factors = []
    for channel, unit in zip(channels, units, strict=True):
        quantity, otherwise = spoken[channel]
        try:
            factors.append(unit_factor(unit, quantity, description.unit_of_coordinate))
        except ValueError:
            factors.append(unit_factor(otherwise, quantity, description.unit_of_coordinate))
    return factors
