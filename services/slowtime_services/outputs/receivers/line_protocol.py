"""Points as lines of the line protocol of InfluxDB, with stamps in nanoseconds.

References
----------
InfluxData, "Line protocol": measurement, tags and keys are escaped by backslashes, texts stand
in quotation marks, whole numbers end with i.
"""

import math
from collections.abc import Iterator, Mapping

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import State
from slowtime_schemas.quantities import Estimate
from slowtime_services.outputs.batch import Batch

Field = float | int | bool | str

LONGEST_TEXT = 64_000
"""Bytes of a text; InfluxDB takes 64 KiB."""


def lines_of(batch: Batch) -> Iterator[str]:
    """Yield the lines of a batch.

    Measurements are ``slowtime_state``, ``slowtime_element``, ``slowtime_mode`` and
    ``slowtime_event``. A line that is sent twice is one point, by its tags and its stamp.
    """
    asset = {"site": batch.site, "asset": batch.asset}
    for state in batch.states:
        yield from _lines_of_state(asset, state)
    for event in batch.events:
        yield _line_of_event(asset, event)


def _lines_of_state(asset: Mapping[str, str], state: State) -> Iterator[str]:
    plain: dict[str, Field] = {
        "slow_time": float(state.slow_time),
        "valid": state.valid,
        "boot": state.boot,
        "sequence": state.sequence,
    }
    for name in ("frequency_hz", "damping_ratio", "stiffness_change", "mass_change"):
        plain |= _fields(name, getattr(state, name))
    yield line("slowtime_state", asset, plain, state.t_ns)
    for element, change in state.elements.items():
        yield line(
            "slowtime_element", {**asset, "element": element}, _fields("change", change),
            state.t_ns,
        )  # fmt: skip
    for mode in state.modes:
        if mode.model_mode is not None:
            fields = _fields("frequency_hz", mode.frequency_hz)
            fields |= _fields("damping_ratio", mode.damping_ratio)
            tags = {**asset, "mode": str(mode.model_mode)}
            yield line("slowtime_mode", tags, fields, state.t_ns)


def _line_of_event(asset: Mapping[str, str], event: EventModel) -> str:
    # Two events of a reading have the same stamp, and are told apart by a tag only.
    tags = {**asset, "kind": event.kind, "severity": event.severity, "event": event.event_id}
    fields: dict[str, Field] = {"count": 1, "message": event.message}
    if event.slow_time is not None:
        fields["slow_time"] = float(event.slow_time)
    return line("slowtime_event", tags, fields, event.t_ns)


def _fields(name: str, estimate: Estimate | None) -> dict[str, Field]:
    if estimate is None:
        return {}
    return {
        name: float(estimate.value),
        f"{name}_sd": float(estimate.sd),
        f"{name}_lo": float(estimate.lo),
        f"{name}_hi": float(estimate.hi),
    }


def line(
    measurement: str, tags: Mapping[str, str], fields: Mapping[str, Field], t_ns: int
) -> str:
    r"""Write one point.

    Parameters
    ----------
    fields
        Numbers that are not finite are left out: the protocol has none.
    t_ns
        Sensor time [ns since 1970-01-01 UTC].

    Examples
    --------
    >>> line("m", {"site": "a b"}, {"x": 1.5, "n": 2, "ok": True, "say": 'it "is"'}, 12)
    'm,site=a\\ b x=1.5,n=2i,ok=true,say="it \\"is\\"" 12'
    """
    named = "".join(f",{_key(k)}={_key(v)}" for k, v in sorted(tags.items()) if v)
    valued = ",".join(
        f"{_key(name)}={_value(value)}"
        for name, value in fields.items()
        if not isinstance(value, float) or math.isfinite(value)
    )
    return f"{_measurement(measurement)}{named} {valued} {t_ns}"


def _measurement(name: str) -> str:
    return _one_line(name).replace(",", r"\,").replace(" ", r"\ ")


def _key(name: str) -> str:
    # A backslash at the end would escape the separator behind it.
    return _measurement(name.rstrip("\\") or "_").replace("=", r"\=")


def _value(value: Field) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return f"{value}i"
    if isinstance(value, float):
        return repr(value)
    cut = _one_line(value).encode()[:LONGEST_TEXT].decode(errors="ignore")
    quoted = cut.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{quoted}"'


def _one_line(text: str) -> str:
    return " ".join(text.splitlines())
