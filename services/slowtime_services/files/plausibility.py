"""Consistency of the samples with every figure that a heading states.

The samples have a number, the clock or the heading gives a rate, and the heading may state
a number of points, an interval and a duration. All of them are of one record, so one reading
must satisfy all: which reading that is decides how a figure such as "1.000 Hz" is meant, and
whether columns are channels or one series. Where no reading does, nobody but a person knows.
"""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import Literal

from .headings.key_grades import Kind
from .headings.sampling import Fact, Facts
from .record import RecordError
from .times.time_units import FASTEST_HZ, SLOWEST_HZ

RATE_TOLERANCE = 1e-3
"""Relative difference [1] up to which two rates are the same: clocks of loggers keep time to
tens of parts in a million, printed intervals to their digits."""
NOMINAL_RATE_TOLERANCE = 0.05
"""Relative difference [1] up to which a clock's rate is that which the heading means: sensors
run some percent beside their nominal rate, as data sheets of MEMS accelerometers state."""
DURATION_TOLERANCE = 0.01
"""Relative difference [1] of durations that are the same: headings round them."""
LENGTHS: tuple[Kind, ...] = ("count", "duration")
WHOLE_RATE_TOLERANCE = 1e-6
"""Relative distance from a whole number of Hz [1] at which a rate may be computed from a
duration and a number of samples."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RowFigures:
    """Figures of the rows and the clock.

    Parameters
    ----------
    rows, width
        Rows, and columns that hold samples.
    tail
        Values on a last line that is not full.
    missing
        Samples that the clock shows to be missing.
    clock_rate_hz
        Rate of the clock; None without one.
    clock_sure
        Whether the clock's unit is stated, not taken for granted.
    given_rate_hz
        Rate that a person gives.
    named
        Whether a heading names the columns.
    smooth
        Whether the columns look like one series.
    apart
        Whether they look like channels.
    wrapped
        What a person says of that; None for nothing.
    """

    rows: int
    width: int
    tail: int = 0
    missing: int = 0
    clock_rate_hz: float | None = None
    clock_sure: bool = True
    given_rate_hz: float | None = None
    named: bool = False
    smooth: bool = False
    apart: bool = False
    wrapped: bool | None = None

    @property
    def series(self) -> int:
        """Samples, if all are of one series."""
        return self.rows * self.width + self.tail


@dataclasses.dataclass(frozen=True, slots=True)
class ReadingVerdict:
    """The one reading that all figures allow."""

    rate_hz: float | None
    wrapped: bool
    assumptions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class _RowGuess:
    wrapped: bool
    samples: int
    rate_hz: float | None


def judge(name: str, facts: Facts, measured: RowFigures) -> ReadingVerdict:
    """Find the reading that all figures of a heading allow.

    Raises
    ------
    RecordError
        Where there is none, or more than one: a question that names the figures, and the flag
        that settles it.
    """
    if measured.given_rate_hz is not None:
        return _as_given(name, facts, measured)
    if measured.clock_rate_hz is not None:
        return _by_clock(name, facts, measured)
    rates = _stated_rates(name, facts)
    allowed: list[float | None] = [*rates] or [None]
    readings = [
        _RowGuess(wrapped, samples, rate)
        for (wrapped, samples), rate in itertools.product(_layouts(measured), allowed)
    ]
    fit = [r for r in readings if _agrees(r, facts, measured)]
    notes: tuple[str, ...] = ()
    if not fit:
        certain = facts.without_weak(*LENGTHS)
        fit = [r for r in readings if _agrees(r, certain, measured)]
        if not fit:
            raise _contradiction(name, certain, measured, rates)
        notes, facts = (_of_something_else(facts),), certain
    fit = _without_doubtful(name, fit, facts, measured)
    chosen = fit[0]
    if len({r.rate_hz for r in fit}) > 1:
        raise RecordError(
            f"{name} states a rate that can be read in two ways "
            f"({_quoted(facts, 'rate', 'interval')}): "
            f"{' or '.join(f'{r.rate_hz:g} Hz' for r in fit)}. Give the right one "
            "with --rate-hz."
        )
    rate = chosen.rate_hz
    said: tuple[str, ...] = ()
    if rate is None:
        rate, said = _computed_rate(name, facts, chosen.samples + measured.missing)
    elif facts.found and not all(fact.exact for fact in facts.found):
        said = (f"{rate:g} Hz by the heading ({_quoted(facts, 'rate', 'interval')})",)
        notes += _beside(facts, rate)
        if all(fact.rank == 0 for fact in facts.of("rate")) and facts.of("rate"):
            notes += (
                f"The only rate of the heading is a converter's ({_quoted(facts, 'rate')}): "
                f"{rate:g} Hz was used. Give --rate-hz if samples were thinned after it.",
            )
    if chosen.wrapped:
        said += (f"one series of {chosen.samples} samples, {measured.width} on a line",)
    return ReadingVerdict(rate, chosen.wrapped, said, notes)


def _beside(facts: Facts, rate: float) -> tuple[str, ...]:
    """Note the weak figures of a heading that give way to another rate."""
    other = [
        f"{fact.text!r} (line {fact.line})"
        for fact in facts.found
        if fact.weak
        and fact.kind in ("rate", "interval")
        and not any(_near(rate, one, RATE_TOLERANCE) for one in _rates_of(fact))
    ]
    if not other:
        return ()
    return (f"The heading also states {', '.join(other)}; {rate:g} Hz was used.",)


def _of_something_else(facts: Facts) -> str:
    said = ", ".join(
        f"{fact.text!r} (line {fact.line})"
        for kind in LENGTHS
        for fact in facts.of(kind)
        if fact.weak
    )
    return f"The heading states {said}, which is not of these rows and was not used."


def refuse_beyond(name: str, rate_hz: float) -> None:
    """Ask about a rate that no record of vibration has."""
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise RecordError(
            f"{name}: the file's own figures make {rate_hz:.6g} Hz, which is not a "
            f"plausible sampling rate for vibration ({SLOWEST_HZ:g} Hz to {FASTEST_HZ:g} "
            "Hz are). Give the unit of the times with --reading time_unit, or give --rate-hz, "
            f"{rate_hz:.6g} if that is right."
        )


def refuse_disagreement(
    name: str, facts: Facts, measured: RowFigures, *, rate_hz: float, wrapped: bool
) -> None:
    """Refuse rows that are not as many as a heading states, once all have been counted.

    Raises
    ------
    RecordError
        Which names the figures; also where columns without names may be one series after all.
    """
    facts = facts.without_weak(*LENGTHS)
    if not _agrees(_RowGuess(wrapped, measured.rows, rate_hz), facts, measured):
        raise _contradiction(name, facts, measured, [rate_hz])
    counted = [value for fact in facts.of("count") for value in fact.values]
    if measured.width > 1 and not measured.named and measured.series in counted:
        raise RecordError(
            f"The heading of {name} states {_quoted(facts, 'count')}, as many as its "
            f"{measured.rows} rows of {measured.width} columns hold together. "
            "Give --reading wrapped=yes if "
            "all are one series, or --reading wrapped=no and --rate-hz if columns are channels."
        )


def _layouts(measured: RowFigures) -> list[tuple[bool, int]]:
    """Whether columns are one series, and how many samples there are then."""
    single = measured.width == 1
    layouts = [
        (False, measured.rows + (measured.tail if single else 0)),
        (True, measured.series),
    ]
    if single:
        return layouts[:1]
    if measured.wrapped is not None:
        return [layouts[measured.wrapped]]
    # Columns with names are channels; a heading that says otherwise contradicts itself.
    return layouts[:1] if measured.named else layouts


def _stated_rates(name: str, facts: Facts) -> list[float]:
    """Rates that every rate and interval of the heading allows, the likeliest first."""
    options = [list(_rates_of(fact)) for fact in facts.of("rate")]
    if not any(fact.rank == 2 for fact in facts.of("rate")):
        options += [list(_rates_of(fact)) for fact in facts.of("interval")]
    if not options:
        return []
    common = [
        rate
        for rate in options[0]
        if all(
            any(_near(rate, other, RATE_TOLERANCE) for other in some) for some in options[1:]
        )
    ]
    if not common:
        raise RecordError(
            f"The heading of {name} states different rates: "
            f"{_quoted(facts, 'rate', 'interval')}. Say which is that of the samples with "
            "--rate-hz."
        )
    if facts.factor > 1 and not any(fact.rank == 2 for fact in facts.of("rate")):
        common += [rate / facts.factor for rate in common]
    return common


def _rates_of(fact: Fact) -> Iterator[float]:
    for value in fact.values:
        yield _tidy(1.0 / value) if fact.kind == "interval" else value


def _tidy(rate: float) -> float:
    return float(round(rate)) if round(rate) and _near(rate, round(rate), 1e-9) else rate


def _near(one: float, other: float, within: float) -> bool:
    return abs(one - other) <= within * max(abs(one), abs(other))


def is_near(measured_hz: float, stated_hz: float) -> bool:
    """Whether a measured rate is that which a heading means."""
    return _near(measured_hz, stated_hz, NOMINAL_RATE_TOLERANCE)


def _agrees(reading: _RowGuess, facts: Facts, measured: RowFigures) -> bool:
    counts = all(_count_agrees(fact, reading, measured) for fact in facts.of("count"))
    if reading.rate_hz is None:
        return counts
    return counts and all(
        _duration_agrees(fact, reading.samples + measured.missing, reading.rate_hz)
        for fact in facts.of("duration")
    )


def _count_agrees(fact: Fact, reading: _RowGuess, measured: RowFigures) -> bool:
    allowed = {reading.samples, reading.samples + measured.missing}
    every = reading.samples * measured.width if not measured.tail else -1
    return any(
        abs(value - samples) <= 1 or (value == every and not reading.wrapped)
        for value in fact.values
        for samples in allowed
    )


def _duration_agrees(fact: Fact, samples: int, rate_hz: float) -> bool:
    lasts = samples / rate_hz
    return any(
        abs(value - lasts)
        <= max(2 / rate_hz, DURATION_TOLERANCE * value, fact.tolerance * 1.01)
        for value in fact.values
    )


def _without_doubtful(
    name: str, fit: list[_RowGuess], facts: Facts, measured: RowFigures
) -> list[_RowGuess]:
    """Keep the readings of one layout, for which there is evidence."""
    if len({r.wrapped for r in fit}) == 1:
        return fit
    counted = measured.series in [v for fact in facts.of("count") for v in fact.values]
    if measured.named or not (measured.smooth or counted):
        return [r for r in fit if not r.wrapped]
    if counted and not measured.apart:
        return [r for r in fit if r.wrapped]
    raise RecordError(
        f"The {measured.width} columns of {name} have no names. They may be one series that "
        f"is written {measured.width} values a line ({measured.series} samples), or "
        f"{measured.width} channels of {measured.rows} samples{_quoting(facts, 'count')}. Say "
        "--reading wrapped=yes if it is one series, --reading wrapped=no if columns are "
        "channels."
    )


def _computed_rate(name: str, facts: Facts, count: int) -> tuple[float | None, tuple[str, ...]]:
    """Rate from a duration and the number of samples, where it is a whole number."""
    for fact in facts.of("duration"):
        lasts = fact.values[0]
        for samples in (count, count - 1):
            rate = samples / lasts
            if round(rate) and _near(rate, round(rate), WHOLE_RATE_TOLERANCE):
                said = f"{rate:g} Hz from {count} samples in {lasts:g} s"
                return float(round(rate)), (f"{said} (heading: {fact.text!r})",)
        raise RecordError(
            f"{name} states no rate, but how long it lasts ({fact.text!r}, line {fact.line}): "
            f"with {count} samples that would be {count / lasts:.6g} Hz. Give --rate-hz."
        )
    return None, ()


def _as_given(name: str, facts: Facts, measured: RowFigures) -> ReadingVerdict:
    """Let a given rate overrule the heading, with a note."""
    rate = measured.given_rate_hz
    assert rate is not None
    fit = [
        reading
        for wrapped, samples in _layouts(measured)
        if _agrees(reading := _RowGuess(wrapped, samples, rate), facts, measured)
    ]
    if not fit:
        # Of a file that was cut or thinned, no figure fits; columns are what they seem.
        fit = [_RowGuess(wrapped, samples, rate) for wrapped, samples in _layouts(measured)]
    chosen = _without_doubtful(name, fit, facts, measured)[0]
    overruled = [
        f"{fact.text!r}" + (f" (line {fact.line})" if fact.line else "")
        for fact in (*facts.of("rate"), *facts.of("interval"))
        if not any(_near(rate, other, NOMINAL_RATE_TOLERANCE) for other in _rates_of(fact))
    ]
    notes = (
        (f"The heading states {', '.join(overruled)}; {rate:g} Hz was given and is used.",)
        if overruled
        else ()
    )
    said = (
        (f"one series of {chosen.samples} samples, {measured.width} on a line",)
        if chosen.wrapped
        else ()
    )
    return ReadingVerdict(rate, chosen.wrapped, said, notes)


def _by_clock(name: str, facts: Facts, measured: RowFigures) -> ReadingVerdict:
    """Compare the clock with the heading."""
    rate = measured.clock_rate_hz
    assert rate is not None
    notes: list[str] = []
    stated = [*facts.of("rate"), *facts.of("interval")]
    far = [
        fact
        for fact in stated
        if not _matches(rate, fact, facts.factor, NOMINAL_RATE_TOLERANCE)
    ]
    agreeing = [fact for fact in stated if fact not in far]
    if far and not agreeing:
        words = ", ".join(f"{fact.text!r} (line {fact.line})" for fact in far)
        if all(fact.rank == 0 or fact.weak for fact in far):
            notes.append(
                f"The heading states {words}; the clock says {rate:g} Hz, and is used."
            )
        else:
            raise RecordError(
                f"The clock of {name} says {rate:.6g} Hz, its heading states {words}. Give "
                f"--rate-hz {rate:.6g} if the clock is right, or the other figure if it is."
            )
    if agreeing and not any(
        _matches(rate, fact, facts.factor, RATE_TOLERANCE) for fact in agreeing
    ):
        notes.append(
            f"The clock says {rate:.6g} Hz, the heading {agreeing[0].text!r}: the clock is "
            "used."
        )
    reading = _RowGuess(False, measured.rows, rate)
    lasting = measured.rows + measured.missing
    for fact in facts.of("count"):
        if not _count_agrees(fact, reading, measured):
            notes.append(
                f"The heading states {fact.text!r} (line {fact.line}), the file has "
                f"{measured.rows} rows: it was cut, or is of another length than it says."
            )
    for fact in facts.of("duration"):
        if not _duration_agrees(fact, lasting, rate):
            if not measured.clock_sure and not fact.weak:
                raise RecordError(
                    f"The heading of {name} states {fact.text!r} (line {fact.line}); its clock "
                    f"has no unit, and in seconds would last {lasting / rate:.6g} s. Say in "
                    "which unit times are with --reading time_unit, or give --rate-hz."
                )
            notes.append(
                f"The heading states {fact.text!r} (line {fact.line}), by its clock the file "
                f"lasts {lasting / rate:.6g} s."
            )
    return ReadingVerdict(rate, False, (), tuple(notes))


def _matches(rate: float, fact: Fact, factor: int, within: float) -> bool:
    return any(
        _near(rate, other / by, within) for other in _rates_of(fact) for by in {1, factor}
    )


def _contradiction(
    name: str, facts: Facts, measured: RowFigures, rates: list[float]
) -> RecordError:
    rows, width = measured.rows, measured.width
    has = f"{rows} rows of {width} columns" if width > 1 else f"{rows + measured.tail} samples"
    if rates:
        lasts = " or ".join(f"{rows / rate:.6g} s at {rate:g} Hz" for rate in rates)
        has += f", which are {lasts}"
        if width > 1:
            has += f" ({measured.series / rates[0]:.6g} s if columns are one series)"
    flag = f"--rate-hz {rates[0]:g}" if rates else "--rate-hz"
    return RecordError(
        f"The heading of {name} states {_quoted(facts, 'count', 'duration')}; the file "
        f"has {has}"
        f". It was cut, thinned, or is laid out otherwise. Give {flag} to read it as it stands"
        + (", with --reading wrapped=yes if all columns are one series." if width > 1 else ".")
    )


def _quoting(facts: Facts, kind: Literal["count"]) -> str:
    return f" (heading: {_quoted(facts, kind)})" if facts.of(kind) else ""


def _quoted(facts: Facts, *kinds: str) -> str:
    found = [
        f"{fact.text!r}" + (f" (line {fact.line})" if fact.line else "")
        for kind in ("rate", "interval", "count", "duration")
        if kind in kinds
        for fact in facts.of(kind)
    ]
    return ", ".join(found[:6]) or "nothing"
