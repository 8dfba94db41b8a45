"""Files of readings of a twin → messages as an edge sends them."""

import csv
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from slowtime.identification.single_mode.sliding_windows import dependence
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ASSET_EVENT, FEATURES, parse_key
from slowtime_services.bus import Sample
from slowtime_services.documents.bounds import DATA, DocumentError, document_text
from slowtime_services.documents.document_files import read_json_file
from slowtime_services.files.record import UNDATED_NS
from slowtime_services.replay import contents, read_recording
from twin_server.registration.nominal import Nominal
from twin_server.registration.twin import Registration

SITE, ASSET = "offline", "record"
NEEDED = ("slow_time", "frequency_hz", "frequency_sd")
OPTIONAL = ("damping_ratio", "damping_sd")
OVERLAP_TOLERANCE = 0.01
"""Share of a window that neighbours may have in common by rounding [1]."""

Changes = Literal["stiffness", "mass", "both"]


def registration_of(
    changes: Changes,
    nominal_hz: float | None,
    nominal_damping: float | None,
    learn_epochs: int,
) -> Registration:
    """Make a registration of them."""
    nominal = (
        None
        if nominal_hz is None
        else Nominal(frequency_hz=nominal_hz, damping_ratio=nominal_damping)
    )
    return Registration(changes=changes, nominal=nominal, learn_epochs=learn_epochs)


def samples_of(
    source: Path, asset: str | None, note: Callable[[str], None] | None = None
) -> tuple[str, Iterator[Sample]]:
    """Return features and reported events of a file as bus messages, and their twin.

    Parameters
    ----------
    source
        Recording (.mcap), epochs of `slowtime identify --window-s` (.json), or text with the
        columns of `NEEDED`.
    asset
        Twin of a recording; None where it has one only.
    note
        Told what is assumed.

    Returns
    -------
    Id of the twin, and its messages in order.

    Raises
    ------
    ValueError
        Where the file holds no readings, or lines of it cannot be read; also while the
        messages are taken.
    """
    if source.suffix.lower() == ".mcap":
        return _of_recording(source, asset)
    if asset is not None:
        raise ValueError("--asset goes with an MCAP recording.")
    rows = _of_json(source, note) if source.suffix.lower() == ".json" else _of_text(source)
    return f"{SITE}.{ASSET}", (
        Sample(FEATURES.key(SITE, ASSET), encode(features), None, replayed=True)
        for features in rows
    )


def _of_recording(source: Path, asset: str | None) -> tuple[str, Iterator[Sample]]:
    counts = contents(source, streams=[FEATURES]).counts
    assets = sorted(".".join(parse_key(key)[1:]) for key, count in counts.items() if count)
    if not assets:
        raise ValueError(
            f"{source} holds no features. If it holds raw blocks, run `slowtime identify "
            f"{source} --window-s W --out modes.json` first, and give modes.json."
        )
    if asset is None and len(assets) != 1:
        raise ValueError(f"{source} holds {', '.join(assets)}. Name one with --asset.")
    if asset is not None and asset not in assets:
        raise ValueError(
            f"{source} has no {asset}, but: {', '.join(assets)}. Name one of them with --asset."
        )
    twin_id = asset or assets[0]
    site, _, name = twin_id.partition(".")
    keys = {stream.key(site, name) for stream in (FEATURES, ASSET_EVENT)}
    return twin_id, (
        Sample(message.key, message.payload, message.publish_ns, replayed=True)
        for message in read_recording(source, streams=[FEATURES, ASSET_EVENT])
        if message.key in keys
    )


def _of_json(source: Path, note: Callable[[str], None] | None) -> Iterator[Features]:
    try:
        body = read_json_file(source, DATA)
    except DocumentError as error:
        raise ValueError(
            f"{source} is not a file of modes: {error} Give what `slowtime identify "
            "--window-s W --out` wrote."
        ) from error
    if not isinstance(body, dict) or not isinstance(body.get("epochs"), list):
        whole = isinstance(body, dict) and "modes" in body
        raise ValueError(
            f"{source} has no epochs"
            + (", but the modes of a whole record" if whole else "")
            + ". Run `slowtime identify` with --window-s W, and give what it wrote."
        )
    factors = _dependence(body["epochs"], note)
    for number, (epoch, factor) in enumerate(zip(body["epochs"], factors, strict=True)):
        try:
            yield _of_epoch(number, epoch, factor, body.get("start_ns") or UNDATED_NS)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ValueError(
                f"{source}, epoch {number}: {_fault(error)}. Give what `slowtime identify "
                "--window-s W --out` wrote."
            ) from error


