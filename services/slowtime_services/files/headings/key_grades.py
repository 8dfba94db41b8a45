"""What words before a figure are worth: a statement of sampling, a hint, or nothing.

``Sampling rate`` says what it is of; ``rate`` says it only where no other word stands before
it (``Loading rate``), and ``FS`` is a full scale as often as a sampling frequency.
"""

import re
from typing import Literal

from slowtime_services.files.times.time_units import words_of

Kind = Literal["rate", "interval", "count", "duration"]
Grade = Literal["full", "weak", "doubtful"]
"""Weak figures give way to full ones and to a clock; doubtful ones are only quoted."""

SLOWEST_INTERVAL_S = 2.0
"""Interval from which it is hardly that of samples, but of files or of transmissions [s]: that
of the slowest rate that is read without a question."""
SERIAL_BAUD = frozenset(
    (9600, 14400, 19200, 28800, 38400, 57600, 115200, 230400, 460800, 921600)
)
"""Speeds of serial lines [bit/s], which loggers call data rates."""

_BARE = re.compile(
    r"rate(?:\s+hz)?|(?:x[\s-]*)?(?:incr?(?:ement)?|interval|spacing|step)|"
    r"samples|points|rows|scans|nsamples|npoints|nrows|rate\s+per\s+ch(?:annel)?",
    re.I,
)
_SYMBOL = re.compile(r"f[\s_]?s|s\.?r\.?|d[\s_]?[tx]|ts", re.I)
_WEAK = re.compile(
    r"(?:log|data|storage|readout|polling)[\s-]*(?:rate|freq\w*\.?|speed|interval|period|step|"
    r"spacing)|time[\s-]*base|test[\s-]*(?:length|duration|time)|"
    r"sample\s+(?:count|number|total)|anzahl\s+(?:der\s+)?mess[\s-]*punkte",
    re.I,
)
_DOUBTFUL = re.compile(
    r"frequency|update[\s-]*(?:rate|freq\w*\.?|speed|interval|period|step|spacing)|"
    r"time[\s-]*resolution",
    re.I,
)
_OF_ALL_CHANNELS = re.compile(r"(?:aggregate|combined|total|overall|sum(?:med)?)\W*$", re.I)
_LEADS = re.compile(
    r"the|a|an|at|of|in|is|with|and|to|by|mit|de|la|el|il|x|horizontal|time|nominal|constant|"
    r"actual|effective|true|real|used|set|fixed|uniform|equal|even|number|num|no|nr|total|"
    r"channel|ch|signal|input|output|original|raw|"
    r"sampl\w*|scan\w*|acqui\w*|acq|daq|record\w*|measur\w*|digiti\w*|logg?\w*|data|adc|"
    r"stored|saved|written|collected|reduced|decimat\w*|downsampl\w*|resampl\w*|thinned|averaged|spaced|equally|waveform|wf",
    re.I,
)
"""Words before a bare key that leave it one of sampling."""
_OF_POINTS = re.compile(r"measur\w*", re.I)
"""Words before points that are places on a structure, perhaps, not samples."""
_OF_STORING = re.compile(
    r"output|stored|saved|written|record\w*|logg?\w*|reduced|decimat\w*|downsampl\w*|"
    r"resampl\w*|thinned|averaged",
    re.I,
)
_THINNED = re.compile(
    r"reduced|decimat\w*|downsampl\w*|resampl\w*|thinned|dezimiert\w*|reduziert\w*", re.I
)
_STORING = re.compile(r"log|data|storage|readout|polling", re.I)
"""Words of rates that rows may have, beside another rate of a converter."""
_PER_SAMPLE = re.compile(
    r"(?<![^\W\d_])[kM]?(?:Sa?|samples?|scans?|points?|readings?)/s|[kM]?sps\b"
)
_SET = re.compile(r"\s*(?:[=:\t;,]|[\[(/]|$)")
"""What stands behind a symbol that is set, not part of a name such as ``DT 9837``."""


def grade_of(kind: Kind, key: str, before: str, after: str, has_unit: bool) -> Grade:
    """Judge a key by the words about it.

    Parameters
    ----------
    key
        The words of sampling, as the heading has them.
    before, after
        What stands before and behind them in their part of the line.
    has_unit
        Whether the figure has a unit of frequency or of time.

    Examples
    --------
    >>> grade_of("rate", "Sampling rate", "", ": 200 Hz", True)
    'full'
    >>> grade_of("rate", "rate", "Loading ", ": 5 Hz", True)
    'doubtful'
    >>> grade_of("rate", "FS", "", ": 16", False), grade_of("rate", "fs", "", "=16", False)
    ('doubtful', 'full')
    """
    key = key.strip()
    lead = _lead(before)
    if kind == "rate" and _OF_ALL_CHANNELS.search(before):
        return "doubtful"
    if _DOUBTFUL.fullmatch(key):
        return "doubtful"
    if _SYMBOL.fullmatch(key):
        return _grade_of_symbol(key, lead, after, has_unit)
    if _BARE.fullmatch(key):
        known = all(_LEADS.fullmatch(word) for word in lead)
        if kind == "count":
            return "full" if known and not any(map(_OF_POINTS.fullmatch, lead)) else "weak"
        if not known:
            return "doubtful"
        said = has_unit and (any(map(_OF_STORING.fullmatch, lead)) or _PER_SAMPLE.search(after))
        return "full" if said else "weak"
    stated = has_unit and kind in ("rate", "interval")
    return "weak" if _WEAK.fullmatch(key) and not (stated and _STORING.match(key)) else "full"


def is_after_thinning(before: str) -> bool:
    """Whether words before a key say that it is of the rows as they were written."""
    return any(map(_THINNED.fullmatch, _lead(before)[-2:]))


def _grade_of_symbol(key: str, lead: list[str], after: str, has_unit: bool) -> Grade:
    """Judge ``fs``, ``SR``, ``dt``: as they stand in equations, or with a unit."""
    if not _SET.match(after) and not (has_unit and not lead):
        return "doubtful"
    if has_unit:
        return "full"
    return "doubtful" if re.fullmatch(r"FS|F_S|S\.?R\.?", key) else "full"


def _lead(before: str) -> list[str]:
    """Words that stand directly before a key, back to the mark that ends what is before."""
    part = re.split(r"[=:;,\t|.(\[@]|\d", before)[-1]
    return words_of(part)
