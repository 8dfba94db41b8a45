"""Write one recording in the ways of many loggers: bytes of a file, and what is true of it.

Nothing here is shared with what reads the files: stamps are written by `datetime` and
`strftime`, numbers by formatting, so that an error of the reader has no twin.
"""

import dataclasses
import datetime
import random
from collections.abc import Callable, Sequence

import numpy as np

START = datetime.datetime(2024, 4, 21, 15, 0, 0, tzinfo=datetime.UTC)
START_NS = 1_713_711_600_000_000_000


@dataclasses.dataclass(frozen=True)
class Case:
    """A file, and the right answer.

    `start_ns` is None where the file does not tell it; `loose` is the relative error of the
    rate that the file's digits allow; `asked` says that only a person can know. Samples are in
    `units`, none where the file says none.
    """

    name: str
    content: bytes
    rate_hz: float
    channels: tuple[str, ...]
    samples: np.ndarray
    start_ns: int | None = None
    loose: float = 1e-4
    asked: bool = False
    suffix: str = ".csv"
    gaps: int = 0
    units: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Clock:
    """How a logger writes time: a column for each header, a text for each instant."""

    header: tuple[str, ...]
    unit: tuple[str, ...]
    write: Callable[[float], tuple[str, ...]]
    dated: bool = False
    loose: float = 1e-4
    rates: tuple[float, ...] = (50.0, 100.0, 200.0, 250.0)
    decimal: bool = True
    """Whether the decimal mark of the file is used in it."""


def _when(seconds: float, zone: datetime.tzinfo = datetime.UTC) -> datetime.datetime:
    return (START + datetime.timedelta(microseconds=round(seconds * 1e6))).astimezone(zone)


def _milli(
    form: str, zone: datetime.tzinfo = datetime.UTC
) -> Callable[[float], tuple[str, ...]]:
    def write(seconds: float) -> tuple[str, ...]:
        when = _when(seconds, zone)
        text = when.strftime(form.replace("%L", f"{when.microsecond // 1000:03d}"))
        return tuple(text.split("|"))

    return write


def _berlin(seconds: float) -> tuple[str, ...]:
    when = _when(seconds, datetime.timezone(datetime.timedelta(hours=2)))
    return (when.isoformat(timespec="milliseconds"),)


def _python(seconds: float) -> tuple[str, ...]:
    return (str(_when(seconds).replace(tzinfo=None)),)


def _midnight(seconds: float) -> tuple[str, ...]:
    return ((_when(seconds + 9 * 3600 - 2.0)).strftime("%H:%M:%S.%f")[:-3],)


def _hours_minutes(seconds: float) -> tuple[str, ...]:
    return (_when(seconds + 59.0).strftime("%H%M%S.%f")[:-3],)


def _minutes(seconds: float) -> tuple[str, ...]:
    return (_when(seconds).strftime("%M:%S.%f")[:-3],)


def _excel(seconds: float) -> tuple[str, ...]:
    since = _when(seconds) - datetime.datetime(1899, 12, 30, tzinfo=datetime.UTC)
    return (f"{since / datetime.timedelta(days=1):.10f}",)


def _matlab(seconds: float) -> tuple[str, ...]:
    return (f"{(START_NS * 1e-9 + seconds) / 86400 + 719529:.10f}",)


def _parts(seconds: float) -> tuple[str, ...]:
    when = _when(seconds)
    second = f"{when.second + when.microsecond * 1e-6:.3f}"
    return (
        str(when.year),
        str(when.month),
        str(when.day),
        str(when.hour),
        str(when.minute),
        second,
    )


def _number(form: str, scale: float, offset: float = 0.0) -> Callable[[float], tuple[str, ...]]:
    return lambda seconds: (format(offset + seconds * scale, form),)


def _whole(scale: int, offset: int = 0, wrap: int = 0) -> Callable[[float], tuple[str, ...]]:
    def write(seconds: float) -> tuple[str, ...]:
        count = offset + round(seconds * scale)
        return (str(count % wrap if wrap else count),)

    return write


