"""Sampling stated in a heading: rate, interval, number of points, duration.

A heading may say a figure in several languages and units, and write it so that it can be read
in two ways ("1.000 Hz"). So a fact keeps every reading, and `plausibility` holds them against
the samples.
"""

import dataclasses
import re
from collections.abc import Iterable, Sequence

from slowtime_services.files.record import looks_like_unit

from .fields import FIELD, fields_apart
from .key_grades import (
    SERIAL_BAUD,
    SLOWEST_INTERVAL_S,
    Grade,
    Kind,
    grade_of,
    is_after_thinning,
)
from .vocabulary import (
    ABOUT_ELSE,
    BEFORE,
    COUNT_KEYS,
    DURATION_KEYS,
    FACTOR,
    FINAL,
    FREQUENCY_UNITS,
    INTERVAL_KEYS,
    RATE_KEYS,
    TIME_UNITS,
)

LONGEST_LINE = 400
"""Characters of a line of heading that are looked at; figures stand near their words."""
MOST_LINES = 400

_NUMBER = (
    r"(?<![\w.])(?<!\d,)(?P<number>[+-]?"
    r"(?:\d{1,3}(?:[ '’]\d{3})+(?:[.,]\d+)?|\d[\d.,]*|\.\d+)"
    r"(?:[eEdD][+-]?\d+)?)(?![\d])"
)


def _units(table: dict[str, float]) -> str:
    words = sorted(map(re.escape, table), key=len, reverse=True)
    return f"(?:{'|'.join(words)})(?![\\w/^])"


_WORDS: tuple[tuple[Kind, tuple[str, ...]], ...] = (
    ("interval", INTERVAL_KEYS),
    ("duration", DURATION_KEYS),
    ("rate", RATE_KEYS),
    ("count", COUNT_KEYS),
)
_KEYS = tuple(
    (kind, re.compile("|".join(f"(?:{key})" for key in keys), re.I)) for kind, keys in _WORDS
)
_PERIOD = re.compile(r"sampl\w*[\s-]*(?:time|period)", re.I)
LONGEST_INTERVAL_S = 1.0
"""From here on, a "sampling time" or "sampling period" is how long somebody sampled."""
LONGEST_UNSAID_S = 0.5
"""An interval of this size without a unit may be one of milliseconds."""
_NEEDS_UNIT = re.compile(
    r"(?:rate|interval|spacing|step|incr|x[\s-]*incr|ts|d[\s_]?x)(?:ement)?(?![\w])", re.I
)
"""Words that say too little of sampling by themselves: only with a unit do they count."""
_IN_WORDS = re.compile(r"(?:\b(?:at|with|mit|every)|@)\s*$", re.I)
"""Ends of keys within sentences, which state a figure of sampling only with its unit."""
_PEER = re.compile(
    r"(?P<n>\d{2,9})\s+(?P<dt>\d*\.\d+(?:[eE][+-]?\d+)?)\s+(?:NPTS|N)\s*,?\s*(?:and\s+)?DT",
    re.I,
)
"""Figures before their words, as old files of the PEER data base have them."""
_PEER_FIGURES: tuple[tuple[Kind, str], ...] = (("count", "n"), ("interval", "dt"))


@dataclasses.dataclass(frozen=True, slots=True)
class Fact:
    """One figure of a heading.

    Parameters
    ----------
    values
        What the figure may mean, the likeliest first [Hz, s, 1, s].
    text
        The figure and its words, as the heading has them.
    line
        Line of the file, from 1; 0 in files that have no lines.
    rank
        2 for what a file says of itself after thinning, 1 as usual, 0 for what holds before.
    tolerance
        Half a step of the figure's last digit, in its unit.
    exact
        Whether its name says quantity and unit (`rate_hz`), so that nothing is assumed.
    with_unit
        Whether a unit stands with the figure.
    weak
        Whether its words may be of something else than sampling, so that it gives way to
        other figures and to a clock.
    """

    kind: Kind
    values: tuple[float, ...]
    text: str
    line: int
    rank: int = 1
    tolerance: float = 0.0
    exact: bool = False
    with_unit: bool = False
    weak: bool = False


_STEPS: tuple[Kind, ...] = ("rate", "interval")


