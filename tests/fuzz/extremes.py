"""Valid messages that are meant to harm: each number at its bounds, each list at its longest.

They are generated from the schemas of the messages, so that a field that is added is among
them. A field at a time takes each extreme value, then several at once; what depends on
another field is made to fit, so that most of the messages are let in.
"""

import itertools
import json
import random
from collections.abc import Callable, Iterator
from typing import Any

from slowtime_schemas.codec import Refused, decode
from slowtime_schemas.streams import (
    FATIGUE,
    FEATURES,
    HEALTH,
    VIRTUAL,
    Stream,
)

KINDS = (FEATURES, HEALTH, FATIGUE, VIRTUAL)
"""Streams of an edge agent that a twin server takes in."""

FAR = (2**31, 2**32 - 1, 2**39, 2**40 - 1, 2**40, 2**62, 2**63 - 1, 2**63, 2**64)
"""Whole numbers at which a width or a bound of something ends."""
LARGE = (1e-308, 1e9, 1e18, 1.7e308, -1.7e308)
LONGEST = 4_096
"""Entries of a list or an object for which the schema has no bound, and names' characters."""

SHORT = 2_000
"""Characters of a value that is combined with others; the longest ones come alone."""

Path = tuple[str | int, ...]


def base(
    stream: Stream, now_ns: int, *, asset: str, boot: str, sequence: int
) -> dict[str, Any]:
    """Return an ordinary message."""
    head: dict[str, Any] = {
        "version": stream.message.VERSION if stream.message else 1,
        "site": "lab", "asset": asset, "boot": boot, "sequence": sequence, "t_ns": now_ns,
    }  # fmt: skip
    mode = {
        "frequency_hz": {"value": 3.0, "sd": 0.002},
        "damping_ratio": {"value": 0.02, "sd": 0.001},
        "correlation": 0.0, "snr_db": 20.0, "flags": ["weak"], "identity": 1,
        "smoothed_frequency_hz": {"value": 3.0, "sd": 0.002, "lag_epochs": 2.0},
        "shape": {"re": [1.0], "im": [0.0], "sd": [0.01]},
    }  # fmt: skip
    curve = {"constant": 1e12, "slope": 3.0, "knee": 1.0, "lower_slope": 5.0, "cut_off": 0.0}
    point = {
        "name": "weld", "unit": "MPa", "bins": [1, 2], "half_cycles": [3, 4], "damage": 0.1,
        "closed_damage": 0.1, "ln_sd": 0.2, "slope": 3.0, "curve": curve, "seconds": 9.0,
    }  # fmt: skip
    own: dict[str, dict[str, Any]] = {
        FEATURES.name: {
            "time_base": "live", "slow_time": float(sequence), "start_ns": now_ns,
            "method": "ssi", "channels": ["a"], "units": ["m/s^2"], "modes": [mode],
            "quality": {"samples": 1000, "missing": 0, "outliers": 0, "flags": ["gap"]},
            "covariates": {"temperature_c": 9.0}, "truth": {"stiffness_change": 0.0},
        },
        HEALTH.name: {
            "last_sequence": sequence, "first_held": 0, "dropped": 0, "uptime_s": 9.0,
            "counters": {"sensor_silent_s": 0, "samples_lost": 1, "foreign_acks": 0},
        },
        FATIGUE.name: {"start_ns": now_ns, "points": [point]},
        VIRTUAL.name: {
            "start_ns": now_ns, "rate_hz": 10.0, "lowest_hz": 0.1, "valid": True,
            "quantities": [{"name": "force", "unit": "N", "values": [1.0], "sd": [0.1]}],
        },
    }  # fmt: skip
    return head | own[stream.name]