EPOCH = START_NS // 10**9
CLOCKS: dict[str, Clock] = {
    "seconds": Clock(("time",), ("s",), _number(".4f", 1)),
    "seconds, late": Clock(("t",), ("s",), _number(".3f", 1, 1234.5)),
    "zeit": Clock(("Zeit [s]",), ("s",), _number(".4f", 1)),
    "temps": Clock(("Temps (s)",), ("s",), _number(".4f", 1)),
    "tiempo": Clock(("Tiempo (s)",), ("s",), _number(".4f", 1)),
    "elapsed": Clock(("Elapsed Time (sec)",), ("sec",), _number(".5f", 1)),
    "phyphox": Clock(("Time (s)",), ("s",), _number(".9E", 1)),
    "time_ms": Clock(("time_ms",), ("",), _whole(1000, 123_456_789)),
    "t[ms]": Clock(("t[ms]",), ("ms",), _number(".2f", 1000)),
    "millis": Clock(("millis",), ("",), _whole(1000, 4321)),
    "millis()": Clock(("millis()",), ("",), _whole(1000, 86_400_321)),
    "micros": Clock(("micros",), ("",), _whole(1_000_000, 987_654_321)),
    "micros, wrapping": Clock(("micros",), ("",), _whole(1_000_000, 2**32 - 2_000_000, 2**32)),
    "time_us": Clock(("time_us",), ("",), _whole(1_000_000, 123_456_789)),
    "Timestamp (us)": Clock(("Timestamp (us)",), ("us",), _whole(1_000_000, 77)),
    "Time (µs)": Clock(("Time (µs)",), ("µs",), _whole(1_000_000, 123_456)),
    "timeUs": Clock(("timeUs",), ("",), _whole(1_000_000, 1_234_567_890)),
    "time_ns": Clock(("time_ns",), ("",), _whole(1_000_000_000, 1_234_567_890_123)),
    "ts_ns": Clock(("timestamp_ns",), ("",), _whole(10**9, START_NS), dated=True),
    "unix": Clock(("timestamp",), ("",), _number(".4f", 1, EPOCH), dated=True),
    "epoch_ms": Clock(("epoch_ms",), ("",), _whole(1000, EPOCH * 1000), dated=True),
    "unix ms": Clock(("timestamp",), ("",), _whole(1000, EPOCH * 1000), dated=True),
    "unix us": Clock(("time",), ("",), _whole(10**6, EPOCH * 10**6), dated=True),
    "unix ns": Clock(("time",), ("",), _whole(10**9, START_NS), dated=True),
    "labview": Clock(("Time",), ("",), _number(".4f", 1, EPOCH + 2_082_844_800), dated=True),
    "iso": Clock(
        ("timestamp",), ("",), _milli("%Y-%m-%dT%H:%M:%S.%LZ"), dated=True, decimal=False
    ),
    "iso, blank": Clock(
        ("DateTime",), ("",), _milli("%Y-%m-%d %H:%M:%S.%L"), True, decimal=False
    ),
    "iso, zone": Clock(("time",), ("",), _berlin, dated=True, decimal=False),
    "python": Clock(("datetime",), ("",), _python, dated=True, decimal=False),
    "slashes": Clock(
        ("Date/Time",), ("",), _milli("%Y/%m/%d %H:%M:%S.%L"), True, decimal=False
    ),
    "german": Clock(
        ("Datum/Zeit",), ("",), _milli("%d.%m.%Y %H:%M:%S.%L"), True, decimal=False
    ),
    "german, comma": Clock(
        ("Zeitstempel",), ("",), _milli("%d.%m.%Y %H:%M:%S,%L"), True, decimal=False
    ),
    "american": Clock(
        ("Timestamp",), ("",), _milli("%m/%d/%Y %I:%M:%S.%L %p"), True, decimal=False
    ),
    "british": Clock(
        ("Timestamp",), ("",), _milli("%d/%m/%Y %H:%M:%S.%L"), True, decimal=False
    ),
    "compact": Clock(("time",), ("",), _milli("%Y%m%dT%H%M%S.%L"), True, decimal=False),
    "named month": Clock(("Time",), ("",), _milli("%d-%b-%Y %H:%M:%S.%L"), True, decimal=False),
    "day of year": Clock(("Time",), ("",), _milli("%Y-%jT%H:%M:%S.%L"), True, decimal=False),
    "colon before ms": Clock(
        ("Time",), ("",), _milli("%Y-%m-%d %H:%M:%S:%L"), True, decimal=False
    ),
    "date, time": Clock(
        ("Date", "Time"), ("", ""), _milli("%Y-%m-%d|%H:%M:%S.%L"), True, decimal=False
    ),
    "datum; zeit": Clock(
        ("Datum", "Uhrzeit"), ("", ""), _milli("%d.%m.%Y|%H:%M:%S,%L"), True, decimal=False
    ),
    "time of day": Clock(("Time",), ("",), _milli("%H:%M:%S.%L"), decimal=False),
    "past midnight": Clock(("Time",), ("",), _midnight, decimal=False),
    "minutes": Clock(("Time",), ("",), _minutes, decimal=False),
    "hhmmss": Clock(("Time",), ("",), _hours_minutes, rates=(50.0, 100.0)),
    "excel": Clock(("Date",), ("",), _excel, dated=True, rates=(50.0, 100.0)),
    "matlab": Clock(("Time",), ("",), _matlab, dated=True, rates=(50.0, 100.0)),
    "six columns": Clock(
        ("Year", "Month", "Day", "Hour", "Minute", "Second"), ("",) * 6, _parts, True
    ),
    "whole seconds": Clock(
        ("Timestamp",), ("",), _milli("%Y-%m-%d %H:%M:%S"), True, decimal=False
    ),
    "few digits": Clock(
        ("time_s",), ("s",), _number(".3f", 1), rates=(128.0, 610.35, 333.0), loose=1e-3
    ),
}