@dataclasses.dataclass(frozen=True, slots=True)
class Facts:
    """All figures of a heading."""

    found: tuple[Fact, ...] = ()
    factor: int = 1
    """By how much samples were thinned, where the heading says a factor and no rate."""
    doubtful: tuple[Fact, ...] = ()
    """Figures that are hardly of sampling, to be quoted where nothing else states it."""

    @property
    def of_any_length(self) -> "Facts":
        """Return the facts that are independent of the length."""
        kept = (fact for fact in self.found if fact.kind in ("rate", "interval"))
        return dataclasses.replace(self, found=tuple(kept))

    def of(self, kind: Kind) -> tuple[Fact, ...]:
        """Facts of one kind, of the highest rank that occurs; weak ones only if alone."""
        alike = _STEPS if kind in _STEPS else (kind,)
        full = any(f.kind in alike and f.rank > 0 and not f.weak for f in self.found)
        facts = [f for f in self.found if f.kind == kind and not (full and f.weak)]
        ranks = [fact.rank for fact in facts]
        return tuple(fact for fact in facts if fact.rank == max(ranks))

    def without_weak(self, *kinds: Kind) -> "Facts":
        """Return the facts without those of some kinds that are weak."""
        kept = tuple(f for f in self.found if not (f.weak and f.kind in kinds))
        return dataclasses.replace(self, found=kept)

    def joined(self, other: "Facts") -> "Facts":
        """Return the facts of two parts of a file."""
        return Facts(
            (*self.found, *other.found),
            max(self.factor, other.factor),
            (*self.doubtful, *other.doubtful),
        )


def find_facts(
    lines: Sequence[str],
    decimal: str = ".",
    first_line: int = 1,
    delimiter: str | None = None,
) -> Facts:
    """Find the figures of sampling in lines of a heading.

    Parameters
    ----------
    decimal
        Decimal mark of the file's rows, which decides how "1,000" is read.
    delimiter
        Delimiter of the rows, which parts figures that are stated once per channel; None
        where it is blanks.

    Examples
    --------
    >>> facts = find_facts(["# Sampling rate: 2.5 kHz", "Number of points: 3,000"])
    >>> [(fact.kind, fact.values) for fact in facts.found]
    [('rate', (2500.0,)), ('count', (3000.0,))]
    """
    found: list[tuple[Fact, Grade]] = []
    factor = 1
    for number, line in enumerate(lines[:MOST_LINES], start=first_line):
        text = _spaced(fields_apart(line[:LONGEST_LINE], delimiter))
        match = FACTOR.search(text)
        if match is not None:
            factor = int(next(filter(None, match.groups()))) or 1
        found.extend(_of_line(text, decimal, number, listed=delimiter in (",", None)))
    kept = dict.fromkeys(
        dataclasses.replace(fact, weak=grade == "weak")
        for fact, grade in found
        if grade != "doubtful"
    )
    doubtful = dict.fromkeys(fact for fact, grade in found if grade == "doubtful")
    return Facts(tuple(kept), factor, tuple(doubtful))


def _spaced(line: str) -> str:
    """Words of a key, apart: ``SAMPLING_INTERVAL_S`` and ``sampleRate`` as their words."""
    line = re.sub(r"(?<=[a-z])(?=[A-Z](?!z\b)[a-z])", " ", line.replace("_", " "))
    return re.sub(r"[\"']", " ", line).strip("#%!;/* \r\n")


def _of_line(
    text: str, decimal: str, line: int, *, listed: bool
) -> Iterable[tuple[Fact, Grade]]:
    taken: list[tuple[int, int]] = []
    peer = _PEER.search(text)
    if peer is not None:
        for kind, group in _PEER_FIGURES:
            fact = _fact(kind, peer[group], 1.0, ".", peer.group(0), line, 1)
            if fact is not None:
                yield fact, "full"
        return
    parts = list(_clauses(text))
    final = FINAL.search(text)
    if final is not None:
        fact = _figure("rate", text, final.end(), decimal, line, text[final.start() :], rank=2)
        if fact is not None and fact.kind == "rate" and fact.with_unit:
            yield fact, "full"
            parts = list(_clauses(text[: final.start()]))
    for clause in parts:
        for kind, form in _KEYS:
            for match in form.finditer(clause):
                span = match.span()
                if any(a < span[1] and span[0] < b for a, b in taken):
                    continue
                before = clause[max(0, span[0] - 24) : span[0]]
                around = before + clause[span[0] : span[1] + 24]
                if ABOUT_ELSE.search(around):
                    continue
                rank = 0 if BEFORE.search(around) else 1
                fact = _figure(kind, clause, span[1], decimal, line, clause[span[0] :], rank)
                fact = fact or _figure_before(kind, clause, span[0], decimal, line, rank)
                if fact is not None:
                    taken.append((span[0], span[1]))
                    yield _graded(fact, clause, span, listed=listed)
        taken = []


