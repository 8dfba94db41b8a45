"""Constants on inputs and sensors that differ from record to record, as an encoder's zero."""

from typing import Any

from slowtime.dynamics.effects.kind import Kind, Parameter, RecordOffset


def pushed(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of an input beyond the recorded one.

    `z`: constant of the record, over that of all records, `p` [N].
    """
    return float(p[0] + z[0])


def none(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Give no force, and no change of a constant."""
    return 0.0


def _kind(name: str, title: str, family: str, force: Any, parameter: Parameter) -> Kind:
    of_input = family == "input"
    return Kind(
        name=name,
        title=title,
        family=family,
        where="input" if of_input else "sensor",
        parameters=(parameter,),
        equation="input + b of the record" if of_input else "reading = true + b of the record",
        source="",
        sentence="Each record has a constant of its own, as an encoder has that is set to zero "
        "wherever it stands.",
        action=RecordOffset(force=force, rates=(none,)),
    )


KINDS = (
    _kind(
        "input_bias_by_record",
        "Input off by another constant in each record",
        "input",
        pushed,
        Parameter(
            name="bias", unit="", default=0.0, fitted=False,
            meaning="constant where a record has none of its own, SI units",
        ),
    ),
    _kind(
        "sensor_bias_by_record",
        "Sensor off by another constant in each record",
        "sensor",
        none,
        Parameter(
            name="bias", unit="unit of the sensor", default=0.0, fitted=False,
            meaning="constant where a record has none of its own",
        ),
    ),
)  # fmt: skip