FACTS: dict[str, tuple[Callable[[float, int], tuple[str, ...]], tuple[float, ...]]] = {
    "rate": (lambda r, n: (f"Sampling rate: {r:g} Hz",), (50.0, 100.0, 512.0)),
    "rate, no unit": (lambda r, n: (f"Sampling Frequency - {r:g}",), (100.0, 5000.0)),
    "kHz": (lambda r, n: (f"Sample rate: {r / 1000:g} kHz",), (2500.0, 51200.0, 500.0)),
    "[kHz]": (lambda r, n: (f"Sample rate [kHz]: {r / 1000:g}",), (25600.0,)),
    "thousands": (lambda r, n: (f"Sampling rate: {r:,.0f} Hz",), (1000.0, 25600.0)),
    "thousands apart": (
        lambda r, n: (f"Sampling rate: {r:,.0f} Hz".replace(",", " "),),
        (10000.0,),
    ),
    "fs": (lambda r, n: (f"fs={r:g}",), (128.0, 1000.0)),
    "SR": (lambda r, n: (f"SR = {r:g} Hz",), (200.0,)),
    "sps": (lambda r, n: (f"{r:g} samples per second",), (200.0, 400.0)),
    "S/s": (lambda r, n: (f"Rate: {r / 1000:g} kS/s",), (2000.0,)),
    "decimated": (
        lambda r, n: (f"ADC sampling rate {r * 512:g} Hz, decimated to {r:g} Hz",),
        (100.0,),
    ),
    "thinned": (
        lambda r, n: (f"Original sampling rate: {r * 10:g} Hz", f"Downsampled to: {r:g} Hz"),
        (50.0,),
    ),
    "dt": (lambda r, n: (f"dt = {1 / r:g}",), (100.0, 250.0)),
    "dt ms": (lambda r, n: (f"Sample interval (ms): {1000 / r:g}",), (200.0, 100.0)),
    "dt us": (lambda r, n: (f"Sampling interval: {1e6 / r:g} us",), (2000.0,)),
    "delta t": (lambda r, n: (f"delta t [s] {1 / r:g}",), (50.0,)),
    "german": (
        lambda r, n: (f"Abtastrate: {r:g} Hz", f"Messdauer: {n / r:g} s"),
        (100.0, 1200.0),
    ),
    "german, short": (
        lambda r, n: (f"Abtastintervall: {1000 / r:g} ms", f"Anzahl Messwerte: {n}"),
        (200.0,),
    ),
    "french": (
        lambda r, n: (f"Fréquence d'échantillonnage : {r:g} Hz", f"Nombre de points : {n}"),
        (256.0,),
    ),
    "spanish": (
        lambda r, n: (f"Frecuencia de muestreo: {r:g} Hz", f"Duración: {n / r:g} s"),
        (200.0,),
    ),
    "italian": (lambda r, n: (f"Frequenza di campionamento: {r:g} Hz",), (128.0,)),
    "portuguese": (lambda r, n: (f"Taxa de amostragem: {r:g} Hz",), (100.0,)),
    "count": (lambda r, n: (f"Number of samples: {n:,}", f"Sampling rate: {r:g} Hz"), (100.0,)),
    "points, length": (lambda r, n: (f"NPTS= {n}, DT= {1 / r:.4f} SEC",), (200.0, 100.0)),
    "duration only": (lambda r, n: (f"Duration: {n / r:g} s", f"Samples: {n}"), (100.0,)),
    "hms": (
        lambda r, n: (f"Duration: 00:00:{n / r:05.2f}", f"Sample rate: {r:g} Hz"),
        (100.0,),
    ),
    "ascii": (
        lambda r, n: (
            f"SAMPLING_INTERVAL_S: {1 / r:.6f}",
            f"NDATA: {n}",
            f"DURATION_S: {n / r:.3f}",
        ),
        (200.0,),
    ),
    "with filter": (
        lambda r, n: ("Low-pass filter: 40 Hz", "Sensor range: 2 g", f"Sample rate: {r:g} Hz"),
        (100.0,),
    ),
    "with date": (
        lambda r, n: (
            "Recorded: 2024-04-21 15:00:00",
            "Operator: A. Smith",
            f"Data rate {r:g} Hz",
        ),
        (100.0,),
    ),
    "fraction": (lambda r, n: (f"Sample period = 1/{r:g} s",), (200.0,)),
}
"""Lines of a heading that state the sampling, for rate and number of rows; rates to write."""