def _graded(
    fact: Fact, clause: str, span: tuple[int, int], *, listed: bool
) -> tuple[Fact, Grade]:
    """Judge a fact by its words and by its size."""
    key, before, after = clause[span[0] : span[1]], clause[: span[0]], clause[span[1] :]
    if listed:
        fact = _with_repeated(fact, after)
    grade = grade_of(fact.kind, key, before, after, fact.with_unit)
    if fact.kind == "rate" and fact.with_unit and is_after_thinning(before):
        return dataclasses.replace(fact, rank=2), "full"
    if grade == "doubtful":
        said = " ".join(clause.split())[:60]
        return dataclasses.replace(fact, text=said), grade
    if not fact.with_unit and (
        (fact.kind in _STEPS and _NEEDS_UNIT.match(key))
        or (fact.kind == "rate" and fact.values[0] in SERIAL_BAUD and grade == "weak")
    ):
        return fact, "doubtful"
    if fact.kind == "interval" and min(fact.values) > SLOWEST_INTERVAL_S:
        grade = "doubtful" if not fact.with_unit else "weak"
    return fact, grade


_REPEATED = re.compile(r"(?P<one>[1-9]\d*(?:\.\d+)?)(?:[, ](?P=one))+(?![\d.,])")


def _with_repeated(fact: Fact, after: str) -> Fact:
    """Add the reading of a figure that is stated once per channel: ``Fs: 200,200``."""
    figure = re.search(r"\d[\d., ]*", after)
    repeated = _REPEATED.match(figure.group(0).rstrip(" ,.")) if figure else None
    if figure is None or repeated is None:
        return fact
    read = read_figure(figure.group(0).rstrip(" ,."))
    if not read or not fact.values or not read[0]:
        return fact
    single = float(repeated["one"]) * fact.values[0] / read[0]
    return dataclasses.replace(fact, values=(*fact.values, single))


def _clauses(text: str) -> Iterable[str]:
    """Split a line at marks before words: each part states one figure."""
    for part in re.split(r"[;|]\s*(?=[^\W\d_])|,\s+(?=[^\W\d_])", text):
        for clause in _settings(part.split(FIELD)):
            yield from _once(clause)


def _settings(fields: Sequence[str]) -> Iterable[list[str]]:
    """Gather the fields of one setting: a key, its figures and their unit."""
    setting: list[str] = []
    for field in fields:
        word = field.strip(" []()")
        begins = word[:1].isalpha() and not _is_unit(word)
        if setting and begins and any(map(_FIGURE.search, setting)):
            yield setting
            setting = []
        setting.append(field)
    if any(setting):
        yield setting


def _once(fields: Sequence[str]) -> Iterable[str]:
    """Return a setting with each of its figures: the same once, however many channels."""
    figures = [field for field in fields[1:] if _ONLY_FIGURE.fullmatch(field.strip())]
    if len(figures) < 2:
        yield FIELD.join(fields)
        return
    others = [field for field in fields if field not in figures]
    for figure in dict.fromkeys(field.strip() for field in figures):
        yield FIELD.join((others[0], figure, *others[1:]))


def _is_unit(word: str) -> bool:
    return word.casefold() in FREQUENCY_UNITS or word.casefold() in TIME_UNITS


_FIGURE = re.compile(r"\d")
_ONLY_FIGURE = re.compile(r"[+-]?[\d.][\d.,]*(?:[eE][+-]?\d+)?\s*[^\W\d_]{0,3}(?:/s)?")
_UNIT_OF_RATE = re.compile(_units(FREQUENCY_UNITS), re.I)
_UNIT_OF_TIME = re.compile(_units(TIME_UNITS), re.I)
_BETWEEN = re.compile(r"[^\d\w]*(?:is|of|was|ist|de|est|es|=|:|-|\s)*[^\d\w+.,-]*", re.I)
_OF_BITS = re.compile(r"[kM]?(?:bps|bits?|baud|bd|bytes?|rpm)", re.I)
"""Units of serial lines and of shafts."""
_NEXT_KEY = re.compile(r"\s+[^\W\d_][^\d:=]*[:=]")
_HMS = re.compile(r"(?P<h>\d{1,3}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,]\d+)?)")