def _dependence(epochs: list[Any], note: Callable[[str], None] | None) -> list[float]:
    """Factor of variance by which each of overlapping windows counts as an independent one."""
    try:
        edges = np.array([(e["start_s"], e["end_s"]) for e in epochs], dtype=float)
    except (KeyError, TypeError, ValueError):
        return [1.0] * len(epochs)  # what is wrong with an epoch is said where it is read
    if not len(edges):
        return []
    factors = dependence(edges[:, 0], edges[:, 1])
    if note is not None and factors.max() > 1 + OVERLAP_TOLERANCE:
        note(
            f"windows overlap: each counts as {1 / float(np.median(factors)):.2g} of an "
            "independent one, and its variance is multiplied accordingly."
        )
    return [float(factor) for factor in factors]


def _of_epoch(number: int, epoch: dict[str, Any], factor: float, start_ns: int) -> Features:
    first = _widened(epoch["modes"][0], factor) if epoch["modes"] else None
    middle_s = 0.5 * (epoch["start_s"] + epoch["end_s"])
    return _features(number, middle_s, first, after_s=middle_s, start_ns=start_ns)


def _widened(mode: dict[str, Any], factor: float) -> dict[str, Any]:
    """Multiply the variances of a mode."""
    wider = {
        name: {"value": mode[name]["value"], "sd": mode[name]["sd"] * math.sqrt(factor)}
        for name in ("frequency_hz", "damping_ratio")
    }
    return mode | wider


def _of_text(source: Path) -> Iterator[Features]:
    try:
        lines = document_text(source, DATA).splitlines()
    except DocumentError as error:
        raise ValueError(str(error)) from error
    header = lines[0] if lines else ""
    table = csv.DictReader(lines, delimiter=max(",;\t", key=header.count))
    missing = sorted({*NEEDED} - {*(table.fieldnames or ())})
    if missing:
        raise ValueError(
            f"{source} lacks the columns {', '.join(missing)}; its first line is "
            f"{header[:80]!r}. Give a header line with {', '.join(NEEDED)} and, where known, "
            f"{', '.join(OPTIONAL)}."
        )
    before = -math.inf
    for number, row in enumerate(table):
        try:
            features = _of_row(number, row)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"{source}, line {table.line_num}: {_fault(error)}. Correct or remove "
                "that line."
            ) from error
        if features.slow_time is not None and features.slow_time <= before:
            raise ValueError(
                f"{source}, line {table.line_num}: slow time goes from {before:g} to "
                f"{features.slow_time:g}. Put the lines in order of slow_time, each once."
            )
        before = features.slow_time if features.slow_time is not None else before
        yield features


def _fault(error: Exception) -> str:
    """Describe the fault of a number in a sentence."""
    if isinstance(error, ValidationError):
        return _first_fault(error)
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)


def _first_fault(error: ValidationError) -> str:
    """Name the value that a message model refuses, and why."""
    one = error.errors(include_url=False)[0]
    place = ".".join(map(str, one["loc"]))
    return f"{place}={one['input']!r}: {one['msg'].removeprefix('Value error, ').rstrip('.')}"


def _number(row: dict[str, str | None], name: str) -> float:
    text = row.get(name)
    if not text:
        raise ValueError(f"{name} is missing")
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} is {text!r}, which is not a number") from None


def _of_row(number: int, row: dict[str, str | None]) -> Features:
    damping = {
        "value": _number(row, "damping_ratio") if row.get("damping_ratio") else 0.0,
        "sd": _number(row, "damping_sd") if row.get("damping_sd") else 0.0,
    }
    mode = {
        "frequency_hz": {
            "value": _number(row, "frequency_hz"),
            "sd": _number(row, "frequency_sd"),
        },
        "damping_ratio": damping,
        "correlation": 0.0,
        "flags": (),
    }
    return _features(number, _number(row, "slow_time"), mode)


def _features(
    number: int,
    slow_time: float,
    mode: dict[str, Any] | None,
    *,
    after_s: float | None = None,
    start_ns: int = UNDATED_NS,
) -> Features:
    """Convert an epoch to the features message of an edge.

    Its sensor time is that many seconds after the beginning; without them it keeps the order.
    """
    modes = (
        ()
        if mode is None
        else (
            Mode(
                frequency_hz=Quantity(**mode["frequency_hz"]),
                damping_ratio=Quantity(**mode["damping_ratio"]),
                correlation=mode["correlation"],
                flags=tuple(mode["flags"]),
            ),
        )
    )
    t_ns = start_ns + round((number if after_s is None else after_s) * 1e9)
    return Features(
        site=SITE,
        asset=ASSET,
        boot="offline",
        sequence=number,
        t_ns=t_ns,
        start_ns=t_ns,
        time_base="recorded",
        slow_time=slow_time,
        slow_time_unit="units" if after_s is None else "s",  # a text file does not state it
        method="peak" if mode else "none",
        modes=modes,
        quality=Quality(samples=0),
    )