CHANNELS: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("ax", "ay"), ("g", "g")),
    (("Acceleration X", "Acceleration Y", "Acceleration Z"), ("m/s^2", "m/s^2", "m/s^2")),
    (("roof",), ("m/s^2",)),
    (("CH1", "CH2", "CH3"), ("V", "V", "V")),
    (("acc_x", "acc_y", "acc_z"), ("m/s²", "m/s²", "m/s²")),
    (("Sensor 1", "Sensor 2"), ("mg", "mg")),
    (("x", "y", "z"), ("g", "g", "g")),
)
SIDES = (
    "",
    "",
    "count",
    "row",
    "status",
    "magnitude",
    "constant",
    "second",
    "packet",
    "empty",
    "index",
)
DELIMITERS = (",", ";", "\t", "|", " ")


def signal(rng: np.random.Generator, rows: int, rate_hz: float, width: int) -> np.ndarray:
    """Vibration of two modes and noise, rounded to what is written."""
    time = np.arange(rows) / rate_hz
    columns = []
    for _ in range(width):
        phases = rng.uniform(0, 2 * np.pi, 2)
        wave = np.sin(2 * np.pi * 0.05 * rate_hz * time + phases[0])
        wave += 0.6 * np.sin(2 * np.pi * 0.11 * rate_hz * time + phases[1])
        columns.append(rng.uniform(0.5, 2) * wave + 0.1 * rng.standard_normal(rows))
    return np.round(np.column_stack(columns), 5)


def _text(value: float, decimal: str) -> str:
    return f"{value:.5f}".replace(".", decimal)