def _figure(
    kind: Kind, text: str, start: int, decimal: str, line: int, said: str, rank: int
) -> Fact | None:
    """Read the figure that follows a key, with the unit before or after it."""
    table, form = (
        (FREQUENCY_UNITS, _UNIT_OF_RATE) if kind == "rate" else (TIME_UNITS, _UNIT_OF_TIME)
    )
    rest = text[start:]
    bracket = re.match(r"\s*[\[(]\s*([^\])]{1,24}?)\s*[\])]", rest)
    unit = ""
    if bracket is not None and bracket.group(1).casefold() in table:
        unit = bracket.group(1)
        rest = rest[bracket.end() :]
    elif bracket is not None:
        rest = rest[bracket.end() :]
    word = re.match(r"\s*[,_/]?\s*", rest)
    beside = form.match(rest, word.end() if word else 0)
    if beside is not None and kind != "count" and not unit:
        unit = beside.group(0)
        rest = rest[beside.end() :]
    clock = re.match(_BETWEEN.pattern + _HMS.pattern, rest[:60], re.I)
    lasting = kind == "duration" and re.match(r"\D*(?:dur|dau|len)", said, re.I)
    if clock and (lasting or kind == "interval"):
        seconds = float(clock["s"].replace(",", "."))
        value = int(clock["h"]) * 3600 + int(clock["m"]) * 60 + seconds
        if not value:
            return None
        step = 0.5 if lasting else 0.0
        return Fact(kind, (value,), said[:60].strip(), line, rank, step, with_unit=True)
    match = re.match(_BETWEEN.pattern + r"(?:(?P<one>1)\s*/\s*)?" + _NUMBER, rest, re.I)
    if match is None:
        return None
    after = re.match(r"\s*[\[(]?\s*", rest[match.end() :])
    behind = form.match(rest, match.end() + (after.end() if after else 0))
    if behind is not None and kind != "count":
        unit = behind.group(0)
    tail = rest[match.end() : match.end() + 3]
    if re.match(r"[-/:.]\d", tail):
        return None  # part of a date, a time or a version
    if kind == "count" and _UNIT_OF_RATE.match(rest[match.end() :].lstrip()):
        return None
    if kind == "rate" and not unit and _UNIT_OF_TIME.match(rest[match.end() :].lstrip()):
        # "Sample rate: 10 ms" is an interval under another name.
        return _figure("interval", text, start, decimal, line, said, rank)
    if kind in ("interval", "duration") and _UNIT_OF_RATE.match(rest[match.end() :].lstrip()):
        return _figure("rate", text, start, decimal, line, said, rank)
    if kind == "duration" and re.match(
        r"\s*(?:points|samples|pts)\b", rest[match.end() :], re.I
    ):
        return _figure("count", text, start, decimal, line, said, rank)
    if not unit and kind != "count":
        word = re.match(r"\s*\[?([^\W\d_°%][\w/²^]*|[°%]\w?)", rest[match.end() :])
        if word is not None and (
            "/" in word.group(1)
            or looks_like_unit(word.group(1))
            or _OF_BITS.fullmatch(word.group(1))
            or (kind == "duration" and _NEXT_KEY.match(rest[match.end() :]) is None)
        ):
            return None  # of another quantity: "FS: 2 g", "rate: 5 mm/min", "2 runs"
        if _IN_WORDS.search(text[:start]):
            return None  # "recorded at 15 Main Street"
        if kind == "duration" and re.search(r"length", text[start - 12 : start], re.I):
            return None  # of samples on an oscilloscope, of seconds elsewhere
    scale = 1.0 if kind == "count" else table.get(unit.casefold(), 1.0)
    if unit in ("MS/s",):
        scale = 1e6
    length = start - (len(text) - len(said)) if said and text.endswith(said) else 0
    words = said[: max(length, 0) + len(text[start:]) - len(rest) + match.end() + 12]
    fact = _fact(kind, match["number"], scale, decimal, words, line, rank)
    if fact is None:
        return None
    fact = dataclasses.replace(fact, with_unit=bool(unit))
    if match["one"]:
        return dataclasses.replace(
            fact, values=tuple(1.0 / v for v in fact.values), tolerance=0
        )
    if kind == "interval" and not unit and fact.values[0] >= LONGEST_UNSAID_S:
        readings = tuple(v * s for v in fact.values for s in (1.0, 1e-3))
        return dataclasses.replace(fact, values=readings)
    if kind == "interval" and _PERIOD.match(said) and fact.values[0] >= LONGEST_INTERVAL_S:
        return dataclasses.replace(fact, kind="duration")
    return fact