def leaves(schema: dict[str, Any], content: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Yield each field of a message with its schema, those within fields too."""
    definitions = schema.get("$defs", {})

    def within(node: dict[str, Any], part: Any, path: Path) -> Iterator[tuple[Path, Any]]:
        if "$ref" in node:
            node = definitions[node["$ref"].rpartition("/")[2]] | {
                name: value for name, value in node.items() if name != "$ref"
            }
        if "anyOf" in node:
            node = next(one for one in node["anyOf"] if one.get("type") != "null")
            yield from within(node, part, path)
            return
        yield path, node
        if isinstance(part, dict):
            more = node.get("additionalProperties")
            for name, value in part.items():
                below = node.get("properties", {}).get(name, more)
                if isinstance(below, dict):
                    yield from within(below, value, (*path, name))
        elif isinstance(part, list) and part:
            yield from within(node["items"], part[0], (*path, 0))

    yield from within(schema, content, path)


def extremes(node: dict[str, Any], part: Any) -> list[Any]:
    """List the values that are worth a try for a field: at its bounds, and beyond them."""
    kind = node.get("type")
    if "const" in node or "enum" in node:
        return list(node.get("enum", ()))
    if kind in ("integer", "number"):
        bounds = [
            node[name]
            for name in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
            if name in node
        ]
        near = [bound + step for bound in bounds for step in (-1, 0, 1)]
        whole = [0, 1, -1, *near, *FAR]
        return whole if kind == "integer" else [float(v) for v in whole] + list(LARGE)
    if kind == "string":
        longest = node.get("maxLength", 63 if "pattern" in node else LONGEST)
        return ["", "a", "a" * longest, "a" * (longest + 1)]
    if kind == "array":
        longest = node.get("maxItems", LONGEST)
        first = part[:1]
        return [[], first, first * longest, first * (longest + 1)]
    if kind == "object" and "properties" not in node:
        longest = node.get("maxProperties", LONGEST)
        value = next(iter(part.values()), 0)
        return [{}, *({f"k{n}": value for n in range(m)} for m in (longest, longest + 1))]
    return []


def fitted(content: dict[str, Any]) -> dict[str, Any]:
    """Make fields agree that depend on each other."""
    if content.get("start_ns", 0) > content["t_ns"]:
        content["start_ns"] = content["t_ns"]
    channels = content.get("channels", [])
    if len(content.get("units", ())) not in (0, len(channels)):
        content["units"] = []
    for number, mode in enumerate(content.get("modes", ())):
        shape = mode.get("shape")
        if shape is not None and len(channels):
            rest = [0.0] * (len(channels) - 1)
            mode["shape"] = {"re": [1.0, *rest], "im": [0.0, *rest], "sd": [0.01, *rest]}
        elif shape is not None:
            mode["shape"] = None
        if number:
            mode["identity"] = None
    content.get("modes", []).sort(key=lambda mode: mode["frequency_hz"]["value"])
    for number, point in enumerate(content.get("points", ())):
        point["name"] = f"{point['name']}{number or ''}"
        longest = max(len(point["bins"]), len(point["half_cycles"]))
        first = point["bins"][0] if len(point["bins"]) == 1 else -longest // 2
        point["bins"] = [first + n for n in range(longest)]
        point["half_cycles"] = (point["half_cycles"] or [1]) * longest
        del point["half_cycles"][longest:]
    for quantity in content.get("quantities", ()):
        longest = max(len(quantity["values"]), len(quantity["sd"]))
        for name in ("values", "sd"):
            quantity[name] = ((quantity[name] or [1.0]) * longest)[:longest]
    return content


def changed(content: dict[str, Any], path: Path, value: Any) -> dict[str, Any]:
    """Copy a message with one field changed."""
    copy: dict[str, Any] = json.loads(json.dumps(content))
    part: Any = copy
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = value
    return copy


Origin = Callable[[int], dict[str, Any]]
"""Makes an ordinary message, given how many came before it."""


def candidates(stream: Stream, ordinary: Origin, seed: int) -> Iterator[bytes]:
    """Yield messages without end: each field at each extreme, then some of them together."""
    assert stream.message is not None
    schema = stream.message.model_json_schema()
    start = ordinary(0)
    choices = [
        (path, value)
        for path, node in leaves(schema, start)
        if path and path not in (("site",), ("asset",), ("version",))
        for value in extremes(node, _part(start, path))
    ]
    rng = random.Random(seed)
    short = [one for one in choices if len(json.dumps(one[1])) < SHORT]
    numbers = itertools.count()
    for path, value in choices:
        yield _encoded(changed(ordinary(next(numbers)), path, value))
    while True:
        content = ordinary(next(numbers))
        for path, value in rng.sample(short, rng.randint(1, 3)):
            try:
                content = changed(content, path, value)
            except (IndexError, KeyError, TypeError):  # another change has emptied it
                continue
        yield _encoded(content)


def let_in(stream: Stream, ordinary: Origin, count: int, seed: int = 1) -> list[bytes]:
    """So many extreme messages that the schema allows."""
    found: list[bytes] = []
    for payload in candidates(stream, ordinary, seed):
        try:
            decode(stream, payload)
        except Refused:
            continue
        found.append(payload)
        if len(found) == count:
            break
    return found


def _part(content: Any, path: Path) -> Any:
    for step in path:
        content = content[step]
    return content


def _encoded(content: dict[str, Any]) -> bytes:
    try:
        content = fitted(content)
    except (TypeError, KeyError, IndexError):
        pass  # it does not fit, and is refused
    return json.dumps(content, separators=(",", ":")).encode()