def _side(kind: str, samples: np.ndarray, rate_hz: float) -> tuple[str, str, list[str]]:
    """Name, unit, and texts of a column that is no sensor."""
    rows = len(samples)
    if kind in ("count", "row", "index"):
        name = {"count": "count", "row": "Sample No.", "index": ""}[kind]
        return name, "", [str(i + (kind == "row")) for i in range(rows)]
    if kind == "packet":
        return "packet", "", [str(i // 8 % 256) for i in range(rows)]
    if kind == "status":
        return "status", "", ["OK" if i % 37 else "WARN" for i in range(rows)]
    if kind == "constant":
        return "spare", "", ["2.50000"] * rows
    if kind == "empty":
        return "Comment", "", [""] * rows
    if kind == "second":
        return "elapsed_ms", "", [str(round(1000 * i / rate_hz)) for i in range(rows)]
    length = np.sqrt((samples**2).sum(axis=1))
    return "Absolute", "", [f"{value:.5f}" for value in length]


def table(
    rng: random.Random,
    *,
    clock: str | None,
    facts: str | None,
    name: str,
    rows: int = 400,
    delimiter: str | None = None,
    side: str | None = None,
    loss: str = "",
) -> Case:
    """One table of rows, with what a logger may write around it."""
    told = CLOCKS[clock] if clock else None
    lines, rates = FACTS[facts] if facts else (lambda r, n: (), (100.0, 50.0))
    rate = rng.choice(told.rates if told and not facts else rates)
    names, units = rng.choice(CHANNELS)
    if clock == "six columns":
        names, units = CHANNELS[0]
    side = rng.choice(SIDES) if side is None else side
    if side == "magnitude" and len(names) < 2:
        side = ""
    samples = signal(np.random.default_rng(rng.randrange(2**31)), rows, rate, len(names))
    if side == "magnitude" and len(names) > 3:
        side = ""
    mark = rng.choice(DELIMITERS) if delimiter is None else delimiter
    thousands = facts in ("thousands", "count") and "," in "".join(lines(rates[0], 1000))
    decimal = "." if mark == "," or thousands else rng.choice((".", ","))
    kept = np.ones(rows, dtype=bool)
    if loss == "gap":
        kept[200:230] = False
    if loss == "regular":
        kept[(np.arange(rows) % 60 >= 28) & (np.arange(rows) % 60 < 30)] = False
    columns: list[tuple[str, str, list[str]]] = []
    if told is not None:
        texts = [told.write(i / rate) for i in range(rows)]
        for place, head in enumerate(told.header):
            column = [text[place] for text in texts]
            if told.decimal:
                column = [text.replace(".", decimal) for text in column]
            columns.append((head, told.unit[place], column))
    columns += [
        (head, unit, [_text(v, decimal) for v in values])
        for head, unit, values in zip(names, units, samples.T, strict=True)
    ]
    if side:
        head, unit, beside = _side(side, samples, rate)
        if side in ("constant", "magnitude"):
            beside = [text.replace(".", decimal) for text in beside]
        at = 0 if side in ("index", "row") else len(columns)
        columns.insert(at, (head, unit, beside))
    if mark == " ":
        # Blanks inside of a field would part it.
        columns = [
            (h.replace(" ", "_") or "no", u, [t or "NA" for t in x]) for h, u, x in columns
        ]
        if clock in (
            "iso, blank",
            "python",
            "slashes",
            "german",
            "german, comma",
            "american",
            "british",
            "named month",
            "colon before ms",
            "whole seconds",
        ):
            mark = "\t"  # fmt: skip
    if loss == "NA":
        last = next(
            x
            for h, _, x in reversed(columns)
            if h.replace("_", " ") == names[-1].replace("_", " ")
        )
        for row in (100, 333, 334):
            blank = mark == " " or len(columns) == 1
            last[row] = "NA" if blank else rng.choice(("NA", "#N/A", "", "--"))
            kept[row] = False
    style = rng.choice(("names", "names", "brackets", "two lines", "comment", "quoted"))
    quote = '"' if style == "quoted" and mark != " " else ""
    heads = [f"{quote}{head}{quote}" for head, _, _ in columns]
    if style == "brackets" and mark != " ":
        heads = [
            f"{h} [{u}]" if u and "[" not in h and "(" not in h else h for h, u, _ in columns
        ]
    heading = [mark.join(heads)]
    if style == "two lines":
        heading.append(mark.join(u or "-" for _, u, _ in columns))
    unitful = style == "two lines" or (style == "brackets" and mark != " ")
    if style == "comment":
        heading = [f"# {heading[0]}"]
    preamble = list(lines(rate, rows))
    if rng.random() < 0.3:
        preamble.insert(
            0, rng.choice(("Logger 7, firmware 1.2.3", "Messung am Turm", "file: test_03.csv"))
        )
    if rng.random() < 0.3:
        preamble.append("")
    if style == "comment":
        preamble = [f"# {line}" for line in preamble]
    body = [
        mark.join(texts[row] for _, _, texts in columns)
        for row in range(rows)
        if kept[row] or loss == "NA"
    ]
    tail = mark if rng.random() < 0.15 and mark not in " " and side != "empty" else ""
    end = rng.choice(("\n", "\n", "\r\n"))
    text = end.join([*preamble, *heading, *(line + tail for line in body)]) + end
    encoding = rng.choice(("utf-8", "utf-8", "utf-8-sig", "utf-16", "cp1252"))
    try:
        content = text.encode(encoding)
    except UnicodeEncodeError:
        content = text.encode("utf-8")
    written = [head for head, _, _ in columns]
    found = tuple(n if n in written else n.replace(" ", "_") for n in names)
    return Case(
        name=name,
        content=content,
        rate_hz=rate,
        channels=found,
        samples=samples[kept],
        start_ns=START_NS if (told and told.dated) or facts == "with date" else None,
        loose=told.loose if told else 1e-6,
        gaps=int((~kept).sum()),
        suffix=rng.choice((".csv", ".txt", ".dat", ".asc")),
        units=units if unitful else ("",) * len(units),
    )


def wrapped(
    rng: random.Random, kind: str, name: str, width: int, rows: int | None = None
) -> Case:
    """One series written several values a line, as accelerograms are."""
    rows = rows or rng.randrange(700, 1100)
    rate = rng.choice((50.0, 100.0, 200.0))
    samples = signal(np.random.default_rng(rng.randrange(2**31)), rows, rate, 1)[:, 0]
    form = rng.choice(("{:15.7E}", "{:12.5f}", "{:14.6E}"))
    samples = np.array([float(form.format(v)) for v in samples])
    lines = [
        "".join(form.format(v) for v in samples[i : i + width]) for i in range(0, rows, width)
    ]
    heads: dict[str, Sequence[str]] = {
        "peer": (
            "PEER NGA STRONG MOTION DATABASE RECORD",
            "Somewhere, 1/1/2000, Station, 090",
            "ACCELERATION TIME SERIES IN UNITS OF G",
            f"NPTS=  {rows}, DT=   {1 / rate:.4f} SEC,",
        ),
        "peer, old": (
            "PEER STRONG MOTION DATABASE RECORD. PROCESSING BY PACIFIC ENGINEERING.",
            "SOMEWHERE 01/01/00 00:00, STATION, 090",
            "ACCELERATION TIME HISTORY IN UNITS OF G. FILTER POINTS: HP=0.1 Hz LP=40.0 Hz",
            f"{rows}    {1 / rate:.4f}    NPTS, DT",
        ),
        "duration": (f"Sampling frequency: {rate:g} Hz", f"Record length: {rows / rate:.2f} s"),
        "count": (f"Number of points: {rows}", f"Time step (s): {1 / rate:g}"),
        "csmip": (
            f"  {rows} points of accel data equally spaced at  {1 / rate:.3f} sec, in cm/sec2. "
            f"({width}f12.5)",
        ),
    }
    if kind == "csmip":
        lines = [
            "".join(f"{v:12.5f}" for v in samples[i : i + width]) for i in range(0, rows, width)
        ]
        samples = np.round(samples, 5)
    text = "\n".join([*heads[kind], *lines]) + "\n"
    channel = "acceleration" if kind == "csmip" else "channel_0"
    return Case(
        name, text.encode(), rate, (channel,), samples[:, None], suffix=".at2", loose=1e-6,
        units=({"peer": "g", "peer, old": "g", "csmip": "cm/s^2"}.get(kind, ""),),
    )  # fmt: skip