_FIGURE_BEFORE: dict[Kind, re.Pattern[str]] = {
    "count": re.compile(_NUMBER + r"\s*(?:data\s+)?$"),
    "rate": re.compile(_NUMBER + r"\s*$"),
    "interval": re.compile(_NUMBER + r"\s*,?\s*(?:npts?\s*,\s*)?$", re.I),
    "duration": re.compile(_NUMBER + r"\s*(?:s|sec|seconds|min)\s*$"),
}


def _figure_before(
    kind: Kind, text: str, end: int, decimal: str, line: int, rank: int
) -> Fact | None:
    """Read the figure before its word: "3000 samples", "100 sps"."""
    match = _FIGURE_BEFORE[kind].search(text[:end])
    if match is None or kind == "interval":
        return None
    fact = _fact(
        kind, match["number"], 1.0, decimal, text[match.start() : end + 24], line, rank
    )
    if fact is None or kind != "rate" or _NEEDS_UNIT.match(text[end:]):
        return fact
    return dataclasses.replace(fact, with_unit=True)  # of keys such as "sps"


def _fact(
    kind: Kind, number: str, scale: float, decimal: str, text: str, line: int, rank: int
) -> Fact | None:
    readings = tuple(value * scale for value in read_figure(number, decimal) if value > 0)
    if not readings:
        return None
    if kind == "rate" and scale == 1.0 and _THREE.fullmatch(number) and readings[0] < 10:
        readings += (readings[0] * 1000,)  # hardly anything is sampled at "1.000 Hz"
    if kind == "count":
        readings = tuple(value for value in readings if value == int(value))
        if not readings:
            return None
    return Fact(
        kind, readings, " ".join(text.split())[:60], line, rank, _half_step(number) * scale
    )


_THREE = re.compile(r"[1-9]\.\d{3}")


def _half_step(number: str) -> float:
    digits = re.search(r"[.,](\d*)$", number)
    return 0.5 * 10.0 ** -(len(digits.group(1)) if digits else 0)


def read_figure(text: str, decimal: str = ".") -> tuple[float, ...]:
    """All values that a figure may stand for, the likeliest first.

    Examples
    --------
    >>> read_figure("1,000"), read_figure("25.6"), read_figure("1.000", ",")
    ((1000.0,), (25.6,), (1000.0, 1.0))
    """
    bare = re.sub(r"[ '’]", "", text).rstrip(".,").replace("d", "e").replace("D", "e")
    body, _, power = bare.replace("E", "e").partition("e")
    exponent = "e" if power else ""
    points, commas = body.count("."), body.count(",")
    options: list[str] = []
    if points and commas:
        last = max(body.rfind("."), body.rfind(","))
        whole = re.sub(r"[.,]", "", body[:last])
        options = [f"{whole}.{body[last + 1 :]}"]
    elif points > 1 or commas > 1:
        # Not three digits in each group: a date or a version.
        grouped = re.fullmatch(r"[+-]?\d{1,3}(?:[.,]\d{3})+", body)
        options = [re.sub(r"[.,]", "", body)] if grouped else []
    elif points or commas:
        mark = "." if points else ","
        plain = body.replace(",", ".")
        thousands = re.fullmatch(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", body) and not exponent
        if not thousands:
            options = [plain]
        elif mark == decimal:
            options = [plain] if mark == "." else [plain, body.replace(mark, "")]
        else:
            options = (
                [body.replace(mark, "")] if mark == "," else [body.replace(mark, ""), plain]
            )
    else:
        options = [body]
    values = []
    for option in options:
        try:
            values.append(float(option + (f"e{power}" if exponent else "")))
        except (ValueError, OverflowError):
            continue
    return tuple(value for value in values if value < 1e15)
